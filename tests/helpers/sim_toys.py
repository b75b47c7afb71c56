"""Hand-made scenes for tests: two rooms with a door between them; what a renderer has compiled."""

import numpy as np

from dsmap.sim_scenes.geometry.shapes import box
from dsmap.sim_scenes.render.warp_renderer import WarpRenderer
from dsmap.sim_scenes.scene import Door, Light, Material, Part, Room, Scene


def two_rooms() -> Scene:
    """Rooms of 4 x 4 m and 4 x 3 m side by side along x with an opening of 0.9 m; a table, a cupboard, a bed."""
    rng = np.random.default_rng(5)
    looks = {
        name: Material(rng.integers(40, 220, (64, 64, 3), dtype=np.uint8), 1.0)
        for name in ("wall", "floor", "wood", "cloth")
    }
    scene = Scene("two_rooms", 0, np.array([8.16, 4.0, 2.5]), looks)
    scene.rooms = [
        Room("living_room", np.array([-4.08, -2.0]), np.array([-0.08, 2.0]), 2.5),
        Room("bedroom", np.array([0.08, -1.5]), np.array([4.08, 1.5]), 2.5),
    ]
    scene.doors = [Door(np.array([0.0, 0.6]), np.array([1.0, 0.0]), 0.9, (0, 1))]

    def add(label: int, material: str, size: tuple, at: tuple) -> None:
        scene.parts.append(Part(box(size, at), material, label, len(scene.parts) + 1))

    add(5, "floor", (8.4, 4.4, 0.1), (0, 0, -0.1))
    add(3, "wall", (8.4, 4.4, 0.1), (0, 0, 2.5))
    for low, high in (((-4.28, -2.2), (-4.08, 2.2)), ((4.08, -2.2), (4.28, 2.2)),
                      ((-4.28, 2.0), (-0.08, 2.2)), ((-4.28, -2.2), (-0.08, -2.0)),
                      ((0.08, 1.5), (4.28, 2.2)), ((0.08, -2.2), (4.28, -1.5)),
                      ((-0.08, -2.2), (0.08, 0.15)), ((-0.08, 1.05), (0.08, 2.2))):  # fmt: skip
        size, middle = np.subtract(high, low), np.add(high, low) / 2
        add(12, "wall", (*size, 2.5), (*middle, 0.0))
    add(10, "wood", (1.0, 0.8, 0.75), (-2.0, 0.0, 0.0))
    add(6, "wood", (1.2, 0.6, 2.0), (-2.6, 1.65, 0.0))
    add(1, "cloth", (1.6, 2.0, 0.5), (3.2, -0.3, 0.0))
    points = ((-2.0, 0, 0.7), (-2.6, 1.5, 1.2), (3.2, -0.3, 0.5), (-4.0, -1, 1.3), (1.5, -1.4, 1.2))
    scene.targets = [np.array(p) for p in points]
    scene.lights = [Light(np.array([x, 0.0, 2.3]), np.full(3, 0.5), np.zeros(3)) for x in (-2.0, 2.0)]
    return scene


def compiled_kernel(renderer: WarpRenderer) -> str:
    """Name and hash of the compiled kernel, once a frame was rendered: equal names share one compilation."""
    return str(renderer._context._megakernel.module.name)
