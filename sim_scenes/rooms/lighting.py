"""Light in rooms: lamps, daylight through windows, by day or in the evening; exposed room by room.

Each scene draws one mood. Every room gets a light of its own (lamp or window), and its lights are scaled
until the best-lit places of its bare walls, floor and ceiling get what the mood wants: no room of a flat
is black, and none burns out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dsmap.sim_scenes.pieces import lamps
from dsmap.sim_scenes.rooms.layout import Layout
from dsmap.sim_scenes.scene import LEAK, MAX_LIGHTS, Light, Piece, Room, Scene
from dsmap.sim_scenes.textures.palette import Looks

UNLIT_AMBIENT = 0.65
"""Least share of the light that comes from everywhere where there are more rooms than lights."""
HEADROOM = 1.9
"""Lamps do not hang lower than this [m]."""


@dataclass(frozen=True)
class Mood:
    """A way in which a home is lit."""

    lamps: float
    """Share of the rooms that have their ceiling lamp on."""
    daylight: bool
    level: tuple[float, float]
    """Range of the light at the best-lit places of a room; 1.1 brings a white wall close to 1."""
    ambient: tuple[float, float]
    """Range of the share of it that comes from everywhere."""
    tints: tuple[tuple[float, float, float], ...]
    """Colours that lamps may have."""


WARM, WHITE, COLD = (1.0, 0.86, 0.66), (1.0, 0.94, 0.85), (0.92, 0.97, 1.0)
MOODS = {
    "day": Mood(0.15, True, (0.78, 1.0), (0.3, 0.42), (WARM, WHITE)),
    "grey_day": Mood(1.0, True, (0.74, 0.98), (0.34, 0.46), (WARM, WHITE, COLD)),
    "evening": Mood(1.0, False, (0.7, 0.94), (0.24, 0.34), (WARM, WARM, WHITE)),
    "dim": Mood(0.6, False, (0.5, 0.65), (0.3, 0.4), (WARM, WHITE)),
    "strong": Mood(1.0, True, (0.95, 1.15), (0.36, 0.46), (WHITE, COLD)),
}
SHARES = {"day": 0.3, "grey_day": 0.25, "evening": 0.22, "dim": 0.08, "strong": 0.15}
"""How often a scene has each mood."""


def light(rng: np.random.Generator, looks: Looks, layouts: Sequence[Layout]) -> None:
    """Hang a ceiling lamp in every room and set the scene's lights, at most `MAX_LIGHTS`, and its ambient light."""
    scene = layouts[0].scene
    mood = MOODS[rng.choice(list(SHARES), p=list(SHARES.values()))]
    tint = np.array(mood.tints[rng.integers(len(mood.tints))])
    day = np.array([0.93, 0.97, 1.0]) if rng.random() < 0.7 else np.array([1.0, 0.95, 0.86])
    by_room: list[list[Light]] = []
    for layout in layouts:
        panes = (
            [p for p in scene.pieces if p.room == layout.index and p.name == "window"]
            if mood.daylight
            else []
        )
        lit = not panes or rng.random() < mood.lamps
        lights = [_hang(rng, looks, layout, tint, lit)] if lit else [_from_window(rng, panes[0], day)]
        if not lit:
            _hang(rng, looks, layout, tint, False)
        lights += [_from_window(rng, pane, day) for pane in (panes if lit else panes[1:])]
        if panes and rng.random() < 0.5:
            lights.append(_sun(rng, panes[0]))
        lights += [_stand_lamp(piece) for piece in scene.pieces if _is_lamp(piece, layout.index)]
        if len(layouts) == 1:  # shadows are half the cost; between rooms, walls must hold all lights
            lights[1:] = [replace(v, shadow=v.cutoff is not None) for v in lights[1:]]
        by_room.append(lights)
    if not mood.daylight:
        _night(scene)
    fills = [_fill((0.3, -0.5, 1.0), 0.16), _fill((-0.7, 0.45, -0.5), 0.08)]
    kept = _within_budget(by_room, MAX_LIGHTS - len(fills))
    level = rng.uniform(*mood.level)
    share = rng.uniform(*mood.ambient)
    if len(layouts) > MAX_LIGHTS:  # not every room has a lamp
        share = max(share, UNLIT_AMBIENT)
    ambient = level * share
    fills = [replace(f, diffuse=f.diffuse * level) for f in fills]
    scene.ambient = ambient * (0.6 + 0.4 * (day if mood.daylight else tint))
    scene.lights = _exposed(scene, kept, fills, level) + fills


