"""Convex bodies for physics: every connected piece of every mesh as a box where it is one, else as its hull."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo fills its module at run time.)

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import mujoco
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from dsmap.sim_scenes.geometry.shapes import Shape
from dsmap.sim_scenes.scene import Assembly

BOXY = 0.9
"""A mesh that fills this share of its own turned bounding box collides as that box."""
THIN = 0.002
"""Least size of a collider [m]."""
_NEXT, _AFTER = [1, 2, 0], [2, 0, 1]
_KNOWN: "WeakKeyDictionary[Assembly, tuple[int, list[Collider]]]" = WeakKeyDictionary()
"""Colliders of assemblies and the number of parts they are of."""


@dataclass(frozen=True)
class Collider:
    """A convex body in its assembly's frame: a turned box, or the hull of points (with a box around it)."""

    centre: np.ndarray
    """Of the box, shape (3,)."""
    rotation: np.ndarray
    """Shape (3, 3): columns are the box's axes."""
    half: np.ndarray
    """Half sizes along the axes, shape (3,)."""
    hull: np.ndarray | None
    """Points [m], shape (N, 3); None = it is the box itself."""

    def corners(self) -> np.ndarray:
        """Points whose hull holds the body, shape (N, 3)."""
        if self.hull is not None:
            return self.hull
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).T.reshape(-1, 3)
        return self.centre + (signs * self.half) @ self.rotation.T

    def moved(self, T: np.ndarray) -> "Collider":
        """As seen from where `T` (4, 4) takes its frame."""
        turn, shift = T[:3, :3], T[:3, 3]
        hull = None if self.hull is None else self.hull @ turn.T + shift
        return Collider(turn @ self.centre + shift, turn @ self.rotation, self.half, hull)


def colliders_of(assembly: Assembly) -> list[Collider]:
    """The colliders of an assembly with all that stands on it, in its frame; worked out once."""
    count, found = _KNOWN.get(assembly, (0, []))
    if count < len(assembly.parts):  # parts are only ever added
        found = [*found, *(c for shape, *_ in assembly.parts[count:] for c in _of_shape(shape))]
        _KNOWN[assembly] = (len(assembly.parts), found)
    return found


def hull_of(assembly: Assembly) -> Collider:
    """One collider for a small thing."""
    found = colliders_of(assembly)
    if len(found) == 1:
        return found[0]
    points = np.concatenate([c.corners() for c in found])
    low, high = points.min(0), points.max(0)
    return Collider((low + high) / 2, np.eye(3), (high - low) / 2, points)


def _of_shape(shape: Shape) -> list[Collider]:
    """One collider for each connected piece of a mesh (whose faces need not be welded)."""
    keys = np.round(shape.vertices * 1e4).astype(np.int64)
    _, first, weld = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    faces, points = weld.ravel()[shape.faces], shape.vertices[first]
    if len(points) <= 8:
        return [_convex(points, faces)]
    edges = np.concatenate([faces[:, :2], faces[:, 1:]])
    graph = coo_matrix((np.ones(len(edges)), edges.T), shape=(len(points), len(points)))
    count, owner = connected_components(graph, directed=False)
    if count == 1:
        return [_convex(points, faces)]
    found = []
    for k in range(count):
        own = np.flatnonzero(owner == k)
        if len(own) >= 4:
            number = np.full(len(points), -1)
            number[own] = np.arange(len(own))
            found.append(_convex(points[own], number[faces[owner[faces[:, 0]] == k]]))
    return found


def _convex(points: np.ndarray, faces: np.ndarray) -> Collider:
    """Box or hull of one closed mesh."""
    a, b, c = points[faces].transpose(1, 0, 2)
    u, v = b - a, c - a
    cross = u[:, _NEXT] * v[:, _AFTER] - u[:, _AFTER] * v[:, _NEXT]  # np.cross costs four times as much
    area = np.linalg.norm(cross, axis=1)
    normal = cross / np.maximum(area, 1e-15)[:, None]
    first = normal[int(np.argmax(area))]
    aside = np.where(np.abs(normal @ first) < 0.02, area, 0.0)
    across = normal[int(np.argmax(aside))] if aside.max() > 0 else np.eye(3)[int(np.argmin(np.abs(first)))]
    second = across - (across @ first) * first
    second /= np.linalg.norm(second)
    rotation = np.stack([first, second, np.cross(first, second)], 1)
    along = points @ rotation
    low, high = along.min(0), along.max(0)
    half = np.maximum((high - low) / 2, THIN / 2)
    volume = float(np.einsum("ij,ij->i", a - points[0], cross).sum()) / 6
    centre = rotation @ ((low + high) / 2)
    boxy = volume > BOXY * 8 * float(np.prod(half)) or (high - low).min() < THIN
    return Collider(centre, rotation, half, None if boxy else points)


def add_geoms(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, colliders: Sequence[Collider], name: str, **options: object
) -> None:
    """Give a body of a MuJoCo specification these colliders as geoms; hulls become meshes called after `name`."""
    for k, collider in enumerate(colliders):
        if collider.hull is None:
            quaternion = np.empty(4)
            mujoco.mju_mat2Quat(quaternion, _right_handed(collider.rotation).ravel())
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=collider.half,
                pos=collider.centre,
                quat=quaternion,
                **options,
            )
            continue
        spec.add_mesh(
            name=f"{name}_{k}",
            uservert=collider.hull.astype(np.float32).ravel(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX,
            maxhullvert=200,
        )
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"{name}_{k}", **options)


def _right_handed(rotation: np.ndarray) -> np.ndarray:
    return rotation * np.array([1, 1, np.sign(np.linalg.det(rotation))])


def touch(some: Sequence[Collider], others: Sequence[Collider], gap: float) -> bool:
    """Whether any two boxes around colliders come nearer than `gap` [m] (separating axes; errs towards yes)."""
    if not some or not others:
        return False
    reach = [np.array([c.half for c in group]) + gap / 2 for group in (some, others)]
    turn = [np.array([c.rotation for c in group]) for group in (some, others)]
    middle = [np.array([c.centre for c in group]) for group in (some, others)]
    between = middle[1][None] - middle[0][:, None]  # (A, B, 3)
    shape = (len(some), len(others), 3, 3)
    a = np.broadcast_to(turn[0].transpose(0, 2, 1)[:, None], shape)
    b = np.broadcast_to(turn[1].transpose(0, 2, 1)[None], shape)
    cross = np.cross(a[:, :, :, None], b[:, :, None]).reshape(*shape[:2], 9, 3)
    length = np.linalg.norm(cross, axis=-1, keepdims=True)
    cross = np.where(length > 1e-3, cross / np.maximum(length, 1e-3), a[:, :, :1])
    axes = np.concatenate([a, b, cross], 2)  # (A, B, 15, 3)
    spread = np.abs(np.einsum("abki,abji->abkj", axes, a)) @ reach[0][:, None, :, None]
    spread = spread + np.abs(np.einsum("abki,abji->abkj", axes, b)) @ reach[1][None, :, :, None]
    apart = np.abs(np.einsum("abki,abi->abk", axes, between)) > spread[..., 0]
    return bool((~apart.any(2)).any())
