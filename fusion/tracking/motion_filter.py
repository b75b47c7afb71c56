"""How the camera moves: where constant motion leads it next, and how sure that is.

Depth and colours hold the camera in most directions most of the time. In front of a bare wall they do not, and
registration follows noise there. But a camera has mass: the motion of the last frames, known with some certainty, is
one more measurement. This is a Kalman filter of the velocity; its process noise is what the camera has accelerated by
of late.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dsmap.fusion.config import TrackConfig
from dsmap.fusion.lie import adjoint, exp_se3, inverse, velocity
from dsmap.fusion.trajectory import TrajectoryPoint

MAX_GAP_S = 0.2
"""Frames further apart than this say nothing about each other's motion [s]."""
_CORRELATED = 5.0
"""Squared errors of tracked poses, of their stated covariance: residuals of neighbouring pixels are not independent.
Median over the frames of six rendered flats: 3 to 9 in all six directions."""
_FORGET = 0.9
"""Acceleration is remembered for about ten frames."""
_AT_FIRST = 4.0
"""Before it was seen, a camera may accelerate by this many times the least that is expected of it."""


@dataclass
class Expected:
    """A pose that is expected with some certainty."""

    T: np.ndarray
    """(4, 4)."""
    information: np.ndarray
    """Inverse covariance of xi in exp(xi^) T (translation [m], rotation [rad]), shape (6, 6), in units of the
    variance that a registration states for a single residual of its own."""


class MotionFilter:
    """The camera's velocity and what is known about it.

    Args:
        config: `motion`, `min_acceleration`, `min_angular_acceleration`.
    """

    def __init__(self, config: TrackConfig):
        self._used = config.motion
        self._least = np.array([config.min_acceleration, config.min_angular_acceleration])
        self.velocity = np.zeros(6)
        """Twist in the camera's frame (translation [m/s], rotation [rad/s]), shape (6,), of the last tracked frame."""
        self.learnt = -1
        """Number of that frame: the velocity of an earlier one than the last tells nothing."""
        self.covariance = np.zeros((6, 6))
        """Of the velocity."""
        self.acceleration = _AT_FIRST * self._least
        """RMS of late [m/s^2, rad/s^2], shape (2,)."""

    def expected(
        self, trajectory: Sequence[TrajectoryPoint], pose_time: float, T_view_world: np.ndarray
    ) -> Expected | None:
        """T_view_camera of the next frame, taken at that time [s]; None where too little is known."""
        if not self._used or not self._knows(trajectory):
            return None
        seconds = pose_time - trajectory[-1].pose_time
        if not 0 < seconds <= MAX_GAP_S:
            return None
        T = T_view_world @ trajectory[-1].T_world_camera @ exp_se3(self.velocity * seconds)
        A = adjoint(inverse(T))
        covariance = self._predicted(seconds) * seconds**2 / _CORRELATED
        return Expected(T, A.T @ np.linalg.inv(covariance) @ A)

    def learn(
        self,
        trajectory: Sequence[TrajectoryPoint],
        pose_time: float,
        T_world_camera: np.ndarray,
        T_view_camera: np.ndarray,
        covariance: np.ndarray,
    ) -> None:
        """A frame was tracked: what does it tell about the velocity?

        Args:
            trajectory: before this frame.
            pose_time: when the frame was taken [s].
            covariance: of xi in exp(xi^) T_view_camera, as registration states it without any expectation, (6, 6).
        """
        before = trajectory[-1]
        seconds = pose_time - before.pose_time
        if not (before.tracked and 0 < seconds <= MAX_GAP_S and np.isfinite(covariance).all()):
            return
        A = adjoint(inverse(T_view_camera))
        known = _CORRELATED * A @ covariance @ A.T / seconds**2 + 1e-12 * np.eye(6)
        seen = velocity(before.T_world_camera, T_world_camera, seconds)
        if self._knows(trajectory):
            # The expectation is in the pose already; only the covariances are left to be joined.
            known = np.linalg.inv(np.linalg.inv(known) + np.linalg.inv(self._predicted(seconds)))
            # What the velocity has changed by beyond its own uncertainty.
            change = (seen - self.velocity) ** 2 - np.diag(known) - np.diag(self.covariance)
            lately = np.sqrt(np.maximum(change.reshape(2, 3).mean(axis=1), 0)) / seconds
            self.acceleration = np.maximum(np.maximum(lately, _FORGET * self.acceleration), self._least)
        self.velocity, self.covariance, self.learnt = seen, known, len(trajectory)

    def _knows(self, trajectory: Sequence[TrajectoryPoint]) -> bool:
        """Whether the velocity is that of the last frame."""
        return self.learnt == len(trajectory) - 1 >= 0

    def _predicted(self, seconds: float) -> np.ndarray:
        """Covariance of the next velocity: as it is known now, and what acceleration adds."""
        return self.covariance + np.diag(np.repeat((self.acceleration * seconds) ** 2, 3))

    def state(self) -> dict[str, np.ndarray]:
        """All that is carried from frame to frame, as arrays by name."""
        return {
            "velocity": self.velocity, "covariance": self.covariance, "acceleration": self.acceleration,
            "learnt": np.array([self.learnt]),
        }  # fmt: skip

    def load_state(self, state: dict[str, np.ndarray]) -> None:
        """Go on where `state` was taken; a file from before there was any has none."""
        if state:
            self.velocity, self.covariance = state["velocity"], state["covariance"]
            self.acceleration, self.learnt = state["acceleration"], int(state["learnt"][0])