def _hang(rng: np.random.Generator, looks: Looks, layout: Layout, tint: np.ndarray, lit: bool) -> Light:
    """Hang a lamp near the middle of a room's ceiling; its shade glows if it is lit."""
    scene, height = layout.scene, layout.room.height
    spot = layout.centre + rng.uniform(-0.15, 0.15, 2) * layout.size[:2] * (layout.size[:2] > 2.0)
    lamp = lamps.pendant(rng, looks) if rng.random() < 0.5 else lamps.ceiling_lamp(rng, looks)
    if height + lamp.bounds()[0][2] < HEADROOM:
        lamp = lamps.ceiling_lamp(rng, looks)
    lamp.name = "ceiling_lamp"
    for name in {material for _, material, *_ in lamp.parts if material.startswith("shade")}:
        scene.materials[name] = replace(scene.materials[name], emission=0.55 if lit else 0.0)
    scene.place(lamp, (*spot, height), room=layout.index)
    below = min(float(lamp.bounds()[0][2]) - 0.06, -0.45)
    return Light(np.array([*spot, height + below]), tint, 0.5 * tint, reach=4.0)


def _from_window(rng: np.random.Generator, window: Piece, colour: np.ndarray) -> Light:
    """The sky's light as a point a hand's breadth inside the pane."""
    low, high = window.assembly.bounds()
    at = window.T_world_piece @ np.array([0, -0.35, 0.35 * low[2] + 0.65 * high[2], 1.0])
    return Light(at[:3], colour, 0.4 * colour, reach=rng.uniform(2.5, 4.0))


def _sun(rng: np.random.Generator, window: Piece) -> Light:
    """A beam of sun from a window's upper edge down into the room: a bright, soft-edged patch with hard shadows."""
    high = window.assembly.bounds()[1]
    frame = window.T_world_piece
    at = frame @ np.array([rng.uniform(-0.2, 0.2), -0.12, min(high[2], 2.2) - 0.1, 1.0])
    down = np.array([rng.uniform(-0.6, 0.6), -1.0, -rng.uniform(0.8, 1.3)])
    colour = np.array([1.0, 0.9, 0.74])
    direction = frame[:3, :3] @ (down / np.linalg.norm(down))
    return Light(at[:3], colour, 0.3 * colour, direction, True, None, 50.0)


def _is_lamp(piece: Piece, room: int) -> bool:
    return piece.room == room and piece.name in ("lamp", "floor_lamp")


def _stand_lamp(piece: Piece) -> Light:
    """The light above the shade of a floor or table lamp."""
    top = piece.assembly.bounds()[1][2] + 0.05
    colour = np.array(WARM)
    return Light(
        (piece.T_world_piece @ np.array([0, 0, top, 1.0]))[:3], 0.5 * colour, 0.1 * colour, reach=1.5
    )


def _fill(direction: tuple[float, float, float], power: float) -> Light:
    """Light from one side, everywhere and without shadows: what floors and walls scatter."""
    unit = np.array(direction) / np.linalg.norm(direction)
    return Light(np.zeros(3), np.full(3, power), np.zeros(3), unit, False)


def _night(scene: Scene) -> None:
    """Make it dark outside."""
    for name, look in scene.materials.items():
        if name.startswith("pane"):
            night = (look.texture * np.array([0.06, 0.07, 0.11])).astype(np.uint8)
            scene.materials[name] = replace(look, texture=night, emission=0.3)


def _within_budget(by_room: Sequence[Sequence[Light]], budget: int) -> list[tuple[int, Light]]:
    """(room, light): the first light of each room, then the second of each, as many as there may be."""
    turns = max(len(lights) for lights in by_room)
    order = [
        (room, lights[k]) for k in range(turns) for room, lights in enumerate(by_room) if k < len(lights)
    ]
    return order[:budget]


