"""Plans of flats: rooms joined by doors so that one can walk in a circle and come back.

Plans are tilings of a rectangle; a room is its tile less half a wall on every side.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dsmap.sim_scenes.rooms.blueprint import INNER, OUTER, Blueprint, window_in
from dsmap.sim_scenes.rooms.layout import walls_of
from dsmap.sim_scenes.rooms.openings import OPEN, WAY, Opening
from dsmap.sim_scenes.scene import Door, Room

ROUND_TRIP_M = 15.0
"""A flat has a circle of doors at least this long, measured straight from door to door."""


@dataclass
class Tiling:
    """Tiles and which of them are joined."""

    tiles: list[tuple[str, float, float, float, float]]
    """Kind, x0, y0, x1, y1 [m]."""
    links: list[tuple[int, int, str]]
    """Two tiles and what joins them: `OPEN` (a door) or `WAY`. The first `ring` of them form the circle."""
    ring: int


def draw_flat(rng: np.random.Generator, height: float) -> Blueprint:
    """A flat of five to eight rooms about the origin."""
    tiling = (_corridor, _pinwheel, _square)[int(rng.integers(3))](rng)
    box = np.array([tile[1:] for tile in tiling.tiles])
    low, high = box[:, :2].min(0), box[:, 2:].max(0)
    middle = (low + high) / 2
    rooms = [
        Room(kind, np.array([x0, y0]) + INNER - middle, np.array([x1, y1]) - INNER - middle, height)
        for kind, x0, y0, x1, y1 in tiling.tiles
    ]
    holes: list[list[list[Opening]]] = [[[], [], [], []] for _ in rooms]
    thickness = [
        [
            OUTER if outside else INNER
            for outside in (y0 == low[1], x1 == high[0], y1 == high[1], x0 == low[0])
        ]
        for _, x0, y0, x1, y1 in tiling.tiles
    ]
    doors = _doors(rng, tiling, rooms)
    for door, (i, j, kind) in zip(doors, tiling.links, strict=True):
        tall = rng.uniform(2.0, 2.08) if kind == OPEN else rng.uniform(2.05, 2.2)
        swing = j if rooms[i].kind == "corridor" else i
        for room in (i, j):
            walls = walls_of(rooms[room])
            k = _wall_of(door, rooms[room])
            x, half = walls[k].local(door.centre), door.width / 2 + 0.022
            holes[room][k].append(Opening(x - half, x + half, 0.0, tall, kind, leaf=room == swing))
    for room, own, thick in zip(rooms, holes, thickness, strict=True):
        _windows(rng, room, own, thick)
    return Blueprint(rooms, doors, holes, thickness)


def _wall_of(door: Door, room: Room) -> int:
    """Number of the room's wall that a door is in."""
    distance = [abs((door.centre - w.centre) @ w.normal) for w in walls_of(room)]
    facing = [abs(w.normal @ door.normal) > 0.5 for w in walls_of(room)]
    return min((k for k in range(4) if facing[k]), key=lambda k: distance[k])


def _windows(rng: np.random.Generator, room: Room, holes: list[list[Opening]], thick: list[float]) -> None:
    """Windows in the outer walls of a room: one at least where it has any, but for corridors."""
    outer = [k for k in rng.permutation(4) if thick[k] == OUTER]
    for n, k in enumerate(outer):
        if n == 0 or rng.random() < 0.5:
            wall = walls_of(room)[k]
            holes[k] += window_in(rng, wall, room.kind, holes[k])


def _doors(rng: np.random.Generator, tiling: Tiling, rooms: list[Room]) -> list[Door]:
    """Where the doors go: of several draws the first whose circle is long enough, else the longest."""
    best: list[Door] = []
    longest = -1.0
    for _ in range(60):
        doors = [_door(rng, rooms, *link) for link in tiling.links]
        length = circle(doors[: tiling.ring])
        if length > longest and _apart(doors):
            best, longest = doors, length
        if longest >= ROUND_TRIP_M:
            break
    return best


def circle(doors: list[Door]) -> float:
    """Length of the closed way through the middles of doors in this order [m]."""
    middles = [door.centre for door in doors]
    return float(sum(np.linalg.norm(b - a) for a, b in pairwise([*middles, middles[0]])))


def _apart(doors: list[Door]) -> bool:
    """Whether no two doors open onto the same spot: round a corner, their free floors would overlap."""
    return all(np.linalg.norm(a.centre - b.centre) > 1.0 for k, a in enumerate(doors) for b in doors[:k])


