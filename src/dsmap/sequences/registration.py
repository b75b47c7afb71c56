"""Two cameras, one frame: depth brought to the colour camera, or colour to the depth camera."""

import cv2
import numpy as np

from dsmap.frame import Intrinsics
from dsmap.sequences.images import clean_depth


def register_depth(depth: np.ndarray, intrinsics: Intrinsics, T_color_depth: np.ndarray) -> np.ndarray:
    """Depth seen from the depth camera as the colour camera (same intrinsics) would see it, nearest wins.

    Args:
        depth: planar depth of the depth camera [m], float32, shape (H, W).
        T_color_depth: takes points of the depth camera into the colour camera, shape (4, 4).
    """
    y, x = np.nonzero(depth)
    z = depth[y, x].astype(np.float64)
    points = np.stack([(x - intrinsics.cx) / intrinsics.fx * z, (y - intrinsics.cy) / intrinsics.fy * z, z])
    points = T_color_depth[:3, :3] @ points + T_color_depth[:3, 3:4]
    points = points[:, points[2] > 0]
    columns = np.floor(intrinsics.fx * points[0] / points[2] + intrinsics.cx + 0.5).astype(np.int64)
    rows = np.floor(intrinsics.fy * points[1] / points[2] + intrinsics.cy + 0.5).astype(np.int64)
    inside = (columns >= 0) & (columns < depth.shape[1]) & (rows >= 0) & (rows < depth.shape[0])
    registered = np.full(depth.shape, np.inf, dtype=np.float32)
    np.minimum.at(registered, (rows[inside], columns[inside]), points[2, inside].astype(np.float32))
    return clean_depth(registered)


def register_colour(
    rgb: np.ndarray,
    depth: np.ndarray,
    depth_camera: Intrinsics,
    color_camera: Intrinsics,
    T_color_depth: np.ndarray,
) -> np.ndarray:
    """Colour as the depth camera would see it: each depth pixel's point is looked up in the colour image.

    This leaves the geometry as it was measured; a pixel without depth borrows that of the nearest one that
    has some, so the image has no holes. What only one of the cameras sees takes its neighbour's colour.

    Args:
        rgb: uint8, shape of color_camera, (h, w, 3).
        depth: planar depth [m], float32, shape of depth_camera, (H, W); 0 = none, not everywhere.
        T_color_depth: takes points of the depth camera into the colour camera, shape (4, 4).

    Returns:
        uint8, shape (H, W, 3), bilinear; pixels outside the colour image repeat its border.
    """
    z = _filled(depth)
    x = (np.arange(depth.shape[1], dtype=np.float32) - depth_camera.cx) / depth_camera.fx
    y = (np.arange(depth.shape[0], dtype=np.float32) - depth_camera.cy) / depth_camera.fy
    R, t = T_color_depth[:3, :3].astype(np.float32), T_color_depth[:3, 3].astype(np.float32)
    points = z[..., None] * (x[:, None] * R[:, 0] + (y[:, None] * R[:, 1] + R[:, 2])[:, None]) + t
    ahead = np.maximum(points[..., 2], 1e-3)
    columns = color_camera.fx * points[..., 0] / ahead + color_camera.cx
    rows = color_camera.fy * points[..., 1] / ahead + color_camera.cy
    maps = columns.astype(np.float32), rows.astype(np.float32)
    return cv2.remap(rgb, *maps, interpolation=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def _filled(depth: np.ndarray) -> np.ndarray:
    """Depth with every hole filled by its nearest valid pixel."""
    missing = (depth <= 0).astype(np.uint8)
    if not missing.any() or missing.all():
        return depth
    found = cv2.distanceTransformWithLabels(missing, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    nearest = np.asarray(found[1], np.int32)  # number of the nearest zero of `missing`, from 1
    values = np.zeros(int(nearest.max()) + 1, np.float32)
    valid = missing == 0
    values[nearest[valid]] = depth[valid]
    return values[nearest]
