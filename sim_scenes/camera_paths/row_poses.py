"""Where a camera with a rolling shutter is while it reads each row: its path between the frames."""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from dsmap.errors import InputError

_BROKEN = ("views", "jump")
"""Paths whose frames do not follow one another."""


class RowPoses:
    """A smooth path through the poses of the frames (cubic splines of position and rotation).

    Args:
        poses: T_world_camera, shape (frames, 4, 4), two at least.
        fps: frames a second.
        kind: of the path.

    Raises:
        InputError: the frames of this kind of path do not follow one another.
    """

    def __init__(self, poses: np.ndarray, fps: float, kind: str):
        if kind in _BROKEN or len(poses) < 2:
            raise InputError(
                f"a readout is given for path {kind} of {len(poses)} frames; expected frames that follow one another"
            )
        self._fps, times = fps, np.arange(len(poses)) / fps
        self._position = CubicSpline(times, poses[:, :3, 3])
        self._rotation = RotationSpline(times, Rotation.from_matrix(poses[:, :3, :3]))

    def at(self, times: np.ndarray) -> np.ndarray:
        """T_world_camera at times (N,) [s], shape (N, 4, 4)."""
        T = np.tile(np.eye(4), (len(times), 1, 1))
        T[:, :3, :3] = self._rotation(times).as_matrix()
        T[:, :3, 3] = self._position(times)
        return T

    def rows(self, frame: int, height: int, readout_s: float, offset_s: float = 0.0) -> np.ndarray:
        """Of every row of a frame, shape (height, 4, 4).

        Args:
            readout_s: from the first row to the last [s]; the middle row is read at the frame's time...
            offset_s: ... and this much [s].
        """
        middle = frame / self._fps + offset_s
        return self.at(middle + readout_s * (np.arange(height) / (height - 1) - 0.5))
