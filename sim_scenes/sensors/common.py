"""What the imitated sensors share: noise with a neighbourhood, angles of incidence, edges of depth."""

import cv2
import numpy as np

from dsmap.frame import Intrinsics


def correlated(rng: np.random.Generator, height: int, width: int, scale: float) -> np.ndarray:
    """Unit-variance noise, float32 (H, W), correlated over about 2 * scale pixels."""
    sigma = max(1.2 * scale, 0.6)
    white = rng.standard_normal((height, width), dtype=np.float32)
    smooth = cv2.GaussianBlur(white, (0, 0), sigma)
    radius = np.arange(-12, 13)
    kernel = np.exp(-(radius**2) / (2 * sigma**2))
    return smooth / float(np.square(kernel / kernel.sum()).sum())


def incidence(depth: np.ndarray, camera: Intrinsics) -> np.ndarray:
    """Cosine between the viewing ray and the surface normal, from depth differences; float32 (H, W)."""
    z = cv2.GaussianBlur(depth, (3, 3), 0)
    dzdx = cv2.Scharr(z, cv2.CV_32F, 1, 0) / 32
    dzdy = cv2.Scharr(z, cv2.CV_32F, 0, 1) / 32
    height, width = depth.shape
    x = ((np.arange(width, dtype=np.float32) - camera.cx) / camera.fx)[None]
    y = ((np.arange(height, dtype=np.float32) - camera.cy) / camera.fy)[:, None]
    # The normal of z(u, v): (fx z_u, fy z_v, -(z + (u - cx) z_u + (v - cy) z_v)).
    nx, ny = camera.fx * dzdx, camera.fy * dzdy
    nz = -(z + x * nx + y * ny)
    dot = np.abs(nx * x + ny * y + nz)
    length = np.sqrt(nx * nx + ny * ny + nz * nz) * np.sqrt(x * x + y * y + 1)
    return dot / np.maximum(length, 1e-9)


def depth_edges(depth: np.ndarray) -> np.ndarray:
    """1 at depth discontinuities (a jump of over 4 % to a neighbour), uint8 (H, W)."""
    low = cv2.erode(depth, np.ones((3, 3), np.uint8))
    return (depth - low > 0.04 * np.maximum(depth, 0.1)).astype(np.uint8)
