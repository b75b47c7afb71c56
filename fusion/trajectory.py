"""The path of the camera."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from dsmap.fusion.lie import exp_so3

TURN_M = 0.5
"""A radian of turning drifts as this many metres of way do."""
MOST_LOST = 60
"""After more lost frames than this the last motion tells nothing."""
_MOTION_FRAMES = 5
"""The last motion is measured over this many frames."""


@dataclass
class TrajectoryPoint:
    """One line of the trajectory: every frame has one; a lost frame carries the last pose."""

    time: float
    T_world_camera: np.ndarray
    tracked: bool


def poses_of(trajectory: Sequence[TrajectoryPoint]) -> np.ndarray:
    """T_world_camera of every frame, shape (K, 4, 4)."""
    return np.array([point.T_world_camera for point in trajectory], dtype=np.float64).reshape(-1, 4, 4)


def way(poses: np.ndarray) -> float:
    """Length [m] of a path of T_world_camera, shape (K, 4, 4); a radian of turning counts as TURN_M."""
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    cosines = (np.einsum("kij,kij->k", poses[1:, :3, :3], poses[:-1, :3, :3]) - 1) / 2
    return float(steps.sum() + TURN_M * np.arccos(np.clip(cosines, -1, 1)).sum())


def extrapolated(trajectory: Sequence[TrajectoryPoint]) -> list[np.ndarray]:
    """Where the camera may be now, after lost frames: T_world_camera, shapes (4, 4), most likely first.

    As far as its last motion would have led it, half as far, and where it was; none after MOST_LOST frames.
    """
    tracked = [k for k, point in enumerate(trajectory) if point.tracked]
    lost = len(trajectory) - (tracked[-1] if tracked else 0)
    if not tracked or lost > MOST_LOST:
        return []
    last = trajectory[tracked[-1]].T_world_camera
    start = max(tracked[-1] - _MOTION_FRAMES, 0)
    first = trajectory[start].T_world_camera
    share = 1 / max(tracked[-1] - start, 1)
    velocity = share * (last[:3, 3] - first[:3, 3])
    spin = share * cv2.Rodrigues(first[:3, :3].T @ last[:3, :3])[0][:, 0]
    poses = []
    for frames in (lost, lost / 2, 0.0):
        T = last.copy()
        T[:3, :3] = last[:3, :3] @ exp_so3(frames * spin)
        T[:3, 3] = last[:3, 3] + frames * velocity
        poses.append(T)
    return poses
