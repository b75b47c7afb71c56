"""Depth like a RealSense D435's: active stereo, whose error is one of disparity.

Depth error: Intel's rule for the D400 series, RMS = z^2 subpixel / (f b) with f = 0.5 X_res / tan(HFOV / 2)
(A. Grunnet-Jepsen, J. N. Sweetser, J. Woodfill, Best-Known-Methods for Tuning Intel RealSense D400 Depth
Cameras for Best Performance, 2018; the same geometry, 90 degrees of HFOV and 848 pixels, in Subpixel Linearity
Improvement for Intel RealSense Depth Camera D400 Series, 2019). That the error grows with the square of depth, and
with the angle of incidence, was measured by M. S. Ahn et al., Analysis and Noise Modeling of the Intel RealSense
D435 for Mobile Robots, Ubiquitous Robots 2019.
"""

import cv2
import numpy as np

from dsmap.frame import Intrinsics
from dsmap.sim_scenes.sensors.common import correlated, depth_edges, incidence

BASELINE_M = 0.05
FOCAL_PX = 0.5 * 848 / np.tan(np.radians(90.0) / 2)
"""Of the stereo pair at its 848 columns [px]."""
SUBPIXEL = 0.08
"""RMS error of the disparity where there is texture (the projector's dots bring some everywhere) [px]."""
STEP = 1.0 / 32
"""Disparities come in steps of this [px]."""
_RANGE_M = (0.28, 6.0)
"""Least depth at 848 columns; farther than this the error is over 13 cm [m]."""
BLOCK_PX = 4.0
"""Matching windows make errors alike over about this distance at a width of 640 [px]."""


def d435_depth(
    depth: np.ndarray, camera: Intrinsics, glass: np.ndarray, rgb: np.ndarray, *, seed: int, frame: int
) -> np.ndarray:
    """Degrade true planar depth [m], (H, W), like a D435; float32 (H, W), 0 where nothing was measured.

    In order: windows drag the nearer depth over edges by a few pixels; disparity gets noise correlated over a
    matching window, more at grazing angles and on surfaces without texture, and is quantised; depth is lost on
    glass, in the band that only one of the cameras sees (left of near things), where a textureless surface is
    far, and out of range.
    """
    rng = np.random.default_rng([seed, frame, 435])
    height, width = depth.shape
    scale = width / 640.0
    fattened = _fattened(depth, rng, scale)
    cosine = incidence(fattened, camera)
    z = np.where(fattened > 0, fattened, 1.0).astype(np.float32)
    texture = _texture(rgb, scale)
    worse = (1.0 + 0.6 * (1.0 - texture)) / np.maximum(np.sqrt(cosine), 0.4)
    noise = correlated(rng, height, width, BLOCK_PX * scale / 2)
    disparity = FOCAL_PX * BASELINE_M / z + SUBPIXEL * worse.astype(np.float32) * noise
    disparity = np.round(disparity / STEP) * STEP
    measured = FOCAL_PX * BASELINE_M / np.maximum(disparity, STEP)
    valid = (fattened > _RANGE_M[0]) & (fattened < _RANGE_M[1]) & (measured < _RANGE_M[1]) & ~glass
    valid &= ~_half_hidden(depth, BASELINE_M * camera.fx)
    # The dots fade with the square of distance: matching fails in patches where there is nothing else to see.
    faint = (1.0 - texture) * np.square(z / 4.0)
    valid &= correlated(rng, height, width, 4 * scale) < 3.2 - 1.6 * faint
    return np.where(valid, measured, 0).astype(np.float32)


def _fattened(depth: np.ndarray, rng: np.random.Generator, scale: float) -> np.ndarray:
    """Edges moved outwards by up to half a window: what is near covers a rim of what is behind it."""
    reach = max(1, round(2.0 * scale))
    holes = np.where(depth > 0, depth, np.float32(1e3))
    near = cv2.erode(holes, np.ones((2 * reach + 1,) * 2, np.uint8))
    jumps = (holes - near > 0.05 * near) & (near < 1e3)
    taken = jumps & (correlated(rng, depth.shape[0], depth.shape[1], 2.0) > 0.0)
    return np.where(taken, near, depth).astype(np.float32)


def _texture(rgb: np.ndarray, scale: float) -> np.ndarray:
    """How well a window can be matched by what is painted on the surface: 0 = bare, 1 = rich; float32 (H, W)."""
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32)
    size = (0, 0)
    mean = cv2.GaussianBlur(grey, size, max(BLOCK_PX * scale, 1.0))
    power = cv2.GaussianBlur(grey * grey, size, max(BLOCK_PX * scale, 1.0)) - mean * mean
    return np.clip(np.sqrt(np.maximum(power, 0)) / 10.0, 0, 1)


def _half_hidden(depth: np.ndarray, baseline_focal: float) -> np.ndarray:
    """Pixels that the right camera does not see behind something nearer, bool (H, W)."""
    column = np.arange(depth.shape[1], dtype=np.float32)[None]
    seen = np.where(depth > 0, column - baseline_focal / np.maximum(depth, 0.1), np.float32(np.inf))
    nearest = np.minimum.accumulate(seen[:, ::-1], axis=1)[:, ::-1]
    return np.isfinite(seen) & (seen > nearest + 0.5) & (cv2.dilate(depth_edges(depth), np.ones((3, 31))) > 0)
