"""The kinds of rooms. `build_scene(name, seed)` is the way in."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dsmap.errors import InputError
from dsmap.sim_scenes.rooms import blueprint, flats, home, joined_flats, lighting, shell, work
from dsmap.sim_scenes.rooms.check import check_scene
from dsmap.sim_scenes.rooms.furnisher import Furnisher
from dsmap.sim_scenes.rooms.layout import Layout
from dsmap.sim_scenes.rooms.strew import strew
from dsmap.sim_scenes.scene import Scene
from dsmap.sim_scenes.textures.palette import Looks


@dataclass(frozen=True)
class RoomKind:
    """How big a kind of room is and who furnishes it."""

    furnish: Callable[[Furnisher], np.ndarray]
    """Furnishes the room and returns the point to look at first."""
    width: tuple[float, float]
    depth: tuple[float, float]
    """Inner sizes of a single room of this kind [m]."""
    pictures: tuple[int, int] = (1, 3)
    """Least and largest number of pictures on its walls."""


ROOM_KINDS: dict[str, RoomKind] = {
    "living_room": RoomKind(home.living_room, (4.4, 5.8), (3.9, 5.0), (2, 4)),
    "bedroom": RoomKind(home.bedroom, (3.6, 5.0), (3.4, 4.5), (2, 4)),
    "office": RoomKind(work.office, (3.4, 5.2), (3.2, 4.4), (1, 3)),
    "kitchen": RoomKind(work.kitchen, (3.4, 5.0), (3.1, 4.2), (0, 2)),
    "bathroom": RoomKind(work.bathroom, (2.3, 3.2), (2.1, 2.9), (0, 1)),
    "corridor": RoomKind(work.corridor, (4.5, 7.0), (1.35, 1.9), (2, 5)),
}
SCENES = (*ROOM_KINDS, "flat")
"""Names that `build_scene` takes."""


ATTEMPTS = 6
"""Draws of a scene until one is sound."""
MIX: dict[str, float] = {
    "living_room": 0.36, "bedroom": 0.25, "office": 0.05, "kitchen": 0.16, "bathroom": 0.09, "corridor": 0.05,
    "flat": 0.04,
}  # fmt: skip
"""Shares of the kinds of rooms in a training set."""


def build_scene(name: str, seed: int) -> Scene:
    """A furnished room, flat or row of flats (`flats:2`); everything in it follows from its name and seed.

    A draw in which something overlaps or bars a way (about one in a hundred) is drawn again.

    Raises:
        InputError: there is no room of that name.
    """
    if not is_scene(name):
        raise InputError(f"unknown scene {name!r}; expected one of: {', '.join(SCENES)}, flats:2")
    count = joined_flats.flats_in(name)
    number = SCENES.index(name) if count is None else 100 + count
    # The first draw's generator is the seed's own; the others have the attempt's number in their key.
    scene = _draw(name, seed, [seed, number])
    for attempt in range(1, ATTEMPTS):
        if not check_scene(scene):
            break
        scene = _draw(name, seed, [seed, number, attempt])
    return scene


def is_scene(name: str) -> bool:
    """Whether `build_scene` takes that name.

    Raises:
        InputError: flats of a number that cannot be joined.
    """
    return name in SCENES or joined_flats.flats_in(name) is not None


def _draw(name: str, seed: int, key: list[int]) -> Scene:
    rng = np.random.default_rng(key)
    looks = Looks(rng)
    height = rng.uniform(2.45, 2.75)
    count = joined_flats.flats_in(name)
    if count is not None:
        plan = joined_flats.draw_flats(rng, height, count)
    elif name == "flat":
        plan = flats.draw_flat(rng, height)
    else:
        kind = ROOM_KINDS[name]
        size = np.array([rng.uniform(*kind.width), rng.uniform(*kind.depth), height])
        plan = blueprint.single(rng, name, size)
    ends = np.array([[room.low, room.high] for room in plan.rooms])
    size = np.array([*(ends[:, 1].max(0) - ends[:, 0].min(0)), height])
    scene = Scene(name, seed, size, looks.materials, rooms=plan.rooms, doors=plan.doors)
    layouts = [Layout(scene, rng, k) for k in range(len(plan.rooms))]
    views = [_finish(rng, looks, layout, plan) for layout in layouts]
    scene.targets.insert(0, views[0])
    lighting.light(rng, looks, layouts)
    return scene


def _finish(rng: np.random.Generator, looks: Looks, layout: Layout, plan: blueprint.Blueprint) -> np.ndarray:
    """Walls, furniture and pictures of one room; returns the point to look at first."""
    kind = ROOM_KINDS[layout.room.kind]
    shell.close_room(rng, looks, layout, plan.apply(layout))
    if layout.index in plan.bare:
        return np.array([*layout.centre, 1.2])
    layout.floor.least = min(1.0, 0.12 * float(np.prod(layout.size[:2])))
    furnisher = Furnisher(rng, looks, layout)
    target = kind.furnish(furnisher)
    furnisher.pictures(int(rng.integers(kind.pictures[0], kind.pictures[1] + 1)))
    strew(rng, looks, layout, rng.uniform(0.0, 0.5))
    return target
