"""The path of the camera."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

TURN_M = 0.5
"""A radian of turning drifts as this many metres of way do."""


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
