"""Lights of a room, exposed like a photograph: bright, but without walls burnt to white."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dsmap.sim_scenes import decor
from dsmap.sim_scenes.layout import Layout, Wall
from dsmap.sim_scenes.looks import Looks
from dsmap.sim_scenes.scene import Assembly, Light, Scene
from dsmap.sim_scenes.textures import Rng

BRIGHTEST = 1.08
"""Light that the best-lit places of walls, floor and ceiling get: times a white wall's albedo, just below 1."""


def light(rng: Rng, looks: Looks, layouts: Sequence[Layout], windows: Sequence[tuple[int, Wall]]) -> None:
    """Ceiling lamps, daylight from windows, weak fill lights; exposed so that no wall burns to white.

    Args:
        layouts: one for each room of the scene.
        windows: room number and wall of each window.
    """
    scene = layouts[0].scene
    spots = [
        layout.centre + rng.uniform(-0.15, 0.15, 2) * layout.size[:2] * (layout.size[:2] > 2.0)
        for layout in layouts
    ]
    for layout, spot in zip(layouts, spots, strict=True):
        hanging = Assembly("objects", name="ceiling_lamp")
        decor.add_ceiling_lamp(rng, looks, hanging, layout.room.height)
        scene.place(hanging, (*spot, 0.0), room=layout.index)
    warm, cool = np.array([1.0, 0.93, 0.82]), np.array([0.9, 0.96, 1.0])
    day, evening = rng.uniform(0.25, 0.45), rng.uniform(0.32, 0.48)

    def point(xy: np.ndarray, z: float, colour: np.ndarray, power: float, shadow: bool = True) -> Light:
        return Light(np.array([*xy, z]), colour * power, colour * power * 0.5, None, shadow)

    def fill(direction: tuple[float, float, float], power: float) -> Light:
        unit = np.array(direction) / np.linalg.norm(direction)
        return Light(np.zeros(3), np.full(3, power), np.zeros(3), unit, False)

    scene.lights = [
        point(spot, layout.room.height - 0.52, warm, evening)
        for layout, spot in zip(layouts, spots, strict=True)
    ]
    if len(layouts) == 1:
        if windows:
            window, height = windows[0][1], layouts[0].room.height
            third = window.point(rng.uniform(-1, 1), rng.uniform(0.3, 0.5) * float(scene.size[0]))
            scene.lights += [
                point(window.point(0.0, 0.35), 1.9, cool, day),
                point(third, height - 0.25, warm, rng.uniform(0.06, 0.12), False),
            ]
        scene.lights += [fill((-0.9, 0.5, 0.4), 0.08), fill((0.3, -0.5, 1.0), 0.2)]
    scene.lights.append(fill((0.3, 0.2, -1.0), 0.1))
    scene.ambient = np.full(3, rng.uniform(0.28, 0.36))
    _expose(scene)


def _expose(scene: Scene) -> None:
    """Scale all lights so that the best-lit twentieth of walls, floor and ceiling gets `BRIGHTEST`."""
    factor = BRIGHTEST / float(np.percentile(irradiance(scene), 95))
    scene.ambient = scene.ambient * factor
    scene.lights = [
        replace(v, diffuse=v.diffuse * factor, specular=v.specular * factor) for v in scene.lights
    ]


def irradiance(scene: Scene) -> np.ndarray:
    """Unshadowed light (mean over the colours) at points spread over the bare room's six faces, shape (N,)."""
    grid = np.stack(np.meshgrid(*[np.linspace(-0.45, 0.45, 9)] * 2), -1).reshape(-1, 2)
    total = []
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        for side in (-1, 1):
            points = np.empty((len(grid), 3))
            points[:, axis], points[:, others] = side / 2, grid
            points = points * scene.size + [0, 0, scene.size[2] / 2]
            received = np.full(len(points), scene.ambient.mean())
            for lamp in scene.lights:
                to_light = (
                    lamp.position - points
                    if lamp.direction is None
                    else -np.tile(lamp.direction, (len(points), 1))
                )
                cosine = -side * to_light[:, axis] / np.linalg.norm(to_light, axis=1)
                received += lamp.diffuse.mean() * np.clip(cosine, 0, None)
            total.append(received)
    return np.concatenate(total)
