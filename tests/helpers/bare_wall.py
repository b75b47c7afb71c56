"""A white wall as a cheap camera films it: corners darkened, noise, JPEG; to its right stands a cupboard."""

import cv2
import numpy as np

from dsmap.tools.twins import images as reference
from dsmap.tools.twins.corner import INTRINSICS, LEVEL_CAMERAS

WALL_Z, CUPBOARD_X, CUPBOARD_Z = 1.6, 1.2, 1.25
"""Where they are [m], from a camera at the origin that looks at the wall; the cupboard goes on to the right."""


def film(T_world_camera: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Colour, uint8, and depth [m], float32, from there, both with a sensor's noise."""
    direction = reference.rays(LEVEL_CAMERAS[0]) @ T_world_camera[:3, :3].T
    origin = T_world_camera[:3, 3]
    depth = (WALL_Z - origin[2]) / direction[..., 2]
    front = (CUPBOARD_Z - origin[2]) / direction[..., 2]
    with np.errstate(divide="ignore"):
        side = (CUPBOARD_X - origin[0]) / direction[..., 0]
    p = origin + front[..., None] * direction
    at_front = (p[..., 0] > CUPBOARD_X) & (np.abs(p[..., 1]) < 0.5)
    q = origin + side[..., None] * direction
    at_side = (side > 0) & (q[..., 2] > CUPBOARD_Z) & (q[..., 2] < WALL_Z) & (np.abs(q[..., 1]) < 0.5)
    light = np.full(depth.shape, 0.8)
    light = np.where(at_side, 0.4 + 0.2 * np.sin(25 * q[..., 1]), light)
    light = np.where(at_front, 0.5 + 0.2 * np.sin(20 * p[..., 0]) * np.cos(25 * p[..., 1]), light)
    depth = np.where(at_side, side, np.where(at_front, front, depth))
    y, x = np.mgrid[-1 : 1 : INTRINSICS.height * 1j, -1 : 1 : INTRINSICS.width * 1j]
    light = 255 * light * (1 - 0.2 * (x * x + y * y))
    rgb = (light[..., None] + rng.normal(0, 3, (*light.shape, 3))).clip(0, 255).astype(np.uint8)
    rgb = cv2.imdecode(cv2.imencode(".jpg", rgb, [cv2.IMWRITE_JPEG_QUALITY, 90])[1], cv2.IMREAD_COLOR)
    step = 2.85e-3 * depth**2  # a Kinect's disparity steps
    noisy = depth + rng.normal(0, 0.6, depth.shape) * step
    return rgb, (np.round(noisy / step) * step).astype(np.float32)
