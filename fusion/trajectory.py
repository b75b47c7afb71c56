"""The path of the camera."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import overload

import cv2
import numpy as np

from dsmap.fusion.lie import exp_so3

TURN_M = 0.5
"""A radian of turning drifts as this many metres of way do."""
MOST_LOST = 60
"""After more lost frames than this the last motion tells nothing."""
_MAX_GAP_S = 0.1
"""Frames further apart than this say nothing about the motion between them [s]."""
_MOTION_FRAMES = 5
"""The last motion is measured over this many frames."""
_ROOM = 256
"""Frames that a trajectory has room for at first."""


@dataclass
class TrajectoryPoint:
    """One line of the trajectory: every frame has one; a lost frame carries the last pose."""

    time: float
    T_world_camera: np.ndarray
    """At the time of the depth image."""
    tracked: bool
    depth_time: float | None = None
    """Stamp of the depth image [s]; None: that of the colour, `time`."""

    @property
    def pose_time(self) -> float:
        """When the camera was at the pose [s]."""
        return self.time if self.depth_time is None else self.depth_time


class Trajectory(Sequence[TrajectoryPoint]):
    """All frames so far, as arrays that grow: 145 bytes a frame, however long the recording.

    A point that is taken out is a copy of its frame's values: what `set_poses` moves, it does not follow.
    """

    def __init__(self, points: Iterable[TrajectoryPoint] = ()):
        self._count = 0
        self._poses = np.empty((_ROOM, 4, 4))
        self._times = np.empty((_ROOM, 2))
        self._tracked = np.empty(_ROOM, bool)
        for point in points:
            self.append(point)

    @classmethod
    def of_arrays(
        cls, times: np.ndarray, poses: np.ndarray, tracked: np.ndarray, depth_times: np.ndarray
    ) -> "Trajectory":
        """The same from the properties of these names."""
        trajectory = cls()
        trajectory._count = len(times)
        trajectory._poses = np.array(poses, dtype=np.float64).reshape(-1, 4, 4)
        trajectory._times = np.stack([times, depth_times], axis=1).astype(np.float64)
        trajectory._tracked = np.array(tracked, dtype=bool)
        return trajectory

    def append(self, point: TrajectoryPoint) -> None:
        """Add a frame."""
        if self._count == len(self._tracked):
            self._poses, self._times, self._tracked = (
                np.concatenate([a, np.empty((max(len(a) // 2, _ROOM), *a.shape[1:]), a.dtype)])
                for a in (self._poses, self._times, self._tracked)
            )
        row = self._count
        self._poses[row] = point.T_world_camera
        self._times[row] = point.time, np.nan if point.depth_time is None else point.depth_time
        self._tracked[row] = point.tracked
        self._count += 1

    @property
    def times(self) -> np.ndarray:
        """Stamps [s], shape (K,)."""
        return self._times[: self._count, 0]

    @property
    def depth_times(self) -> np.ndarray:
        """Stamps of the depth images [s], shape (K,); NaN: that of the colour."""
        return self._times[: self._count, 1]

    @property
    def poses(self) -> np.ndarray:
        """T_world_camera, float64, shape (K, 4, 4)."""
        return self._poses[: self._count]

    @property
    def tracked(self) -> np.ndarray:
        """bool, shape (K,)."""
        return self._tracked[: self._count]

    def set_poses(self, poses: np.ndarray) -> None:
        """Give every frame another pose, shape (K, 4, 4): a loop has bent the world."""
        self._poses = self._poses.copy()  # whoever was given a pose keeps it
        self._poses[: self._count] = poses

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, key: int) -> TrajectoryPoint: ...
    @overload
    def __getitem__(self, key: slice) -> list[TrajectoryPoint]: ...
    def __getitem__(self, key: int | slice) -> TrajectoryPoint | list[TrajectoryPoint]:
        rows = range(self._count)[key]
        return self._point(rows) if isinstance(rows, int) else [self._point(row) for row in rows]

    def _point(self, row: int) -> TrajectoryPoint:
        time, depth_time = self._times[row].tolist()
        pose = self._poses[row].copy()
        return TrajectoryPoint(
            time, pose, bool(self._tracked[row]), None if np.isnan(depth_time) else depth_time
        )


def at_colour_stamps(trajectory: Sequence[TrajectoryPoint]) -> np.ndarray:
    """T_world_camera of every frame at its colour stamp, shape (K, 4, 4).

    A frame is registered by its depth image, which a sensor may take up to half a frame before or after the
    colour: at walking pace that is a centimetre. The pose moves on along the straight way to the neighbour on
    that side (at the ends: from the one before), unless one of the two is lost or more than 0.1 s away.
    """
    poses = pose_array(trajectory)
    pose_times = np.array([p.pose_time for p in trajectory])
    out = poses.copy()
    for i, point in enumerate(trajectory):
        later = point.time - pose_times[i]
        k = i + (1 if later > 0 else -1)
        k = k if 0 <= k < len(poses) else 2 * i - k
        if later == 0 or not 0 <= k < len(poses) or not (point.tracked and trajectory[k].tracked):
            continue
        if 0 < abs(pose_times[k] - pose_times[i]) <= _MAX_GAP_S:
            share = later / (pose_times[k] - pose_times[i])
            spin = cv2.Rodrigues(poses[i, :3, :3].T @ poses[k, :3, :3])[0][:, 0]
            out[i, :3, :3] = poses[i, :3, :3] @ exp_so3(share * spin)
            out[i, :3, 3] += share * (poses[k, :3, 3] - poses[i, :3, 3])
    return out


def pose_array(trajectory: Sequence[TrajectoryPoint]) -> np.ndarray:
    """T_world_camera of every frame, shape (K, 4, 4)."""
    if isinstance(trajectory, Trajectory):
        return trajectory.poses.copy()
    return np.array([point.T_world_camera for point in trajectory], dtype=np.float64).reshape(-1, 4, 4)


def path_length(poses: np.ndarray) -> float:
    """Length [m] of a path of T_world_camera, shape (K, 4, 4); a radian of turning counts as TURN_M."""
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    cosines = (np.einsum("kij,kij->k", poses[1:, :3, :3], poses[:-1, :3, :3]) - 1) / 2
    return float(steps.sum() + TURN_M * np.arccos(np.clip(cosines, -1, 1)).sum())


def extrapolated(trajectory: Sequence[TrajectoryPoint]) -> list[np.ndarray]:
    """Where the camera may be now, after lost frames: T_world_camera, shapes (4, 4), most likely first.

    As far as its last motion would have led it, half as far, and where it was; none after MOST_LOST frames.
    """
    count = len(trajectory)
    recent = range(count - 1, max(count - MOST_LOST, 0) - 1, -1)
    at = next((k for k in recent if trajectory[k].tracked), None)
    if at is None:
        return []
    lost, last = count - at, trajectory[at].T_world_camera
    start = max(at - _MOTION_FRAMES, 0)
    first = trajectory[start].T_world_camera
    share = 1 / max(at - start, 1)
    velocity = share * (last[:3, 3] - first[:3, 3])
    spin = share * cv2.Rodrigues(first[:3, :3].T @ last[:3, :3])[0][:, 0]
    poses = []
    for frames in (lost, lost / 2, 0.0):
        T = last.copy()
        T[:3, :3] = last[:3, :3] @ exp_so3(frames * spin)
        T[:3, 3] = last[:3, 3] + frames * velocity
        poses.append(T)
    return poses
