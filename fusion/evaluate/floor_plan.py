"""How good the floor plan is that a map gives, against the recording's mesh."""

from typing import Any

import numpy as np

from dsmap.classes import CLASS_NAMES
from dsmap.errors import InputError
from dsmap.fusion.evaluate.trajectory import back_project
from dsmap.fusion.exports.level import level_transform, transformed
from dsmap.fusion.exports.occupancy import BAND_M, FREE, OCCUPIED, Grid, occupancy_grid
from dsmap.fusion.runs.read_run import SavedRun, evenly_spread
from dsmap.sequences import Sequence
from dsmap.sequences.mesh import MESH_FILE, LabelledMesh, read_mesh

_POINTS_M2 = 10_000
"""Points that stand for a square metre of the mesh."""
_ENOUGH = 2
"""Points of things in a cell from which it is no place to be."""
_FLOOR_M = 0.05
_SEEN_FRAMES = 120
_NAMES = ("free_precision", "free_recall", "occupied_as_free", "free_cells", "occupied_cells")


def evaluate_floor_plan(run: SavedRun, reference: Sequence, alignment: np.ndarray | None) -> dict[str, Any]:
    """Cells of 5 cm that `dsmap export --to occupancy` calls free, against the reference's `mesh.ply`.

    True cells are free where the mesh has floor and nothing between 10 cm and 1.8 m above it.

    free_precision: share of the cells called free that are. free_recall: share of the truly free cells whose floor a
    frame saw, in the run's depth range and by its true labels, which are called free. occupied_as_free: share of the
    truly occupied cells which are called free.

    Args:
        alignment: T_reference_world of the trajectory; None: it cannot be told.
    """
    nothing: dict[str, Any] = dict.fromkeys(_NAMES)
    if alignment is None or not (reference.path / MESH_FILE).exists() or not reference.has_labels:
        return nothing | {"reason": "needs a recording with poses, labels and a mesh.ply"}
    T_level_world = level_transform(run)
    try:
        grid = occupancy_grid(run.surfels.numpy(), T_level_world)
    except InputError as error:
        return nothing | {"reason": str(error)}
    T_level_reference = T_level_world @ np.linalg.inv(alignment)
    things, floor = _true_cells(grid, read_mesh(reference.path / MESH_FILE), T_level_reference)
    truly_free = floor & ~things
    seen = _seen_floor(grid, run, reference, T_level_reference) & truly_free
    free = grid.cells == FREE
    return {
        "free_precision": _share(free & truly_free, free),
        "free_recall": _share(free & seen, seen),
        "occupied_as_free": _share(free & things, things),
        "free_cells": int(free.sum()),
        "occupied_cells": int((grid.cells == OCCUPIED).sum()),
    }


def _share(part: np.ndarray, whole: np.ndarray) -> float | None:
    return float(part.sum() / whole.sum()) if whole.any() else None


def _true_cells(grid: Grid, mesh: LabelledMesh, T_level_mesh: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the mesh has something in the way, and where it has floor; bool, shape (Y, X)."""
    points = transformed(T_level_mesh, _points_on(mesh))
    height = points[:, 2]
    in_the_way = (height > BAND_M[0]) & (height < BAND_M[1])
    return grid.count(points[in_the_way]) >= _ENOUGH, grid.count(points[np.abs(height) < _FLOOR_M]) > 0


def _points_on(mesh: LabelledMesh) -> np.ndarray:
    """Points spread evenly over the faces, the same in every call, shape (N, 3)."""
    corners = np.take(mesh.vertices.astype(np.float64), mesh.faces, axis=0)
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.linalg.norm(np.cross(a, b), axis=1) / 2
    rng = np.random.default_rng(0)
    face = np.repeat(np.arange(len(area)), rng.poisson(area * _POINTS_M2))
    u, v = np.sort(rng.random((2, len(face))), axis=0)
    return corners[face, 0] + a[face] * u[:, None] + b[face] * (1 - v)[:, None]


def _seen_floor(grid: Grid, run: SavedRun, reference: Sequence, T_level_reference: np.ndarray) -> np.ndarray:
    """Cells on whose floor a pixel of some frame lies, bool, shape (Y, X)."""
    (near, far), count = run.config.depth_range, np.zeros(grid.cells.shape, np.int64)
    for i in evenly_spread(len(reference), _SEEN_FRAMES):
        T = reference.T_world_camera(i)
        try:
            label, depth = reference.label(i), reference.depth(i)
        except InputError:
            continue  # a damaged frame saw nothing
        if T is None or label is None:
            continue
        seen = (depth >= near) & (depth <= far) & (label == CLASS_NAMES.index("floor"))
        points = back_project(depth, reference.intrinsics)[seen]
        count += grid.count(transformed(T_level_reference @ T, points))
    return count > 0
