"""Signs of life: which small things are dropped where in a furnished room, and how many."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dsmap.sim_scenes.geometry.shapes import rotation_x, rotation_z
from dsmap.sim_scenes.physics.colliders import colliders_of
from dsmap.sim_scenes.physics.settle import LooseThing, settle
from dsmap.sim_scenes.pieces import clutter
from dsmap.sim_scenes.rooms.layout import Block, Layout
from dsmap.sim_scenes.scene import Assembly, Piece, TopArea
from dsmap.sim_scenes.textures.palette import Looks

EYE = 1.2
"""Things higher than this are not looked at: one would mostly see the ceiling [m]."""
ABOVE = 0.008
"""Things start this far above what they fall on [m]."""
DENSITY = {
    "desk": 9.0, "table": 6.0, "living": 8.0, "shelf": 9.0, "kitchen": 9.0, "bath": 14.0, "bedside": 16.0, "bed": 1.6,
    "hall": 8.0,
}  # fmt: skip
"""Things a square metre of surface, by place (a key of `clutter.PLACES`)."""
PLACE_OF = {
    "desk": "desk", "corner_desk": "desk", "standing_desk": "desk", "coffee_table": "living", "side_table": "living",
    "dining_table": "table", "round_table": "table", "table": "table", "nightstand": "bedside", "sofa": "bed",
    "corner_sofa": "bed", "armchair": "bed", "day_bed": "bed", "bed": "bed", "bunk_bed": "bed", "base_units": "kitchen",
    "island": "kitchen", "kitchen_shelf": "kitchen", "washbasin": "bath", "console_table": "hall",
    "hall_bench": "hall", "shoe_rack": "hall",
}  # fmt: skip
"""Pieces to the place they are; for others it depends on the room, and most are shelves."""
_ROOM_PLACE = {"kitchen": "kitchen", "bathroom": "bath"}
ON_FLOOR = {
    "living_room": ("floor", 3, 10), "bedroom": ("floor", 3, 9), "office": ("floor", 2, 7), "kitchen": ("hall", 1, 4),
    "bathroom": ("bath", 0, 3), "corridor": ("hall", 1, 6),
}  # fmt: skip
"""Room kind to what lies on its floor: place, least and largest number."""
PILED = (
    "one_book",
    "stack_of_books",
    "magazine_stack",
    "open_book",
    "carton",
    "folded_clothes",
    "towel_stack",
    "remote",
)
"""Things that lie on others."""


@dataclass
class _Drop:
    """Things that fall onto one piece of furniture (or the floor)."""

    things: list[LooseThing] = field(default_factory=list)
    boxes: list[np.ndarray] = field(default_factory=list)
    """World bounds at the start, each (2, 3)."""

    def add(self, thing: Assembly, T: np.ndarray, support: float) -> None:
        self.things.append(LooseThing(thing, T, support))
        self.boxes.append(_bounds(thing, T))


def strew(rng: np.random.Generator, looks: Looks, layout: Layout, tidy: float) -> int:
    """Drop things onto furniture and floor of a room and add those that come to rest; returns their number.

    Args:
        tidy: 0 = cluttered .. 1 = bare.
    """
    scene = layout.scene
    pieces = [p for p in scene.pieces if p.room == layout.index]
    static = [c.moved(p.T_world_piece) for p in pieces for c in colliders_of(p.assembly)]
    corners = [c.corners() for c in static]
    bounds = np.array([[c.min(0), c.max(0)] for c in corners])
    drops = [
        _on_piece(rng, looks, piece, layout.room.kind, 1 - tidy)
        for piece in pieces
        if piece.assembly.label not in ("wall", "window")
    ]
    drops.append(_on_floor(rng, looks, layout, 1 - tidy))
    count = 0
    for drop in drops:
        if not drop.things:
            continue
        low = np.min([b[0] for b in drop.boxes], axis=0) - 0.15
        high = np.max([b[1] for b in drop.boxes], axis=0) + 0.1
        near = ((bounds[:, 1] > low) & (bounds[:, 0] < high)).all(1)
        for thing, pose in zip(
            drop.things, settle(drop.things, [c for c, n in zip(static, near, strict=True) if n]), strict=True
        ):
            if pose is not None:
                scene.put(thing.assembly, pose, room=layout.index)
                if pose[2, 3] < EYE:
                    scene.targets.append(pose[:3, 3] + [0.0, 0.0, 0.1])
                count += 1
    return count


def _bounds(thing: Assembly, T: np.ndarray) -> np.ndarray:
    points = np.concatenate([shape.vertices for shape, *_ in thing.parts]) @ T[:3, :3].T + T[:3, 3]
    return np.array([points.min(0), points.max(0)])


def _on_piece(rng: np.random.Generator, looks: Looks, piece: Piece, kind: str, much: float) -> _Drop:
    """Things for the surfaces of one piece of furniture in a kind of room."""
    drop = _Drop()
    place = PLACE_OF.get(piece.name, _ROOM_PLACE.get(kind, "shelf"))
    surfaces = piece.assembly.surfaces or (_seats(piece) if place == "bed" else [])
    taken = [shape.bounds() for shape, *_ in piece.assembly.parts] if surfaces else []
    for x0, y0, x1, y1, z in surfaces:
        for _ in range(int(rng.poisson(much * DENSITY[place] * (x1 - x0) * (y1 - y0)))):
            thing = clutter.pick(rng, looks, place)
            for _ in range(6):
                T = _local(rng, thing, (x0, y0, x1, y1, z), taken, piled=thing.name in PILED)
                if T is not None:
                    taken.append(_bounds(thing, T))
                    drop.add(thing, piece.T_world_piece @ T, float(piece.T_world_piece[2, 3] + z))
                    break
    return drop


def _local(
    rng: np.random.Generator,
    thing: Assembly,
    surface: tuple[float, float, float, float, float],
    taken: Sequence[np.ndarray],
    piled: bool,
) -> np.ndarray | None:
    """A pose just above a surface (or what lies there), off everything, in the frame of the surface."""
    x0, y0, x1, y1, z = surface
    T = np.eye(4)
    T[:3, :3] = rotation_z(rng.uniform(-np.pi, np.pi)) @ rotation_x(rng.uniform(-0.04, 0.04))
    box = _bounds(thing, T)
    low, high = np.array([x0, y0]) - box[0, :2], np.array([x1, y1]) - box[1, :2]
    if (low > high).any():
        return None
    T[:2, 3] = rng.uniform(low, high)
    T[2, 3] = z + ABOVE - box[0, 2]
    for _ in range(2):
        box = _bounds(thing, T)
        met = [t for t in taken if (t[1] > box[0] - 0.003).all() and (t[0] < box[1] + 0.003).all()]
        if not met:
            return T
        top = max(float(t[1, 2]) for t in met)
        if not piled or top > z + 0.14:
            return None
        T[2, 3] += top + ABOVE - box[0, 2]
    return None


def _seats(piece: Piece) -> list[TopArea]:
    """Where one may sit or lie on a sofa or bed without surfaces of its own: the flat part between its arms."""
    low, high = piece.assembly.bounds()
    inner = 0.2 * (high - low)
    tops = [b[1, 2] for b in (shape.bounds() for shape, *_ in piece.assembly.parts) if 0.3 < b[1, 2] < 0.7]
    if not tops:
        return []
    return [(low[0] + inner[0], low[1] + 0.05, high[0] - inner[0], high[1] - 1.6 * inner[1], max(tops))]


def _on_floor(rng: np.random.Generator, looks: Looks, layout: Layout, much: float) -> _Drop:
    """Things on the floor, mostly beside furniture and along walls, never in the way."""
    place, least, most = ON_FLOOR[layout.room.kind]
    drop = _Drop()
    for _ in range(round(much * int(rng.integers(least, most + 1)))):
        thing = clutter.pick(rng, looks, place)
        for _ in range(20):
            xy = rng.uniform(layout.room.low + 0.15, layout.room.high - 0.15)
            yaw = rng.uniform(-np.pi, np.pi)
            block: Block = layout.block(thing, xy, yaw)
            if layout.fits(block, 0.04) and layout.floor.stays_open([block.corners]):
                layout.taken.append(block)
                layout.floor.block(block.corners)
                T = np.eye(4)
                T[:3, :3], T[:3, 3] = rotation_z(yaw), (*xy, ABOVE + 0.004)
                drop.add(thing, T, 0.0)
                break
    return drop
