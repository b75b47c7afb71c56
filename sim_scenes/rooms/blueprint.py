"""Plans without furniture: rooms, the holes in their walls and how thick these are."""

from dataclasses import dataclass, field

import numpy as np

from dsmap.sim_scenes.rooms.layout import Layout, Wall, walls_of
from dsmap.sim_scenes.rooms.openings import CLOSED, WINDOW, Opening
from dsmap.sim_scenes.scene import Door, Room

OUTER, INNER = 0.16, 0.06
"""Thickness of an outer wall and of one room's half of a wall between rooms [m]."""


SILLS = {"bathroom": (1.2, (0.6, 0.95)), "corridor": (1.0, (0.6, 0.95)), "kitchen": (1.06, (0.9, 1.5))}
"""Room kind to the height of window sills and the range of window widths, where it differs [m]."""


@dataclass
class Blueprint:
    """What is built before furniture comes."""

    rooms: list[Room]
    doors: list[Door] = field(default_factory=list)
    holes: list[list[list[Opening]]] = field(default_factory=list)
    """By room and wall (in the order of `layout.walls_of`)."""
    thickness: list[list[float]] = field(default_factory=list)
    """By room and wall [m]."""
    bare: set[int] = field(default_factory=set)
    """Rooms without furniture and pictures."""

    def apply(self, layout: Layout) -> list[list[Opening]]:
        """Make the walls of a room's layout as thick as planned; returns their holes."""
        for wall, thick in zip(layout.walls, self.thickness[layout.index], strict=True):
            wall.thickness = thick
        return self.holes[layout.index]


def door_in(rng: np.random.Generator, wall: Wall) -> Opening:
    """A closed door near one end of a wall, as the only door of a room."""
    width, height = rng.uniform(0.8, 0.92), rng.uniform(2.0, 2.08)
    x = rng.choice([-1, 1]) * max(0.0, wall.length / 2 - width / 2 - rng.uniform(0.2, 0.5))
    return Opening(x - width / 2, x + width / 2, 0.0, height, CLOSED)


def window_in(rng: np.random.Generator, wall: Wall, kind: str, others: list[Opening]) -> list[Opening]:
    """A window somewhere in a wall of a kind of room; nothing where its doors leave no room for one."""
    sill, widths = SILLS.get(kind, (0.85, (1.2, 1.9)))
    low, high = sill + rng.uniform(0.0, 0.15), min(rng.uniform(2.05, 2.25), wall.height - 0.28)
    width = min(rng.uniform(*widths), wall.length - 0.8)
    for _ in range(8):
        x = rng.uniform(-1, 1) * max(0.0, wall.length / 2 - width / 2 - 0.45)
        hole = Opening(x - width / 2, x + width / 2, low, high, WINDOW)
        if width > 0.5 and all(hole.x1 + 0.3 < o.x0 or o.x1 + 0.3 < hole.x0 for o in others):
            return [hole]
    return []


def single(rng: np.random.Generator, kind: str, size: np.ndarray) -> Blueprint:
    """One room of inner `size` (3,) about the origin: a closed door in one wall, windows in one or two others."""
    room = Room(kind, -size[:2] / 2, size[:2] / 2, float(size[2]))
    walls = walls_of(room)
    holes: list[list[Opening]] = [[], [], [], []]
    order = rng.permutation(4)
    if kind == "corridor":  # long walls get doors, windows are where a corridor ends
        longest = int(np.argmax([w.length for w in walls[:2]]))
        order = np.array([longest, longest + 1, (longest + 3) % 4, (longest + 2) % 4])
        holes[order[3]] = [door_in(rng, walls[order[3]])]
    holes[order[0]] = [door_in(rng, walls[order[0]])]
    for k in order[1 : 2 + int(rng.random() < 0.35)]:
        holes[k] = window_in(rng, walls[k], kind, [])
    return Blueprint([room], [], [holes], [[OUTER] * 4])