def _door(rng: np.random.Generator, rooms: list[Room], i: int, j: int, kind: str) -> Door:
    """A door somewhere in the wall that two rooms share."""
    a, b = rooms[i], rooms[j]
    low, high = np.maximum(a.low, b.low), np.minimum(a.high, b.high)
    axis = int(np.argmax(high - low))
    width = rng.uniform(0.78, 0.88) if kind == OPEN else rng.uniform(1.1, 1.7)
    reach = high[axis] - low[axis]
    width = min(width, reach - 0.5)
    centre = (low + high) / 2
    centre[axis] += rng.choice([-1, 1, rng.uniform(-1, 1)]) * (reach / 2 - width / 2 - rng.uniform(0.15, 0.3))
    normal = np.zeros(2)
    normal[1 - axis] = np.sign(((b.low + b.high) - (a.low + a.high))[1 - axis])
    return Door(centre, normal, width, (i, j))


def _corridor(rng: np.random.Generator) -> Tiling:
    """A corridor from end to end with rooms on both sides; living room and kitchen are joined as well."""
    north, hall, south = rng.uniform(4.1, 4.8), rng.uniform(1.45, 1.8), rng.uniform(3.5, 4.2)
    living, kitchen, third = rng.uniform(4.7, 5.5), rng.uniform(3.4, 3.9), rng.uniform(3.0, 3.6)
    width = living + kitchen + third
    upper = [("living_room", living), ("kitchen", kitchen), (_spare(rng), third)]
    bath = rng.uniform(2.4, 2.9)
    bed = rng.uniform(0.45, 0.55) * (width - bath)
    lower = [("bedroom", bed), ("bathroom", bath), (_spare(rng), width - bath - bed)]
    if rng.random() < 0.5:
        lower = lower[::-1]
    tiles = [("corridor", 0.0, south, width, south + hall)]
    for row, y0, y1 in ((upper, south + hall, south + hall + north), (lower, 0.0, south)):
        x = 0.0
        for n, (kind, w) in enumerate(row):
            end = width if n == len(row) - 1 else x + w
            tiles.append((kind, x, y0, end, y1))
            x = end
    links = [(0, 1, OPEN), (1, 2, WAY if rng.random() < 0.6 else OPEN), (2, 0, OPEN)]
    if rng.random() < 0.5:  # the circle takes in the third room
        links = [*links[:2], (2, 3, OPEN), (3, 0, OPEN)]
        return Tiling(tiles, [*links, *[(0, k, OPEN) for k in (4, 5, 6)]], 4)
    return Tiling(tiles, [*links, *[(0, k, OPEN) for k in (3, 4, 5, 6)]], 3)


def _pinwheel(rng: np.random.Generator) -> Tiling:
    """Four rooms in a ring around a bathroom."""
    width, deep = rng.uniform(9.2, 10.0), rng.uniform(9.4, 10.0)
    south, north = rng.uniform(4.2, 4.6), rng.uniform(3.3, 3.6)
    east, west = rng.uniform(3.3, 3.7), rng.uniform(3.3, 3.6)
    tiles = [
        ("living_room", 0.0, 0.0, width - east, south),
        ("kitchen", width - east, 0.0, width, deep - north),
        (_spare(rng), west, deep - north, width, deep),
        ("bedroom", 0.0, south, west, deep),
        ("bathroom", west, south, width - east, deep - north),
    ]
    links = [(0, 1, WAY if rng.random() < 0.6 else OPEN), (1, 2, OPEN), (2, 3, OPEN), (3, 0, OPEN)]
    return Tiling(tiles, [*links, (int(rng.choice([2, 3])), 4, OPEN)], 4)


def _square(rng: np.random.Generator) -> Tiling:
    """Two by two rooms, each joined to the next, one of them with a bathroom."""
    west, east, bath = rng.uniform(4.8, 5.4), rng.uniform(4.0, 4.6), rng.uniform(2.3, 2.8)
    south, north = rng.uniform(4.2, 4.8), rng.uniform(4.0, 4.6)
    width, deep = west + east + bath, south + north
    tiles = [
        ("living_room", 0.0, 0.0, west, south),
        ("kitchen", west, 0.0, width - bath * 0.6, south),
        (_spare(rng), west, south, west + east, deep),
        ("bedroom", 0.0, south, west, deep),
        ("bathroom", west + east, south, width, deep),
        ("corridor", width - bath * 0.6, 0.0, width, south),
    ]
    links = [(0, 1, WAY if rng.random() < 0.6 else OPEN), (1, 2, OPEN), (2, 3, OPEN), (3, 0, OPEN)]
    return Tiling(tiles, [*links, (2, 4, OPEN), (1, 5, OPEN)], 4)


def _spare(rng: np.random.Generator) -> str:
    return str(rng.choice(["office", "bedroom"]))
