"""How good the estimated motion is: against given poses, and against the depth images themselves."""

from typing import Any

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.fusion.evaluate.epipolar import epipolar_table
from dsmap.fusion.evaluate.rolling_rows import Rows, rows_of
from dsmap.fusion.evaluate.sfm import sfm_table
from dsmap.fusion.runs.read_run import SavedRun, evenly_spread
from dsmap.metrics import align_se3, ate_rmse, relative_pose_error
from dsmap.sequences import Sequence

CONSISTENCY_STEPS = (40, 100)
"""Depth consistency compares frames this far apart."""
_CONSISTENCY_PAIRS = 20
"""Pairs of frames looked at for each step."""
_MAX_POINT_DISTANCE = 0.3
"""Projectively paired points further apart than this see different surfaces [m]."""
_MIN_OVERLAP = 0.1
"""A pair of frames counts if this share of the points finds a partner."""


def evaluate_trajectory(
    run: SavedRun, reference: Sequence, pairs: list[tuple[int, int]], sfm: bool = False
) -> tuple[dict[str, Any], np.ndarray | None]:
    """Scores of the trajectory.

    Args:
        reference: the recording; small frames suffice.
        pairs: (frame of the run, frame of the reference).
        sfm: compare with structure from motion, too.

    Returns:
        The tree of `trajectory.*`, and T_reference_run of the SE(3) alignment, shape (4, 4), or None where
        the reference has no poses.
    """
    tree: dict[str, Any] = {"tracked_fraction": float(run.tracked.mean())}
    given = [(i, reference.T_world_camera(j)) for i, j in pairs]
    posed = [(i, T) for i, T in given if T is not None]
    alignment = None
    if len(posed) < 3:
        names = ("ate_rmse_m", "ate_rmse_unaligned_m", "rpe_trans_rmse_m", "rpe_rot_rmse_deg")
        tree |= dict.fromkeys(names) | {"reason": "the reference has no poses"}
    else:
        rows = [i for i, _ in posed]
        estimated, true = run.poses[rows], np.array([T for _, T in posed])
        alignment = align_se3(estimated[:, :3, 3], true[:, :3, 3])
        anchored = true[0] @ np.linalg.inv(estimated[0]) @ estimated
        rpe = relative_pose_error(run.times[rows], estimated, true)
        tree |= {
            "ate_rmse_m": ate_rmse(estimated, true),
            "ate_rmse_unaligned_m": ate_rmse(anchored, true, align=False),
            "rpe_trans_rmse_m": rpe[0] if rpe else None,
            "rpe_rot_rmse_deg": float(np.rad2deg(rpe[1])) if rpe else None,
            "poses_compared": len(posed),
        }
        if rpe is None:
            tree["reason"] = "the recording is shorter than 1 s"
    poses = {j: run.poses[i] for i, j in pairs}
    # Depth of a smaller image is that of the nearest pixel, half a pixel off: a millimetre on slanted surfaces.
    own = reference.calibration.intrinsics
    reference = reference.resized((own.width, own.height))
    readout_s = run.config.shutter_s or reference.readout_s
    tree["depth_consistency_m"] = consistency_table(reference, poses, run.config.depth_range[1], readout_s)
    true_poses: dict[int, np.ndarray] = {}
    if posed:
        true_poses = {j: T for j in poses if (T := reference.T_world_camera(j)) is not None}
        given_m = consistency_table(reference, true_poses, run.config.depth_range[1], readout_s)
        tree["depth_consistency_given_m"] = given_m
    tree |= epipolar_table(reference, poses, true_poses, CONSISTENCY_STEPS, readout_s)
    if sfm:
        tree["sfm"] = sfm_table(reference, poses, true_poses)
    return tree, alignment


def consistency_table(
    reference: Sequence, poses: dict[int, np.ndarray], max_depth: float, readout_s: float = 0.0
) -> dict[str, Any]:
    """Depth consistency [m] for every step of CONSISTENCY_STEPS; None, with a reason, where nothing overlaps.

    Args:
        poses: T_world_camera by frame of the reference.
        readout_s: time from an image's first row to its last [s].
    """
    table: dict[str, Any] = {}
    frames = sorted(poses)
    for step in CONSISTENCY_STEPS:
        starts = max(len(frames) - step, 0)
        medians = []
        for k in evenly_spread(starts, _CONSISTENCY_PAIRS):
            a, b = frames[k], frames[k + step]
            try:
                depth_a, depth_b = (_within(reference.depth(j), max_depth) for j in (a, b))
            except InputError:
                continue  # a damaged frame says nothing about the motion
            T_b_a = np.linalg.inv(poses[b]) @ poses[a]
            rows = [rows_of(reference, poses, j, readout_s, len(depth_a)) for j in (a, b)]
            distance = point_to_plane(depth_a, depth_b, T_b_a, reference.intrinsics, *rows)
            if distance is not None:
                medians.append(distance)
        table[str(step)] = float(np.median(medians)) if medians else None
        if not medians:
            table["reason"] = "too few frames, or none that overlap"
    return table