def _exposed(
    scene: Scene, lights: Sequence[tuple[int, Light]], fills: Sequence[Light], level: float
) -> list[Light]:
    """Scale each room's own lights so that the best-lit tenth of its faces gets `level`."""
    everywhere = float(scene.ambient.mean())
    surfaces = [_faces(room) for room in scene.rooms]
    received = [
        np.stack([_received(lamp, *faces) * (1.0 if room == at else LEAK) for at, lamp in lights])
        for room, faces in enumerate(surfaces)
    ]  # per room: (lights, points)
    base = [everywhere + sum(_received(fill, *faces) for fill in fills) for faces in surfaces]
    gain = np.ones(len(scene.rooms))
    of_light = np.array([at for at, _ in lights])
    for _ in range(12):  # the rooms light each other a little: a few rounds settle it
        for room in range(len(scene.rooms)):
            own = of_light == room
            others = base[room] + (gain[of_light[~own], None] * received[room][~own]).sum(0)
            mine = received[room][own].sum(0)
            if mine.size and mine.max() > 0:
                gain[room] = _gain(others, mine, level)
    return [
        replace(lamp, diffuse=gain[at] * lamp.diffuse, specular=gain[at] * lamp.specular)
        for at, lamp in lights
    ]


def _gain(others: np.ndarray, mine: np.ndarray, level: float) -> float:
    """Factor on `mine` that brings the 90th percentile of the sum to `level` (bisection)."""
    low, high = 0.02, 20.0
    for _ in range(30):
        middle = (low * high) ** 0.5
        low, high = (middle, high) if np.percentile(others + middle * mine, 90) < level else (low, middle)
    return low


def _faces(room: Room) -> tuple[np.ndarray, np.ndarray]:
    """Points spread over a room's six bare faces (N, 3) and the normals into the room there (N, 3)."""
    grid = np.stack(np.meshgrid(*[np.linspace(-0.45, 0.45, 9)] * 2), -1).reshape(-1, 2)
    size = np.array([*(room.high - room.low), room.height])
    middle = np.array([*(room.low + room.high) / 2, room.height / 2])
    points, normals = [], []
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        for side in (-1, 1):
            unit = np.empty((len(grid), 3))
            unit[:, axis], unit[:, others] = side / 2, grid
            points.append(unit * size + middle)
            normals.append(np.tile(-side * np.eye(3)[axis], (len(grid), 1)))
    return np.concatenate(points), np.concatenate(normals)


def _received(lamp: Light, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Unshadowed light of one lamp at each point, mean over the colours, shape (N,). Suns count nothing."""
    power = float(lamp.diffuse.mean())
    if lamp.cutoff is not None:
        return np.zeros(len(points))
    if lamp.direction is not None:
        return power * np.clip(-normals @ lamp.direction, 0, None)
    to_light = lamp.position - points
    distance = np.maximum(np.linalg.norm(to_light, axis=1), 0.05)
    falloff = 1.0 if lamp.reach is None else 1 / (1 + (distance / lamp.reach) ** 2)
    return power * falloff * np.clip((normals * to_light).sum(1) / distance, 0, None)


def moved_lamp(lamp: Light, rotation: np.ndarray, shift: np.ndarray) -> Light:
    """A light turned about the origin by `rotation` (3, 3), then shifted."""
    turned = None if lamp.direction is None else rotation @ lamp.direction
    return replace(lamp, position=rotation @ lamp.position + shift, direction=turned)


def ceiling_lights(room: Room) -> list[Light]:
    """Up to six lamps spread under the ceiling of a room of unknown contents, about one for 20 square metres."""
    width, depth = room.high - room.low
    across = int(np.clip(round(width / 4.5), 1, 3))
    along = int(np.clip(round(depth / 4.5), 1, 2))
    white = np.array(WHITE)
    return [
        Light(np.array([*(room.low + [width * (i + 0.5) / across, depth * (j + 0.5) / along]), 0.85 * room.height]),
              white, 0.3 * white, None, True, 4.0)
        for i in range(across) for j in range(along)
    ]  # fmt: skip


def imported(scene: Scene, lights: Sequence[Light]) -> None:
    """Light a scene of one room from outside with given lights, as many as there may be, well exposed."""
    fills = [_fill((0.3, -0.5, 1.0), 0.16), _fill((-0.7, 0.45, -0.5), 0.08)]
    scene.ambient = np.full(3, 0.35)
    kept = [(0, lamp) for lamp in lights[: MAX_LIGHTS - len(fills)]]
    scene.lights = _exposed(scene, kept, fills, 0.95) + fills
