"""How long given poses say the camera's way is, against how long depth says it is."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dsmap.fusion.calibration.bundle import Window
from dsmap.fusion.calibration.rig import Cameras
from dsmap.metrics import align_similarity

_LEAST_SPREAD_M = 0.01
"""A camera that moves less in a window says nothing about lengths (RMS)."""
_FEWEST = 3
"""Windows that are needed to tell how sure it is."""


@dataclass(frozen=True)
class PoseScale:
    """Lengths by the given poses over lengths by depth."""

    factor: float
    sigma: float
    """Standard deviation, by how well the windows agree."""


def pose_scale(windows: Sequence[Window], cameras: Cameras, frame_is_depth: bool) -> PoseScale | None:
    """The scale that the recording's own poses give depth; None where too few windows have poses and move.

    Args:
        windows: after bundle adjustment.
        frame_is_depth: whether given poses are those of the depth camera.
    """
    factors, weights = [], []
    for window in windows:
        t = window.tracks
        if t.given_centres is None:
            continue
        R, centre = window.pose_at(t.times + t.depth_after_s + cameras.offset_s)
        if frame_is_depth:
            centre = centre + R @ cameras.t_color_depth
        known = np.asarray(np.isfinite(t.given_centres).all(axis=1))
        if known.sum() < len(known) // 2:
            continue
        spread = float(np.sqrt((centre[known] - centre[known].mean(axis=0)).var(axis=0).sum()))
        if spread < _LEAST_SPREAD_M:
            continue
        factors.append(align_similarity(centre[known], t.given_centres[known])[0])
        weights.append(spread**2)
    if len(factors) < _FEWEST:
        return None
    share = np.array(weights) / sum(weights)
    mean = float(share @ factors)
    off = np.array(factors) - mean
    count = len(factors)
    return PoseScale(mean, float(np.sqrt((share**2 @ off**2) * count / (count - 1))))
