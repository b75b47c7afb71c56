"""How the things of a map stand to each other: what carries what, what is next to what, in which room."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy import ndimage
from scipy.spatial import KDTree

from dsmap.classes import CLASS_NAMES
from dsmap.fusion.objects.boxes import upright_axes
from dsmap.fusion.objects.things import Plane, SceneObjects, Thing

RelationKind = Literal["supports", "on", "next to", "part of"]
_REACH = 0.08
"""What carries a thing begins within this of its lowest cells [m]..."""
_BELOW, _ABOVE = 0.08, 0.03
"""... no further below their height than the one, or above it than the other [m]."""
_BOTTOM = 0.05
"""The lowest cells of a thing: up to this above its lowest point [m]."""
_FACES_UP = 0.7
_ON_FLOOR = 0.25
"""A thing without visible support stands on the floor if it begins within this of it [m]: its feet were not seen."""
_HANGS = 0.15
"""A thing without support hangs on a wall that is within this [m]."""
_NEXT_TO = 0.3
"""[m]"""
_CARRIES_NOTHING = ("wall", "ceiling", "window")
_GRID, _DOORWAY, _LEAST_ROOM = 0.1, 1.1, 2.0
"""Floor plan: squares [m]; ways narrower than this [m] part rooms; smaller ones [m^2] are none."""


@dataclass(frozen=True)
class Relation:
    """One edge of the scene graph."""

    subject: int
    """Id of a thing or plane."""
    kind: RelationKind
    object: int
    """Id of a thing or plane."""


@dataclass(frozen=True)
class FoundRoom:
    """A part of the floor, and what is above it."""

    id: int
    centre: np.ndarray
    """On the floor [m], world frame, shape (3,)."""
    area: float
    """Floor that was seen or stood upon [m^2]."""
    members: list[int]
    """Ids of its things and planes."""


def find_relations(scene: SceneObjects) -> list[Relation]:
    """Supports (and on, its inverse), next to, part of; sorted by subject."""
    carriers = {thing.id: _carrier(scene, thing) for thing in scene.things}
    relations = []
    for thing, carrier in carriers.items():
        if carrier is not None:
            relations.append(Relation(thing, "on", carrier))
            if not _is_upright(scene, carrier):
                relations.append(Relation(carrier, "supports", thing))
    relations += _next_to(scene, carriers)
    walls = [plane for plane in scene.planes if CLASS_NAMES[plane.label] == "wall"]
    for window in (plane for plane in scene.planes if CLASS_NAMES[plane.label] == "window"):
        middle = window.corners.mean(axis=0)
        near = [
            w
            for w in walls
            if abs(w.normal @ window.normal) > 0.9 and abs(w.normal @ middle - w.offset) < 0.4
        ]
        if near:
            wall = min(near, key=lambda w: float(np.linalg.norm(w.corners.mean(axis=0) - middle)))
            relations.append(Relation(window.id, "part of", wall.id))
    return sorted(relations, key=lambda r: (r.subject, r.kind, r.object))


def find_rooms(scene: SceneObjects) -> list[FoundRoom]:
    """Rooms: parts of the ground that only narrow ways, such as doors, join. Without a floor there are none."""
    axes = upright_axes(scene.up)
    ground = [plane for plane in scene.planes if CLASS_NAMES[plane.label] == "floor"]
    if not ground:
        return []
    level = scene.cells.position @ axes.T
    floor = ground[0].offset * float(ground[0].normal @ scene.up)
    wall_ids = [plane.id for plane in scene.planes if CLASS_NAMES[plane.label] == "wall"]
    low = level[:, :2].min(axis=0) - 5 * _GRID
    shape = np.ceil((level[:, :2].max(axis=0) - low) / _GRID).astype(int) + 5
    at = ((level[:, :2] - low) / _GRID).astype(int)
    free, walls = np.zeros(shape, bool), np.zeros(shape, bool)
    is_wall = np.isin(scene.owner, wall_ids)
    stands = ~is_wall & (level[:, 2] < floor + 1.0)
    free[tuple(at[stands].T)] = True
    walls[tuple(at[is_wall & (level[:, 2] > floor + 0.3)].T)] = True
    free = ndimage.binary_closing(free, iterations=2) & ~walls
    depth = np.asarray(ndimage.distance_transform_edt(free)) * _GRID
    cores, count = _regions(depth > _DOORWAY / 2)
    if count == 0:
        cores, count = _regions(free)
    found = ndimage.distance_transform_edt(cores == 0, return_distances=False, return_indices=True)
    nearest = tuple(np.asarray(found))
    number = np.where(free, cores[nearest], 0)
    rooms, members = [], _members(scene, axes, low, cores[nearest])
    for k in np.argsort(-np.bincount(number.ravel(), minlength=count + 1)[1:], kind="stable") + 1:
        area = float((number == k).sum() * _GRID**2)
        if area < _LEAST_ROOM and rooms:
            continue
        middle = (np.argwhere(number == k).mean(axis=0) + 0.5) * _GRID + low
        rooms.append(
            FoundRoom(len(rooms) + 1, np.array([*middle, floor]) @ axes, area, members.get(int(k), []))
        )
    return rooms


def _regions(free: np.ndarray) -> tuple[np.ndarray, int]:
    """Number of each cell's connected region, from 1, 0 where it is not free; and how many regions there are."""
    found = np.zeros(free.shape, np.int32)
    count: Any = ndimage.label(free, output=found)  # with an output array it is only the number
    return found, int(count)


