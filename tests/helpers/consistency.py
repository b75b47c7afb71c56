"""Do depth, labels and poses of rendered frames agree? One frame is projected into another and compared there."""

from dataclasses import dataclass

import cv2
import numpy as np

from dsmap.frame import Intrinsics
from dsmap.sim_scenes.recording.record import RenderedFrame
from dsmap.sim_scenes.render.renderer import pixel_rays

HIDDEN_M = 0.03
"""A point this far behind what the other frame sees is hidden there [m]."""
BAND_PX = 2
"""Pixels this close to an edge of depth or label, in either frame, are not compared."""


@dataclass(frozen=True)
class Agreement:
    """How well two frames agree where both see the same surface, away from edges."""

    depth_error: float
    """Median absolute difference of depth [m]; NaN where nothing could be compared."""
    outliers: float
    """Share of points off by more than 1 cm and not hidden."""
    label: float
    """Share of points with the same class in both."""
    compared: int
    """Points."""


def smooth_pixels(depth: np.ndarray, label: np.ndarray, band: int = BAND_PX) -> np.ndarray:
    """Pixels with depth that are off edges of depth (a bend over 1 cm + 1 %) and of labels, bool (H, W)."""
    bend = np.abs(cv2.Laplacian(depth.astype(np.float32), cv2.CV_32F)) > 0.01 + 0.01 * depth
    kernel = np.ones((3, 3), np.uint8)
    border = cv2.dilate(label, kernel) != cv2.erode(label, kernel)
    wide = np.ones((2 * band + 1,) * 2, np.uint8)
    return (cv2.dilate((bend | border | (depth <= 0)).astype(np.uint8), wide) == 0) & (depth > 0)


def agreement(a: RenderedFrame, b: RenderedFrame, camera: Intrinsics) -> Agreement:
    """Project frame `a` into frame `b` (true depth; nothing may have moved between them) and compare.

    What `b` sees is taken as a plane through the pixel, because a projected point lies between pixel centres.
    """
    rays = pixel_rays(camera)
    points = rays / rays[..., 2:] * a.true_depth[..., None]
    points = points[smooth_pixels(a.true_depth, a.label)].astype(np.float64)
    label = a.label[smooth_pixels(a.true_depth, a.label)]
    T_b_a = np.linalg.inv(b.T_world_camera) @ a.T_world_camera
    points = points @ T_b_a[:3, :3].T + T_b_a[:3, 3]
    ahead = points[:, 2] > 0.1
    points, label = points[ahead], label[ahead]
    if len(points) == 0:
        return Agreement(float("nan"), 0.0, float("nan"), 0)
    lens = None if camera.distortion is None else np.array(camera.distortion)
    uv = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.K, lens)[0].reshape(-1, 2)
    column, row = np.rint(uv).astype(int).T
    seen = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    seen[seen] = smooth_pixels(b.true_depth, b.label)[row[seen], column[seen]]
    column, row, uv, z, label = column[seen], row[seen], uv[seen], points[seen, 2], label[seen]
    slope_y, slope_x = np.gradient(b.true_depth.astype(np.float64))
    expected = b.true_depth[row, column] + (
        slope_x[row, column] * (uv[:, 0] - column) + slope_y[row, column] * (uv[:, 1] - row)
    )
    shown = z < expected + HIDDEN_M
    error = np.abs(z - expected)[shown]
    if len(error) == 0:
        return Agreement(float("nan"), 0.0, float("nan"), 0)
    same = label[shown] == b.label[row[shown], column[shown]]
    return Agreement(float(np.median(error)), float((error > 0.01).mean()), float(same.mean()), len(error))
