"""A mesh of the map: marching cubes over the surface that the surfels lie on, with colours and labels."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from warp.geometry import IsoSurfaceMarchingCubes

from dsmap.errors import InputError
from dsmap.kernels.surface import UNKNOWN, SurfelPoints, paint_points, surface_distance, surfel_points

MESH_VOXEL_M = 0.01
"""Edge of a voxel by default [m]."""
_REACH = 3.0
"""Surfels up to so many voxels away count."""
_SPREAD = 1.0
"""Standard deviation of their weight, in voxels."""
_BLOCK = 32
"""Voxels along the side of a block."""
_JUMP = 1.15
"""A distance that changes by more than so many edges along an edge is none: two surfaces meet there."""
_BESIDE = 1.5
"""Vertices further from every surfel than so many times its rim lie between two surfaces, not on one."""
_SMALLEST_M2 = 0.002
"""Pieces of less area are noise."""


@dataclass
class SurfaceMesh:
    """Triangles in the world's frame, with what each vertex looks like."""

    vertices: np.ndarray
    """[m], float32, shape (V, 3)."""
    faces: np.ndarray
    """Vertex indices, int32, shape (F, 3), counter-clockwise from the front."""
    normal: np.ndarray
    """Shape (V, 3)."""
    colour: np.ndarray
    """RGB, uint8, shape (V, 3)."""
    label: np.ndarray
    """Class ids, uint8, shape (V,)."""


def surface_of(
    surfels: dict[str, np.ndarray], voxel: float = MESH_VOXEL_M, device: str = "cpu"
) -> SurfaceMesh:
    """The surface of a map; open where nothing was seen.

    Args:
        surfels: arrays by the names of `SurfelMap`.
        voxel: edge of a voxel [m].

    Raises:
        InputError: the map has no surfel, or none that make a surface of this size.
    """
    alive = surfels["weight"] > 0
    kept = {
        name: surfels[name][alive] for name in ("position", "normal", "colour", "weight", "radius", "label")
    }
    if not len(kept["weight"]):
        raise InputError("the map has no surfels, expected some to make a mesh of")
    points = surfel_points(kept, _REACH * voxel, device)
    parts = [_extract(points, block, voxel) for block in _blocks(kept["position"], voxel)]
    vertices, faces = _join([part for part in parts if part is not None])
    vertices *= voxel
    looks = paint_points(points, vertices, _SPREAD * voxel)
    on_surface = looks[3] < _BESIDE
    used, faces = _without_specks(vertices, faces[on_surface[faces].all(axis=1)])
    if not len(faces):
        raise InputError(f"the surfels make no surface of voxels of {voxel} m, expected larger ones")
    normal, colour, label = (array[used] for array in looks[:3])
    rgb = np.rint(colour.clip(0, 1) * 255).astype(np.uint8)
    return SurfaceMesh(vertices[used].astype(np.float32), faces.astype(np.int32), normal, rgb, label)


def _blocks(position: np.ndarray, voxel: float) -> np.ndarray:
    """The blocks that surfels lie in, or so near to that a surface of theirs may, int64, shape (B, 3)."""
    found = []
    for corner in np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3), axis=-1).reshape(-1, 3):
        near = position.astype(np.float64) / voxel + corner
        found.append(np.unique(np.floor(near / _BLOCK).astype(np.int64), axis=0))
    return np.unique(np.concatenate(found), axis=0)


def _extract(points: SurfelPoints, block: np.ndarray, voxel: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Vertices in voxels (float64, exact on the block's sides) and faces of one block; None where it has none."""
    first = block * _BLOCK
    x, y, z = (int(v) for v in first)
    value = surface_distance(points, (x, y, z), _BLOCK + 1, voxel, _SPREAD * voxel)
    known = value < UNKNOWN
    if not (known & (value < 0)).any() or not (known & (value >= 0)).any():
        return None
    field = np.where(known, value, np.float32(voxel))
    grid: Any = wp.array(field, dtype=wp.float32, device="cpu")  # Warp's stubs want its rank in its type
    vertices, indices = IsoSurfaceMarchingCubes.extract(grid)
    corners = np.asarray(vertices.numpy(), np.float64)
    faces = np.asarray(indices.numpy(), np.int32).reshape(-1, 3)
    if not len(faces):
        return None
    cell = np.floor(corners[faces].mean(axis=1)).astype(int).clip(0, _BLOCK - 1)
    faces = faces[_whole(value, known, voxel)[cell[:, 0], cell[:, 1], cell[:, 2]]]
    return (corners + first, faces) if len(faces) else None


def _whole(value: np.ndarray, known: np.ndarray, voxel: float) -> np.ndarray:
    """Voxels whose corners all have a distance, without a jump between two of them, bool."""
    highest = np.full([_BLOCK] * 3, -np.inf)
    lowest = np.full([_BLOCK] * 3, np.inf)
    whole = np.ones([_BLOCK] * 3, bool)
    for i, j, k in np.ndindex(2, 2, 2):
        part = np.s_[i : i + _BLOCK, j : j + _BLOCK, k : k + _BLOCK]
        whole &= known[part]
        highest = np.maximum(highest, value[part])
        lowest = np.minimum(lowest, value[part])
    # Across a voxel's diagonal a distance changes by sqrt(3) edges at most.
    return whole & (highest - lowest < _JUMP * np.sqrt(3) * voxel)


def _join(parts: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """One mesh of all blocks' meshes: vertices on the sides of two blocks are equal, and become one."""
    if not parts:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts[:-1])])
    vertices = np.concatenate([v for v, _ in parts])
    faces = np.concatenate([f + start for (_, f), start in zip(parts, starts, strict=True)])
    vertices, inverse = np.unique(vertices, axis=0, return_inverse=True)
    return vertices, inverse.reshape(-1)[faces]


def _without_specks(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices that are in use, and the faces with their new numbers: without faces of no area, and without pieces
    smaller than _SMALLEST_M2."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    distinct = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    faces, area = faces[distinct], area[distinct]
    if len(faces):
        ends = np.concatenate([faces[:, :2], faces[:, 1:]])
        graph = coo_array((np.ones(len(ends), bool), ends.T), shape=(len(vertices),) * 2)
        piece = connected_components(graph, directed=False)[1][faces[:, 0]]
        faces = faces[np.bincount(piece, weights=area)[piece] >= _SMALLEST_M2]
    used, renumbered = np.unique(faces, return_inverse=True)
    return used, renumbered.reshape(-1, 3)
