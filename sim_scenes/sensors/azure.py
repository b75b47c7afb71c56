"""Depth like an Azure Kinect's: time of flight, precise on bright surfaces, wrong at edges and in corners.

Random error: that of a time-of-flight pixel, inversely proportional to the light that returns (R. Lange, P. Seitz,
Solid-State Time-of-Flight Range Camera, IEEE J. Quantum Electronics 37, 2001), so it grows with z^2 and on dark and
oblique surfaces; its scale keeps it well within the limits that M. Toelgyessy et al., Evaluation of the Azure
Kinect and Its Comparison to Kinect V1 and Kinect V2, Sensors 21(2):413, 2021, confirm (standard deviation <= 17 mm,
distance error < 11 mm up to 3.5 m). The same paper shows flying pixels at depth edges, multipath in corners, and no
data on dark, far or oblique surfaces; how much of these is our choice.
"""

import cv2
import numpy as np

from dsmap.frame import Intrinsics
from dsmap.sim_scenes.sensors.common import correlated, depth_edges, incidence

FLOOR_M, SLOPE = 0.0007, 0.00028
"""Random error: the part that stays, and the part that grows with z^2 over the returned share of light [m, 1/m]."""
_RANGE_M = (0.5, 5.46)
"""NFOV, 2x2 binned (Azure Kinect DK hardware specification) [m]."""
WEAKEST = 0.0075
"""Least returned light, as reflectivity times cosine over z^2 [1/m^2], that is measured."""
MULTIPATH_M = 0.009
"""Greatest lengthening in concave corners [m]."""


def returned_light(depth: np.ndarray, cosine: np.ndarray, reflectivity: np.ndarray) -> np.ndarray:
    """Infrared light that comes back, relative to a white frontal surface at 1 m."""
    return reflectivity * np.clip(cosine, 0, 1) / np.square(np.maximum(depth, 0.1))


def azure_sigma(light: np.ndarray) -> np.ndarray:
    """Standard deviation of depth [m] by the light that returns (of `returned_light`)."""
    return FLOOR_M + SLOPE / np.maximum(light, 1e-3)


def azure_depth(
    depth: np.ndarray, camera: Intrinsics, glass: np.ndarray, rgb: np.ndarray, *, seed: int, frame: int
) -> np.ndarray:
    """Degrade true planar depth [m], (H, W), like an Azure Kinect; float32 (H, W), 0 where nothing was measured.

    In order: concave corners read too far (multipath); pixels across an edge read between both depths (flying
    pixels); noise by returned light; no depth on glass, where too little light returns, and out of range.
    """
    rng = np.random.default_rng([seed, frame, 2021])
    height, width = depth.shape
    scale = width / 640.0
    # Across an edge there is no angle of incidence: light comes back from the surfaces on both sides.
    edge = cv2.dilate(depth_edges(depth), np.ones((5, 5), np.uint8)) > 0
    cosine = np.where(edge, np.float32(0.8), incidence(depth, camera))
    # Infrared reflectivity is not colour; the picture's brightest channel is the best guess there is.
    reflectivity = 0.08 + 0.92 * cv2.GaussianBlur(rgb.max(2).astype(np.float32) / 255.0, (0, 0), 1.0)
    light = returned_light(depth, cosine, reflectivity)
    true = np.where(depth > 0, depth, 1.0).astype(np.float32) + _multipath(depth, scale)
    sigma = azure_sigma(light).astype(np.float32)
    noise = 0.8 * rng.standard_normal(depth.shape, np.float32) + 0.6 * correlated(rng, height, width, scale)
    measured = _flying(true, depth, rng) + sigma * noise
    valid = (depth > _RANGE_M[0]) & (depth < _RANGE_M[1]) & ~glass
    # Around the threshold pixels flicker.
    valid &= light * (1 + 0.15 * rng.standard_normal(depth.shape, np.float32)) > WEAKEST
    return np.where(valid, measured, 0).astype(np.float32)


def _multipath(depth: np.ndarray, scale: float) -> np.ndarray:
    """Lengthening [m] where surfaces face each other: light that bounces in a corner takes a longer way."""
    sigma = max(9.0 * scale, 1.5)
    weight = cv2.GaussianBlur((depth > 0).astype(np.float32), (0, 0), sigma)
    around = cv2.GaussianBlur(depth.astype(np.float32), (0, 0), sigma) / np.maximum(weight, 1e-3)
    # Its surroundings are nearer than a point in a hollow; steps of depth are edges and not hollows.
    hollow = np.clip(depth - around, 0, 0.1)
    smooth = 1.0 - cv2.GaussianBlur(
        cv2.dilate(depth_edges(depth), np.ones((3, 3))).astype(np.float32), (0, 0), sigma / 2
    )
    return MULTIPATH_M * np.clip(hollow / 0.03, 0, 1) * np.clip(smooth, 0, 1) ** 4


def _flying(true: np.ndarray, depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Pixels along edges get a mixture of the depths on both sides."""
    border = cv2.dilate(depth_edges(depth), np.ones((3, 3), np.uint8)) > 0
    solid = np.where(depth > 0, true, np.float32(1e3))
    near = cv2.erode(solid, np.ones((3, 3), np.uint8))
    far = cv2.dilate(np.where(depth > 0, true, 0).astype(np.float32), np.ones((3, 3), np.uint8))
    share = rng.random(depth.shape, np.float32)
    mixes = border & (rng.random(depth.shape, np.float32) < 0.6) & (near < 1e3)
    return np.where(mixes, near + share * (far - near), true).astype(np.float32)
