"""Where the rows of a rolling shutter were taken from, for scores that compare images by their poses."""

from dataclasses import dataclass

import numpy as np

from dsmap.fusion.lie import hat, velocity
from dsmap.fusion.tracking.motion_filter import MAX_GAP_S
from dsmap.sequences import Sequence


@dataclass
class Rows:
    """How a camera moved while it read the rows of one image; the pose is that of the middle row."""

    twist: np.ndarray
    """Velocity in its own frame (translation [m/s], rotation [rad/s]), shape (6,)."""
    readout_s: float
    height: int

    def T_middle_row(self, rows: np.ndarray) -> np.ndarray:
        """Takes points of the camera that read a row into that of the middle row, shape (N, 4, 4)."""
        t = (rows / (self.height - 1) - 0.5) * self.readout_s
        H = np.zeros((4, 4))
        H[:3, :3], H[:3, 3] = hat(self.twist[3:]), self.twist[:3]
        # exp(H t); what is left out is a thirtieth of a millimetre at 2 m when the camera turns with 3 rad/s.
        return np.eye(4) + t[:, None, None] * H + 0.5 * t[:, None, None] ** 2 * (H @ H)

    def T_row_middle(self, rows: np.ndarray) -> np.ndarray:
        """The inverse, shape (N, 4, 4)."""
        return Rows(-self.twist, self.readout_s, self.height).T_middle_row(rows)


def rows_of(
    reference: Sequence, poses: dict[int, np.ndarray], frame: int, readout_s: float, height: int
) -> Rows | None:
    """Of a frame, by its pose and its neighbour's; None where all rows are taken at once, or no neighbour is near.

    Args:
        poses: T_world_camera by frame of the reference.
        height: of the images [px].
    """
    for other in (frame - 1, frame + 1) if readout_s else ():
        if other in poses:
            seconds = reference.entries[frame].pose_time - reference.entries[other].pose_time
            if 0 < abs(seconds) <= MAX_GAP_S:
                return Rows(velocity(poses[other], poses[frame], seconds), readout_s, height)
    return None
