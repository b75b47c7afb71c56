"""How good the mapped surface is, where the recording has a ground-truth mesh."""

from typing import Any

import numpy as np
from scipy.spatial import KDTree

from dsmap.errors import InputError
from dsmap.fusion.evaluate.trajectory import back_project
from dsmap.fusion.runs.read_run import SavedRun, evenly_spread
from dsmap.kernels.mesh_distance import closest_on_mesh
from dsmap.metrics import ConfusionMatrix
from dsmap.sequences import Sequence
from dsmap.sequences.mesh import MESH_FILE, LabelledMesh, read_mesh

THRESHOLD_M = 0.05
"""Completeness and F-score count points within this distance [m]."""
LABEL_DISTANCE_M = 0.02
"""A surfel has the class of the nearest face if that is within this distance [m]."""
_FAR_M = 0.5
"""Distances are cut here: an outlier is an outlier [m]."""
_VOXEL_M = 0.02
_SEEN_FRAMES = 60
_NAMES = (
    "accuracy_mean_m", "accuracy_median_m", "accuracy_mean_unaligned_m", "completeness_5cm", "fscore_5cm",
)  # fmt: skip


def evaluate_surface(
    run: SavedRun, reference: Sequence, pairs: list[tuple[int, int]], alignment: np.ndarray | None
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Scores of stable surfels against the reference's `mesh.ply`.

    accuracy: distance of stable surfels to the mesh, after the trajectory's SE(3) alignment; `unaligned`:
    with the first poses made equal instead. completeness: share of the mesh surface that the camera saw
    (depth of the reference, up to the run's depth_max, moved onto the mesh, one point in 2 cm) which has
    a surfel, stable or not, within 5 cm. F-score: harmonic mean of that and of the share of all surfels
    within 5 cm of the mesh.

    Returns:
        The trees `surface` and `semantics.surfels` (stable surfels against the class of the nearest face).
    """
    missing = _missing(run, reference, alignment)
    if missing or alignment is None:
        scores = ConfusionMatrix().scores()
        return dict.fromkeys(_NAMES) | {"reason": missing}, scores | {"reason": missing}
    mesh = read_mesh(reference.path / MESH_FILE)
    surfels = run.surfels.numpy()
    alive = surfels["weight"] > 0
    stable = surfels["weight"][alive] >= run.config.stable_weight
    position = surfels["position"][alive].astype(np.float64)
    aligned = position @ alignment[:3, :3].T + alignment[:3, 3]
    distance, face, _ = _closest(aligned, mesh, run)
    first = next((i, T) for i, j in pairs if (T := reference.T_world_camera(j)) is not None)
    anchor = first[1] @ np.linalg.inv(run.poses[first[0]])
    unaligned, _, _ = _closest(position[stable] @ anchor[:3, :3].T + anchor[:3, 3], mesh, run)
    precision = float((distance < THRESHOLD_M).mean())
    completeness = _completeness(aligned, seen_surface(reference, mesh, run))
    total = precision + (completeness or 0.0)
    surface = {
        "accuracy_mean_m": float(distance[stable].mean()),
        "accuracy_median_m": float(np.median(distance[stable])),
        "accuracy_mean_unaligned_m": float(unaligned.mean()),
        "completeness_5cm": completeness,
        "fscore_5cm": 2 * precision * completeness / total if completeness and total else completeness,
        "stable_surfels": int(stable.sum()),
    }
    if completeness is None:
        surface["reason"] = "no reference frame with a pose shows the mesh"
    matrix = ConfusionMatrix()
    near = stable & (distance < LABEL_DISTANCE_M)
    matrix.add(mesh.label[face[near]], surfels["label"][alive][near])
    return surface, matrix.scores()


def seen_surface(reference: Sequence, mesh: LabelledMesh, run: SavedRun) -> np.ndarray:
    """Points of the mesh seen by reference frames in the run's depth range, one in 2 cm, shape (N, 3)."""
    chunks, (near, far) = [], run.config.depth_range
    for i in evenly_spread(len(reference), _SEEN_FRAMES):
        T = reference.T_world_camera(i)
        if T is None:
            continue
        try:
            depth = reference.depth(i)
        except InputError:
            continue  # a damaged frame saw nothing
        seen = (depth >= near) & (depth <= far)
        chunks.append(_thin(back_project(depth, reference.intrinsics)[seen] @ T[:3, :3].T + T[:3, 3]))
    if not chunks:
        return np.zeros((0, 3))
    points = _thin(np.concatenate(chunks))
    distance, _, closest = _closest(points, mesh, run)
    return _thin(closest[distance < THRESHOLD_M])


def _thin(points: np.ndarray) -> np.ndarray:
    """One point a voxel of 2 cm."""
    cells = np.floor(points / _VOXEL_M).astype(np.int64)
    cells -= cells.min(axis=0, initial=0)
    span = cells.max(axis=0, initial=0) + 1
    keys = (cells[:, 0] * span[1] + cells[:, 1]) * span[2] + cells[:, 2]
    return points[np.unique(keys, return_index=True)[1]]


def _closest(
    points: np.ndarray, mesh: LabelledMesh, run: SavedRun
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return closest_on_mesh(points, mesh.vertices, mesh.faces, max_distance=_FAR_M, device=run.surfels.device)


def _completeness(surfels: np.ndarray, seen: np.ndarray) -> float | None:
    if len(seen) == 0:
        return None
    distance, _ = KDTree(surfels).query(seen, distance_upper_bound=THRESHOLD_M)
    return float(np.isfinite(distance).mean())


def _missing(run: SavedRun, reference: Sequence, alignment: np.ndarray | None) -> str:
    """Why the surface cannot be scored; empty if it can."""
    if not (reference.path / MESH_FILE).exists():
        return f"the reference has no {MESH_FILE}"
    if alignment is None:
        return "the reference has no poses"
    if not (run.surfels.numpy()["weight"] >= run.config.stable_weight).any():
        return "the map has no stable surfel"
    return ""
