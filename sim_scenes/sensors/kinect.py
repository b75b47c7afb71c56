"""Depth like a Kinect v1's, and what all sensor models share: correlated noise, angles of incidence, depth edges.

The noise is C. V. Nguyen, S. Izadi, D. Lovell, Modeling Kinect Sensor Noise for Improved 3D Reconstruction and
Tracking, 3DIMPVT 2012. It agrees with the theory of K. Khoshelham, S. O. Elberink, Accuracy and Resolution of Kinect
Depth Data for Indoor Mapping Applications, Sensors 12(2), 2012, sigma_z = 1.425e-3 z^2 [m], which follows from half a
step of disparity.
"""

import cv2
import numpy as np

from dsmap.frame import Intrinsics
from dsmap.sim_scenes.sensors.common import correlated, depth_edges, incidence

BASELINE_M, FOCAL_PX = 0.075, 580.0
"""Kinect v1 projector baseline and infrared focal length at 640 pixels."""
DISPARITY_STEP = 0.125
"""The sensor's disparity resolution [px]."""
_RANGE_M = (0.4, 5.0)
"""Nothing is measured outside."""
GRAZING_DEG = 80.0
"""Surfaces seen at a larger angle from their normal return nothing."""


def kinect_sigma(depth: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """Standard deviation along the ray [m]; Nguyen, Izadi & Lovell 2012, Eq. 3 with its grazing-angle term.

    sigma_z = 0.0012 + 0.0019 (z - 0.4)^2 + 0.0001 / sqrt(z) * theta^2 / (pi/2 - theta)^2.
    """
    theta = np.arccos(np.clip(cosine, 0.0, 1.0))
    grazing = np.square(theta / np.maximum(np.pi / 2 - theta, 0.1))
    return 0.0012 + 0.0019 * np.square(depth - 0.4) + 0.0001 / np.sqrt(np.maximum(depth, 0.1)) * grazing


def kinect_depth(
    depth: np.ndarray, camera: Intrinsics, glass: np.ndarray, *, seed: int, frame: int
) -> np.ndarray:
    """Degrade true depth like a Kinect v1.

    In order: edges jitter sideways by about half a pixel; disparity gets spatially correlated noise of
    Nguyen's standard deviation and is quantised to 1/8 px; depth is lost at grazing angles, beside depth
    edges, in the projector's shadow (on the left of near objects), on glass, and out of range.

    Args:
        depth: true planar depth [m], (H, W); 0 where nothing is.
        glass: bool (H, W), surfaces the sensor cannot see.
        seed, frame: the noise depends on these only.

    Returns:
        float32 (H, W) [m], 0 where nothing was measured.
    """
    rng = np.random.default_rng([seed, frame, 4711])
    height, width = depth.shape
    scale = width / 640.0
    shifted = _lateral_jitter(depth, rng, 0.5 * max(scale, 0.5))
    cosine = incidence(shifted, camera)
    focal = FOCAL_PX * scale
    valid = (shifted > _RANGE_M[0]) & (shifted < _RANGE_M[1]) & ~glass
    z = np.where(shifted > 0, shifted, 1.0).astype(np.float32)
    disparity = BASELINE_M * focal / z
    # A depth error dz is a disparity error b f dz / z^2 (first order).
    sigma = kinect_sigma(z, cosine) * BASELINE_M * focal / np.square(z)
    disparity = disparity + sigma.astype(np.float32) * correlated(rng, height, width, scale)
    step = DISPARITY_STEP * scale
    disparity = np.round(disparity / step) * step
    noisy = BASELINE_M * focal / np.maximum(disparity, step)
    edge = depth_edges(depth)
    lost = (cv2.dilate(edge, np.ones((3, 3), np.uint8)) > 0) & (
        rng.random((height, width), np.float32) < 0.55
    )
    valid &= ~_projector_shadow(shifted, BASELINE_M * focal)
    valid &= (cosine > np.cos(np.radians(GRAZING_DEG))) & ~lost & (noisy < _RANGE_M[1])
    # Far and dim returns drop out at random, in patches.
    valid &= ~((z > 4.2) & (correlated(rng, height, width, 2 * scale) > 5.5 - z))
    return np.where(valid, noisy, 0).astype(np.float32)


def _lateral_jitter(depth: np.ndarray, rng: np.random.Generator, sigma: float) -> np.ndarray:
    """Resample depth (nearest) at positions displaced by about `sigma` pixels, correlated over 4 px."""
    height, width = depth.shape
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    x += sigma * correlated(rng, height, width, 2.0)
    y += sigma * correlated(rng, height, width, 2.0)
    moved = cv2.remap(depth, x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
    # Only edges move: inside a surface the displaced sample would add slope-dependent noise of its own.
    return np.where(np.abs(moved - depth) > 0.02 * np.maximum(depth, 0.1), moved, depth)


def _projector_shadow(depth: np.ndarray, baseline_focal: float) -> np.ndarray:
    """Pixels that the projector, a baseline to the right of the camera, cannot light; bool (H, W).

    A pixel x appears in the projector at x - b f / z; it lies in shadow where a pixel further right
    appears further left. Bands of up to 20 px on the left of near objects follow.
    """
    column = np.arange(depth.shape[1], dtype=np.float32)[None]
    seen = np.where(depth > 0, column - baseline_focal / np.maximum(depth, 0.1), np.float32(np.inf))
    nearest = np.minimum.accumulate(seen[:, ::-1], axis=1)[:, ::-1]
    return np.isfinite(seen) & (seen > nearest + 0.5)
