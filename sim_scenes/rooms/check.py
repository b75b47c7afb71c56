"""Is a scene fit for use? Nothing reaches into anything else, all stands in its room, one can walk through."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo fills its module at run time.)

import mujoco
import numpy as np
from scipy.spatial import ConvexHull

from dsmap.sim_scenes.physics.colliders import add_geoms, colliders_of
from dsmap.sim_scenes.rooms.layout import FLAT
from dsmap.sim_scenes.scene import Piece, Scene
from dsmap.sim_scenes.space.walkable import Walkable

_DEEP = 0.005
"""Pieces that reach further than this into each other interpenetrate [m]."""
TALL = 1.9
"""What hangs higher than this is walked under [m]."""
_BARE = ("floor", "ceiling", "wall", "window")


def check_scene(scene: Scene) -> list[str]:
    """What is wrong with a scene, a sentence each: empty where it is sound."""
    return [*interpenetrations(scene), *strays(scene), *blocked_ways(scene)]


def interpenetrations(scene: Scene) -> list[str]:
    """Pairs of pieces (furniture, settled things, doors, walls) more than `_DEEP` inside each other."""
    return [
        f"{scene.pieces[a].name} (piece {a}) and {scene.pieces[b].name} (piece {b}) overlap by {1000 * deep:.1f} mm"
        for a, b, deep in overlaps(scene)
    ]


def overlaps(scene: Scene) -> list[tuple[int, int, float]]:
    """Indices of two pieces and how deep one is in the other [m], where that is more than `_DEEP`."""
    spec = mujoco.MjSpec()
    owners = []
    for index, piece in enumerate(scene.pieces):
        colliders = [c.moved(piece.T_world_piece) for c in colliders_of(piece.assembly)]
        body = spec.worldbody
        if piece.assembly.label not in _BARE:
            body = spec.worldbody.add_body()
            body.add_freejoint()
        add_geoms(spec, body, colliders, f"p{index}", density=100.0)
        owners += [(index, piece.assembly.label in _BARE)] * len(colliders)
    # Geoms are compiled body by body, the world's first.
    owner = np.array([i for i, bare in owners if bare] + [i for i, bare in owners if not bare])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_collision(model, data)
    worst: dict[tuple[int, int], float] = {}
    for (one, two), distance in zip(data.contact.geom, data.contact.dist, strict=True):
        a, b = sorted((int(owner[one]), int(owner[two])))
        if -distance > _DEEP:
            worst[a, b] = max(worst.get((a, b), 0.0), -float(distance))
    return [(a, b, deep) for (a, b), deep in sorted(worst.items())]


def world_bounds(piece: Piece) -> np.ndarray:
    """Lowest and highest corner of a piece in the world [m], shape (2, 3)."""
    T = piece.T_world_piece
    points = np.concatenate([shape.vertices for shape, *_ in piece.assembly.parts]) @ T[:3, :3].T + T[:3, 3]
    return np.array([points.min(0), points.max(0)])


def strays(scene: Scene) -> list[str]:
    """Pieces that reach out of their room."""
    found = []
    for index, piece in enumerate(scene.pieces):
        if piece.assembly.label in _BARE or not scene.rooms:
            continue
        room, (low, high) = scene.rooms[piece.room], world_bounds(piece)
        out = max((room.low - low[:2]).max(), (high[:2] - room.high).max(), -low[2], high[2] - room.height)
        if out > _DEEP:
            found.append(f"{piece.name} (piece {index}) reaches {1000 * out:.0f} mm out of room {piece.room}")
    return found


def blocked_ways(scene: Scene) -> list[str]:
    """Rooms whose doors are not joined by a way as wide as a walker, from the furniture as it stands."""
    found = []
    for k, room in enumerate(scene.rooms):
        floor = Walkable(room.low, room.high)
        for door in scene.doors:
            if k in door.rooms:
                inward = door.normal if k == door.rooms[1] else -door.normal
                floor.anchors.append(door.centre + inward * (0.5 + 0.06))
        for piece in scene.pieces:
            if piece.room != k or (piece.assembly.label in _BARE and piece.name != "door_leaf"):
                continue
            low, high = world_bounds(piece)
            if high[2] < FLAT or low[2] > TALL:
                continue
            for collider in colliders_of(piece.assembly):
                corners = collider.moved(piece.T_world_piece).corners()
                if corners[:, 2].max() > FLAT and corners[:, 2].min() < TALL:
                    floor.block(corners[ConvexHull(corners[:, :2]).vertices, :2])
        if floor.way() is None:
            found.append(f"room {k} ({room.kind}): furniture bars the way between its doors")
    return found
