"""The corrections that fit all windows of a recording, and how sure they are."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dsmap.fusion.calibration.bundle import Reduced, ResidualScale, Window
from dsmap.fusion.calibration.rig import Cameras, Rig

_LEAST_ROUNDS, _ROUNDS = 5, 40
_DONE = 0.1
"""The search ends when no correction moves by more than this share of its standard deviation."""
_SHARPEST = ResidualScale(0.02, 1e-4)
"""No image is better than this [px, 1/m]."""
_FEWEST_FOR_SPREAD = 3
"""Windows from which their disagreement tells how sure the corrections are."""


@dataclass
class Estimate:
    """Corrections of a rig, with what they are worth."""

    rig: Rig
    vector: np.ndarray
    """Corrections, in the order of `rig.names`, shape (S,)."""
    covariance: np.ndarray
    """Of the corrections, shape (S, S)."""
    scale: ResidualScale
    """Robust standard deviations of the residuals."""
    observations: int
    with_depth: int
    rounds: int

    @property
    def sigma(self) -> np.ndarray:
        """Standard deviations of the corrections, shape (S,)."""
        return np.sqrt(np.diag(self.covariance))

    def value(self, name: str) -> float:
        """A correction; 0 for one that was not sought."""
        return float(self.vector[self.rig.names.index(name)]) if name in self.rig.names else 0.0

    def sigma_of(self, name: str) -> float:
        """The standard deviation of a correction; infinite for one that was not sought."""
        return float(self.sigma[self.rig.names.index(name)]) if name in self.rig.names else float("inf")


def estimate(rig: Rig, windows: Sequence[Window], start: np.ndarray | None = None) -> Estimate:
    """Fit corrections, poses and points of all windows together (Gauss-Newton, re-weighted); windows are moved.

    Args:
        start: corrections to begin with, shape (S,); None: none.
    """
    vector = np.zeros(len(rig.names)) if start is None else start.copy()
    prior, rounds = np.diag(1 / rig.prior_sigma**2), 0
    while True:
        rounds += 1
        scale, parts = _normal_equations(rig, windows, vector)
        inverse = np.linalg.inv(sum(part.H for part in parts) + prior)
        step = inverse @ (sum(part.g for part in parts) - prior @ vector)
        if rounds > _LEAST_ROUNDS and (np.abs(step) < _DONE * np.sqrt(np.diag(inverse))).all():
            break
        vector = vector + step
        for part in parts:
            part.apply(step)
        if rounds == _ROUNDS:
            break
    return Estimate(
        rig,
        vector,
        _with_spread(inverse, parts),
        scale,
        sum(len(w.tracks.frame) for w in windows),
        sum(int(w.has_depth.sum()) for w in windows),
        rounds,
    )


def _normal_equations(
    rig: Rig, windows: Sequence[Window], vector: np.ndarray
) -> tuple[ResidualScale, list[Reduced]]:
    """Every window's part, with depth read where its points are now."""
    cameras = rig.cameras(vector)
    for window in windows:
        window.read_depth(cameras)
    scale = _scale(windows, cameras)
    return scale, [window.reduced(rig, vector, scale) for window in windows]


def _scale(windows: Sequence[Window], cameras: Cameras) -> ResidualScale:
    """Robust standard deviations of what the windows see now."""
    pixels, depths = [], []
    for window in windows:
        off, depth_off = window.residuals(cameras)
        pixels.append(off.ravel())
        depths.append(depth_off[window.has_depth])
    return ResidualScale(
        max(_deviation(np.concatenate(pixels)), _SHARPEST.pixel),
        max(_deviation(np.concatenate(depths)), _SHARPEST.inverse_depth),
    )


def _deviation(residuals: np.ndarray) -> float:
    """Standard deviation by the median, as of normal residuals about zero."""
    return 1.4826 * float(np.median(np.abs(residuals))) if len(residuals) else 0.0


def _with_spread(inverse: np.ndarray, parts: list[Reduced]) -> np.ndarray:
    """Covariance that does not believe residuals to be independent: those of a track share the drift of its patch,
    those of a window its motion.

    What a cluster of residuals adds to the gradient at the optimum is what it would have liked to be different (the
    "sandwich" of clusters). Of three variances, by residuals, tracks and windows, the largest counts.
    """
    clusters = [np.concatenate([part.by_track for part in parts])]
    if len(parts) >= _FEWEST_FOR_SPREAD:
        clusters.append(np.array([part.g for part in parts]))
    largest = np.diag(inverse)
    for gradients in clusters:
        count = len(gradients)
        moved = gradients @ inverse
        largest = np.maximum(largest, (moved**2).sum(axis=0) * count / max(count - 1, 1))
    factor = np.sqrt(largest / np.diag(inverse))
    return inverse * np.outer(factor, factor)