def point_to_plane(
    depth_a: np.ndarray,
    depth_b: np.ndarray,
    T_b_a: np.ndarray,
    camera: Intrinsics,
    rows_a: Rows | None = None,
    rows_b: Rows | None = None,
) -> float | None:
    """Median distance [m] of the points of one depth image to the surface planes of another.

    Points are paired by projection into b; those without a partner within 0.3 m are left out.

    Args:
        depth_a, depth_b: planar depth [m], shape (H, W), 0 invalid.
        T_b_a: takes points of camera a into camera b, shape (4, 4).
        rows_a, rows_b: how the cameras moved while the rows were read; None: they were read at once.

    Returns:
        None if less than a tenth of the points have a partner.
    """
    points = back_project(depth_a, camera)[depth_a > 0]
    if rows_a is not None:
        points = _transformed(rows_a.T_middle_row(np.nonzero(depth_a > 0)[0]), points)
    points = points @ T_b_a[:3, :3].T + T_b_a[:3, 3]
    total = len(points)
    points = points[points[:, 2] > 0]
    x, y = _pixels(points, camera)
    if (
        rows_b is not None
    ):  # which row read the point depends on when it was read: the second guess is good enough
        for _ in range(2):
            x, y = _pixels(_transformed(rows_b.T_row_middle(y), points), camera)
    inside = (x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height)
    x, y, points = x[inside], y[inside], points[inside]
    vertex, normal = _surface(depth_b, camera)
    v, n = vertex[y, x], normal[y, x]
    if rows_b is not None:
        T = rows_b.T_middle_row(y)
        known = v[:, 2] > 0
        v = np.where(known[:, None], _transformed(T, v), v)
        n = np.einsum("nij,nj->ni", T[:, :3, :3], n)
    offset = points - v
    paired = (v[:, 2] > 0) & (n != 0).any(axis=1) & ((offset**2).sum(axis=1) < _MAX_POINT_DISTANCE**2)
    if total == 0 or paired.sum() < _MIN_OVERLAP * total:
        return None
    return float(np.median(np.abs((offset[paired] * n[paired]).sum(axis=1))))


def _transformed(T: np.ndarray, points: np.ndarray) -> np.ndarray:
    return np.einsum("nij,nj->ni", T[:, :3, :3], points) + T[:, :3, 3]


def _pixels(points: np.ndarray, camera: Intrinsics) -> tuple[np.ndarray, np.ndarray]:
    x = np.floor(camera.fx * points[:, 0] / points[:, 2] + camera.cx + 0.5)
    y = np.floor(camera.fy * points[:, 1] / points[:, 2] + camera.cy + 0.5)
    return x.astype(np.int64), y.astype(np.int64)


def back_project(depth: np.ndarray, camera: Intrinsics) -> np.ndarray:
    """Camera-frame points [m] of a depth image, float64, shape (H, W, 3); 0 where there is no depth."""
    x = (np.arange(depth.shape[1]) - camera.cx) / camera.fx
    y = (np.arange(depth.shape[0]) - camera.cy) / camera.fy
    z = depth.astype(np.float64)
    return np.stack([x[None, :] * z, y[:, None] * z, z], axis=-1)


def _within(depth: np.ndarray, max_depth: float) -> np.ndarray:
    return np.where(depth <= max_depth, depth, 0)


def _surface(depth: np.ndarray, camera: Intrinsics) -> tuple[np.ndarray, np.ndarray]:
    """Vertex and normal maps; the normal is 0 beside holes and across depth steps of 5 %."""
    vertex = back_project(depth, camera)
    normal = np.zeros_like(vertex)
    right, left = vertex[1:-1, 2:], vertex[1:-1, :-2]
    below, above = vertex[2:, 1:-1], vertex[:-2, 1:-1]
    cross = np.cross(right - left, below - above)
    length = np.linalg.norm(cross, axis=-1)
    z = vertex[1:-1, 1:-1, 2]
    neighbours = np.stack([right, left, below, above])[..., 2]
    smooth = (np.abs(neighbours - z) < 0.05 * z).all(axis=0) & (neighbours > 0).all(axis=0) & (length > 0)
    normal[1:-1, 1:-1][smooth] = cross[smooth] / length[smooth, None]
    return vertex, normal
