"""Where a camera is between its frames: a cubic spline with as many control poses as frames.

A rolling shutter reads rows some 13 ms before and after the frame's time, and a hand trembles at 5 to 10 Hz: the
velocity between neighbouring frames is too small then, and a readout fitted with it too large (14 % in a rendered
walk).
"""

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.spatial.transform import Rotation

_DEGREE = 3


class PoseSpline:
    """Weights of control poses at any time near a window's frames.

    Args:
        times: of the frames [s], increasing, shape (F,), six at least.
    """

    def __init__(self, times: np.ndarray):
        self._times = times
        ends = (np.repeat(times[0], _DEGREE + 1), np.repeat(times[-1], _DEGREE + 1))
        self._knots = np.concatenate(
            [ends[0], times[2:-2], ends[1]]
        )  # no knots beside the ends: F control poses

    def controls(self, rotations: np.ndarray, centres: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Control poses whose spline goes through (about, for rotations) the poses of the frames.

        Args:
            rotations, centres: of the frames in the world, shapes (F, 3, 3) and (F, 3).
        """
        first = Rotation.from_matrix(rotations[0])
        turns = (first.inv() * Rotation.from_matrix(rotations)).as_rotvec()
        both = np.concatenate([centres, turns], axis=1)
        found = make_interp_spline(self._times, both, _DEGREE, self._knots).c
        return (first * Rotation.from_rotvec(found[:, 3:])).as_matrix(), found[:, :3]

    def shares(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The four control poses that count at times (N,) [s], and how much each does; shapes (N, 4)."""
        interval = np.searchsorted(self._knots, times, side="right") - 1
        first = np.clip(interval, _DEGREE, len(self._times) - 1) - _DEGREE
        which = first[:, None] + np.arange(_DEGREE + 1)
        design = BSpline.design_matrix(times, self._knots, _DEGREE, extrapolate=True)
        return which, design.data.reshape(-1, _DEGREE + 1)

    def at(
        self, rotations: np.ndarray, centres: np.ndarray, which: np.ndarray, shares: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (N, 3, 3) and centres (N, 3) in the world, of control poses (F, 3, 3) and (F, 3).

        Args:
            which, shares: of `shares` for the times.
        """
        R, spans = Rotation.from_matrix(rotations), len(rotations) - _DEGREE
        turns = np.stack(
            [(R[1 : 1 + spans].inv() * R[k : k + spans]).as_rotvec() for k in range(_DEGREE + 1)], axis=1
        )
        turn = np.einsum("nk,nki->ni", shares, turns[which[:, 0]])
        centre = np.einsum("nk,nki->ni", shares, centres[which])
        return rotations[which[:, 1]] @ Rotation.from_rotvec(turn).as_matrix(), centre
