"""Two walls with random patterns: pictures that features can be matched in."""

import cv2
import numpy as np

from dsmap.frame import Intrinsics

CAMERA = Intrinsics(320, 240, 290.0, 290.0, 159.5, 119.5)


def look(T_world_camera: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two walls with random patterns, 2 m and 3 m away, left and right of x = 0."""
    x, y = np.meshgrid(np.arange(320), np.arange(240))
    rays = np.stack([(x - CAMERA.cx) / CAMERA.fx, (y - CAMERA.cy) / CAMERA.fy, np.ones(x.shape)], axis=-1)
    rays = rays @ T_world_camera[:3, :3].T
    origin = T_world_camera[:3, 3]
    near, far = ((z - origin[2]) / rays[..., 2] for z in (2.0, 3.0))
    left = origin[0] + near * rays[..., 0] < 0
    depth = np.where(left, near, far)
    points = origin + depth[..., None] * rays
    noise = np.random.default_rng(0).integers(0, 255, (400, 400)).astype(np.float32)
    pattern = cv2.GaussianBlur(cv2.resize(noise, (1600, 1600), interpolation=cv2.INTER_CUBIC), (0, 0), 2)
    u, v = ((points[..., k] * 200 + 800).astype(np.float32) for k in (0, 1))
    grey = cv2.remap(pattern, u, v, cv2.INTER_LINEAR).clip(0, 255).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2), depth.astype(np.float32)
