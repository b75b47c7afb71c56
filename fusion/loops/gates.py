"""What a loop must pass before the map is bent for it."""

from dataclasses import dataclass

import numpy as np

from dsmap.fusion.config import LoopConfig
from dsmap.fusion.surfels.model_view import ModelView
from dsmap.fusion.tracking.agreement import correlation
from dsmap.fusion.tracking.tracker import Health, Tracker
from dsmap.kernels.types import ModelMaps, Surface

_SLACK = 0.03
_SLACK_Z2 = 0.01
"""Two depths are one surface if they differ by less than _SLACK [m] + _SLACK_Z2 [1/m] x depth^2."""
_NEAR = 0.3
"""Depths that differ by more [m] are different surfaces, whatever the drift that a local loop can take out."""


@dataclass
class Overlap:
    """How the active and the inactive view from one pose cover each other; shares of the image."""

    both: float
    """Pixels that see a surface in either view at about the same depth: what registration can work with. The
    inactive view alone also shows what lies behind the active walls."""
    same: float
    """Of these and those where the inactive surface stands in front, the share where both are one surface."""
    ncc: float
    """Correlation of their intensities there, local mean taken off; 1 where they were not compared."""


def view_overlap(active: Surface, inactive: Surface | ModelMaps, colours: bool = False) -> Overlap:
    """Compare two views of one camera; `colours`, too, where both have an intensity."""
    a, b = (view.vertex.numpy()[..., 2] for view in (active, inactive))
    seen = (a > 0) & (b > 0)
    behind = b - a
    both = seen & (np.abs(behind) < _NEAR)
    same = both & (np.abs(behind) < _SLACK + _SLACK_Z2 * a * a)
    against = np.count_nonzero(seen & (behind < _NEAR))
    return Overlap(
        both=np.count_nonzero(both) / a.size,
        same=np.count_nonzero(same) / against if against else 0.0,
        ncc=correlation(active.intensity.numpy(), inactive.intensity.numpy(), same)
        if colours and isinstance(inactive, Surface)
        else 1.0,
    )


def reason_to_reject_loop(
    health: Health,
    config: LoopConfig,
    seen: Overlap | None = None,
    shift: float = 0.0,
    max_shift: float = np.inf,
) -> str:
    """Why a registration of the active view to the inactive one is not believed, in words; empty if it is.

    Args:
        health: of the registration.
        seen: how the views overlap, rendered where the registration puts the camera.
        shift: RMS distance [m] by which a second registration moved the points, at most `max_shift`.
    """
    mean_square, cofactor = health.rms_icp**2, float(np.max(health.cofactor))
    reasons = [
        (not health.tracked, health.reason),
        (health.inliers < config.min_inliers, f"only {health.inliers:.0f} pixels match"),
        (mean_square > config.max_mean_square, f"mean squared distance {mean_square:.1e} m^2"),
        (cofactor > config.max_covariance, f"covariance {cofactor:.1e}"),
        (shift > max_shift, f"a second registration moved on by {shift * 1e3:.1f} mm"),
        (
            seen is not None and seen.same < config.min_agreement,
            f"only {seen.same if seen else 0:.0%} of the surface agree",
        ),
        (
            seen is not None and seen.ncc < config.min_ncc,
            f"the colours do not correlate ({seen.ncc if seen else 0:.2f})",
        ),
    ]
    return next((text for bad, text in reasons if bad), "")


def explained_rms(
    tracker: Tracker, level: int, active: ModelView, inactive: ModelView, seen: Overlap
) -> tuple[float, float]:
    """How much of the distance between two views from one pose a rigid motion would take away.

    One Gauss-Newton step xi says it: RMS of n . (t + omega x p) = sqrt(b^T A^-1 b / n). Noise, which no
    motion explains, leaves it at zero, and so do directions that a strip of the image cannot see.

    Returns:
        That RMS [m], and the share of the pixels seen in both views that are associated.
    """
    source = active.level(level)
    icp, _ = tracker.normal_equations(level, source, inactive.level(level))(np.eye(4))
    if icp.count == 0:
        return float(np.inf), 0.0
    step = np.linalg.lstsq(icp.A, icp.b, rcond=1e-4)[0]
    stride = tracker.stride[level]
    pixels = seen.both * source.vertex.shape[0] * source.vertex.shape[1] / stride**2
    return float(np.sqrt(max(icp.b @ step, 0.0) / icp.count)), icp.count / max(pixels, 1.0)


def rms_shift(vertex: np.ndarray, T: np.ndarray) -> float:
    """RMS distance [m] by which T moves the points of a vertex map, shape (H, W, 3)."""
    points = vertex[::4, ::4].reshape(-1, 3)
    points = points[points[:, 2] > 0].astype(np.float64)
    if len(points) == 0:
        return 0.0
    moved = points @ T[:3, :3].T + T[:3, 3] - points
    return float(np.sqrt((moved**2).sum(axis=1).mean()))