def _members(
    scene: SceneObjects, axes: np.ndarray, low: np.ndarray, number: np.ndarray
) -> dict[int, list[int]]:
    """Ids of things and planes by the number of the room that their middle is in."""
    members: dict[int, list[int]] = {}
    for one in (*scene.things, *scene.planes):
        inwards = 0.2 * one.normal if isinstance(one, Plane) else 0.0
        middle = one.centroid if isinstance(one, Thing) else one.corners.mean(axis=0) + inwards
        x, y = np.clip(((axes[:2] @ middle - low) / _GRID).astype(int), 0, np.array(number.shape) - 1)
        members.setdefault(int(number[x, y]), []).append(one.id)
    return members


def _carrier(scene: SceneObjects, thing: Thing) -> int | None:
    """What a thing stands on or hangs on, by the cells below its lowest ones; None where nothing is near."""
    up, position = scene.up, scene.cells.position
    heights = position @ up
    own = scene.owner == thing.id
    lowest = np.percentile(heights[own], 1)
    bottom = position[own & (heights < lowest + _BOTTOM)]
    unable = [p.id for p in scene.planes if CLASS_NAMES[p.label] in _CARRIES_NOTHING]
    others = np.flatnonzero(
        (scene.owner > 0) & ~own & ~np.isin(scene.owner, unable) & (scene.cells.normal @ up > _FACES_UP)
        & (heights > lowest - _BELOW) & (heights < lowest + _ABOVE)
    )  # fmt: skip
    if len(others):
        distance, _ = KDTree(bottom).query(position[others], distance_upper_bound=_REACH)
        touching = scene.owner[others[np.isfinite(distance)]]
        if len(touching):
            return int(np.bincount(touching).argmax())
    floors = [p for p in scene.planes if CLASS_NAMES[p.label] == "floor"]
    near = [p for p in floors if abs(lowest - p.offset * float(p.normal @ up)) < _ON_FLOOR]
    if near:
        return near[0].id
    walls = [p for p in scene.planes if CLASS_NAMES[p.label] == "wall"]
    off = [float(np.abs(position[own] @ wall.normal - wall.offset).min()) for wall in walls]
    return walls[int(np.argmin(off))].id if off and min(off) < _HANGS else None


def _is_upright(scene: SceneObjects, number: int) -> bool:
    return any(p.id == number and CLASS_NAMES[p.label] == "wall" for p in scene.planes)


def _next_to(scene: SceneObjects, carriers: dict[int, int | None]) -> list[Relation]:
    """Pairs of things on one carrier whose cells come within _NEXT_TO of each other."""
    trees = {thing.id: KDTree(scene.cells.position[scene.owner == thing.id]) for thing in scene.things}
    found = []
    for a in scene.things:
        for b in scene.things:
            if a.id >= b.id or carriers[a.id] is None or carriers[a.id] != carriers[b.id]:
                continue
            reach = (np.linalg.norm(a.box.extent) + np.linalg.norm(b.box.extent)) / 2 + _NEXT_TO
            if np.linalg.norm(a.box.T_world_box[:3, 3] - b.box.T_world_box[:3, 3]) > reach:
                continue
            small, large = sorted((trees[a.id], trees[b.id]), key=lambda tree: tree.n)
            if small.query(large.data, distance_upper_bound=_NEXT_TO)[0].min() < _NEXT_TO:
                found += [Relation(a.id, "next to", b.id), Relation(b.id, "next to", a.id)]
    return found
