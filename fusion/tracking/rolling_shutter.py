"""RowMotion shutter: rows are read one after the other while the camera moves on from the pose of the last frame.

Kinects and most cheap cameras take some 25 ms for an image: at 60 degrees a second the last row is 1.5 degrees behind
the first. The motion that is being estimated tells where each row was taken from, so both are estimated together
(`kernels/odometry.py`); then the frame is put right and everything after knows nothing of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from dsmap.frame import Frame
from dsmap.fusion.lie import velocity
from dsmap.fusion.tracking.motion_filter import MAX_GAP_S
from dsmap.fusion.trajectory import TrajectoryPoint
from dsmap.kernels.shutter import global_shutter
from dsmap.kernels.types import FrameMaps

_NEGLIGIBLE = 0.2
"""A frame whose first and last row are off by less than this stays as it is [px]."""


@dataclass
class RowMotion:
    """How a frame's pose tells the camera's motion while its rows are read."""

    readout_s: float
    """From the first row to the last [s]."""
    T_last: np.ndarray
    """Pose of the last frame, shape (4, 4), in the coordinates of the poses that `twist` is asked for."""
    seconds: float
    """Since then."""

    def twist(self, T: np.ndarray) -> np.ndarray:
        """Velocity of a camera that came to T, in its own frame (translation [m/s], rotation [rad/s]), shape (6,)."""
        if not np.isfinite(T).all():  # a search that went astray
            return np.zeros(6)
        return velocity(self.T_last, T, self.seconds)


def row_motion(
    readout_s: float, trajectory: Sequence[TrajectoryPoint], pose_time: float, T_view_world: np.ndarray
) -> RowMotion | None:
    """Of the next frame, with poses in the coordinates of a view; None where all rows are taken at once, or
    where the last tracked frame is too long ago to tell how the camera moves.

    Args:
        trajectory: of all frames before it.
        pose_time: when it is taken [s].
    """
    if not readout_s:
        return None
    last = last_tracked(trajectory, pose_time)
    if last is None:
        return None
    point = trajectory[last]
    return RowMotion(readout_s, T_view_world @ point.T_world_camera, pose_time - point.pose_time)


def last_tracked(trajectory: Sequence[TrajectoryPoint], pose_time: float) -> int | None:
    """Number of the last tracked frame, if it was taken at most MAX_GAP_S before that time [s]."""
    for k in range(len(trajectory) - 1, -1, -1):
        seconds = pose_time - trajectory[k].pose_time
        if not 0 < seconds <= MAX_GAP_S:
            return None
        if trajectory[k].tracked:
            return k
    return None


def undo_rolling_shutter(
    cameras: Sequence[Any], maps: Sequence[FrameMaps], rows: RowMotion | None, T: np.ndarray
) -> Sequence[FrameMaps]:
    """A frame's maps, finest level first, as if all rows had been taken with the middle one, from pose T."""
    if rows is None:
        return maps
    twist = rows.twist(T)
    # What lies a metre away moves by about this in half the time.
    pixels = cameras[0].fx * np.linalg.norm(twist.reshape(2, 3), axis=1).sum() * abs(rows.readout_s) / 2
    if not _NEGLIGIBLE <= pixels < cameras[0].width:  # at rest, or nowhere near
        return maps
    levels = zip(cameras, maps, strict=True)
    return [global_shutter(camera, level, twist, rows.readout_s) for camera, level in levels]


def corrected_frame(frame: Frame, maps: FrameMaps) -> Frame:
    """The frame with the images of its finest maps, for a network: classes belong to the pixels that are fused."""
    rgb = cv2.convertScaleAbs(maps.colour.numpy(), alpha=255.0)
    return replace(frame, rgb=rgb, depth=maps.depth.numpy())
