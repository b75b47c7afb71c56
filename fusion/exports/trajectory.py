"""The path of a camera as others read it: TUM, KITTI, EuRoC."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dsmap.files import atomic_path


def write_trajectory(path: Path | str, rows: Iterable[Sequence[Any]]) -> None:
    """Write poses in the TUM format: `t tx ty tz qx qy qz qw`, camera to world, one line a row.

    Args:
        rows: tuples that start with (time [s], T_world_camera of shape (4, 4)); what follows is ignored.
    """
    lines = [
        f"{time:.6f} " + " ".join(f"{value:.7f}" for value in (*pose[:3, 3], *quaternion))
        for time, pose, quaternion in _rows(rows)
    ]
    _write(path, ["# time tx ty tz qx qy qz qw (camera to world)", *lines])


def write_kitti(path: Path | str, rows: Iterable[Sequence[Any]]) -> None:
    """Write poses as KITTI odometry does: the upper three rows of T_world_camera, 12 numbers a line, no stamps."""
    _write(path, [" ".join(f"{value:.9g}" for value in pose[:3].ravel()) for _, pose, _ in _rows(rows)])


def write_euroc(path: Path | str, rows: Iterable[Sequence[Any]]) -> None:
    """Write poses as EuRoC's ground truth: `t [ns],x,y,z,qw,qx,qy,qz`, camera to world; the 17 columns of the data
    set, whose velocities and biases are 0 here."""
    head = "#timestamp,p_x,p_y,p_z,q_w,q_x,q_y,q_z,v_x,v_y,v_z,w_x,w_y,w_z,a_x,a_y,a_z"
    lines = []
    for time, pose, (qx, qy, qz, qw) in _rows(rows):
        numbers = ",".join(f"{value:.7f}" for value in (*pose[:3, 3], qw, qx, qy, qz, *[0.0] * 9))
        lines.append(f"{round(time * 1e9)},{numbers}")
    _write(path, [head, *lines])


TRAJECTORY_WRITERS: dict[str, Callable[[Path | str, Iterable[Sequence[Any]]], None]] = {
    "tum": write_trajectory,
    "kitti": write_kitti,
    "euroc": write_euroc,
}
"""Name of a layout to the function that writes it."""


def _rows(rows: Iterable[Sequence[Any]]) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Time, pose and quaternion (x y z w) of every row."""
    rows = list(rows)
    poses = np.array([row[1] for row in rows], dtype=np.float64).reshape(-1, 4, 4)
    quaternions = Rotation.from_matrix(poses[:, :3, :3]).as_quat() if rows else np.empty((0, 4))
    return [(row[0], pose, q) for row, pose, q in zip(rows, poses, quaternions, strict=True)]


def _write(path: Path | str, lines: list[str]) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="ascii")
