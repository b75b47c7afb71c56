"""Plans of several flats in a row, each joined to the next by a bare corridor: a test bed for drift."""

import re

import numpy as np

from dsmap.errors import InputError
from dsmap.sim_scenes.rooms.blueprint import INNER, OUTER, Blueprint
from dsmap.sim_scenes.rooms.flats import draw_flat
from dsmap.sim_scenes.rooms.layout import walls_of
from dsmap.sim_scenes.rooms.openings import WAY, Opening
from dsmap.sim_scenes.scene import Door, Room

MOST_FLATS = 6
"""More flats are not joined: their textures alone would take gigabytes."""
_LENGTH = (4.0, 6.0)
"""Of a corridor between two flats [m]."""
_WIDTH = (1.4, 1.7)
_EAST, _WEST = 1, 3
"""Numbers of walls in the order of `walls_of`."""


def flats_in(name: str) -> int | None:
    """Number of flats that a scene's name asks for (`flats:2`); None where it is no such name.

    Raises:
        InputError: a number that cannot be joined.
    """
    found = re.fullmatch(r"flats:(\d+)", name)
    if found is None:
        return None
    count = int(found[1])
    if not 2 <= count <= MOST_FLATS:
        raise InputError(f"scene {name!r} has {count} flats; expected flats:2 to flats:{MOST_FLATS}")
    return count


def draw_flats(rng: np.random.Generator, height: float, count: int) -> Blueprint:
    """A row of `count` flats along x, the middle of all of them at the origin."""
    whole = draw_flat(rng, height)
    for _ in range(count - 1):
        other = draw_flat(rng, height)
        _join(rng, whole, other, height)
    middle = (np.min([r.low for r in whole.rooms], 0) + np.max([r.high for r in whole.rooms], 0)) / 2
    _shift(whole, -middle)
    return whole


def _join(rng: np.random.Generator, whole: Blueprint, other: Blueprint, height: float) -> None:
    """Put a flat east of all others and a corridor from a room there to one of its western rooms."""
    start, goal = _outermost(rng, whole, _EAST), _outermost(rng, other, _WEST)
    length, width = rng.uniform(*_LENGTH), rng.uniform(*_WIDTH)
    a, b = whole.rooms[start], other.rooms[goal]
    _shift(other, np.array([a.high[0] + length - b.low[0], (a.low + a.high - b.low - b.high)[1] / 2]))
    b = other.rooms[goal]
    first = len(whole.rooms)
    corridor = first + len(other.rooms)
    whole.rooms += other.rooms
    whole.doors += [
        Door(d.centre, d.normal, d.width, (d.rooms[0] + first, d.rooms[1] + first)) for d in other.doors
    ]
    whole.holes += other.holes
    whole.thickness += other.thickness
    y = float((a.low + a.high)[1] / 2)
    whole.rooms.append(
        Room(
            "corridor",
            np.array([a.high[0] + 2 * INNER, y - width / 2]),
            np.array([b.low[0] - 2 * INNER, y + width / 2]),
            height,
        )
    )
    whole.bare.add(corridor)
    whole.holes.append([[], [], [], []])
    whole.thickness.append([OUTER, INNER, OUTER, INNER])
    for room, wall, other_wall, ends in (
        (start, _EAST, _WEST, (start, corridor)),
        (first + goal, _WEST, _EAST, (corridor, first + goal)),
    ):
        side = whole.rooms[room]
        x = side.high[0] + INNER if wall == _EAST else side.low[0] - INNER
        door = Door(np.array([x, y]), np.array([1.0, 0.0]), rng.uniform(1.0, 1.2), ends)
        tall = rng.uniform(2.05, 2.2)
        whole.doors.append(door)
        whole.thickness[room][wall] = INNER
        whole.holes[room][wall] = []  # the corridor stands before its windows
        for k, number in ((room, wall), (corridor, other_wall)):
            at, half = walls_of(whole.rooms[k])[number].local(door.centre), door.width / 2 + 0.022
            whole.holes[k][number].append(Opening(at - half, at + half, 0.0, tall, WAY, leaf=False))


def _outermost(rng: np.random.Generator, plan: Blueprint, wall: int) -> int:
    """A room at the eastern or western end of a plan that is wide enough for a corridor's end."""
    faces = [room.high[0] if wall == _EAST else -room.low[0] for room in plan.rooms]
    at_end = [k for k, face in enumerate(faces) if face > max(faces) - 1e-6]
    width = [float((plan.rooms[k].high - plan.rooms[k].low)[1]) for k in at_end]
    wide = [k for k, w in zip(at_end, width, strict=True) if w > _WIDTH[1] + 2 * OUTER + 0.2]
    halls = [k for k in wide or at_end if plan.rooms[k].kind != "bathroom"]
    return int(rng.choice(halls or wide or at_end))


def _shift(plan: Blueprint, by: np.ndarray) -> None:
    plan.rooms[:] = [Room(r.kind, r.low + by, r.high + by, r.height) for r in plan.rooms]
    plan.doors[:] = [Door(d.centre + by, d.normal, d.width, d.rooms) for d in plan.doors]
