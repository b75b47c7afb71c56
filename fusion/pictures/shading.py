"""Drawing a map without OpenGL: the index-map kernel finds the surfels a view sees, NumPy shades them."""

from dataclasses import dataclass

import cv2
import numpy as np
import warp as wp

from dsmap.fusion.pictures.viewpoint import View
from dsmap.kernels.camera import make_camera
from dsmap.kernels.index_map import render_index
from dsmap.kernels.types import SurfelMap

BACKGROUND = 255
"""Gray value where there is no surfel."""
_FAR = 1e3
"""Depth limit of a virtual camera [m]: none in practice."""


@dataclass(frozen=True)
class Rendering:
    """What a view sees, shapes (H, W); index is -1 and depth 0 where there is no surfel."""

    index: np.ndarray
    depth: np.ndarray
    facing: np.ndarray
    """Cosine between the surfel's normal and the viewing ray."""


def render(surfels: SurfelMap, view: View, min_weight: float = 0.0) -> Rendering:
    """The surfels that a view sees, front sides only, of at least `min_weight` confidence."""
    shape = (view.intrinsics.height, view.intrinsics.width)
    index_map = wp.empty(shape, dtype=int, device=surfels.device)
    render_index(
        surfels,
        make_camera(view.intrinsics),
        view.T_world_camera,
        min_weight=min_weight,
        max_depth=_FAR,
        index=index_map,
    )
    index: np.ndarray = index_map.numpy()
    seen = index >= 0
    T_camera_world = np.linalg.inv(view.T_world_camera)
    arrays = surfels.numpy()
    rows = index[seen]
    point = arrays["position"][rows] @ T_camera_world[:3, :3].T.astype(np.float32) + T_camera_world[:3, 3]
    normal = arrays["normal"][rows] @ T_camera_world[:3, :3].T.astype(np.float32)
    depth, facing = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    depth[seen] = point[:, 2]
    facing[seen] = -(normal * point).sum(axis=1) / np.linalg.norm(point, axis=1)
    return Rendering(index, depth, facing)


def shaded_image(rendering: Rendering, colours: np.ndarray, shading: float) -> np.ndarray:
    """An image of a rendering.

    Args:
        colours: RGB of every surfel, uint8, shape (N, 3).
        shading: 0 leaves colours as they are, 1 shades them by normal and depth relief.

    Returns:
        RGB, uint8, shape (H, W, 3), white where there is no surfel.
    """
    seen = rendering.index >= 0
    image = np.full((*seen.shape, 3), BACKGROUND, np.uint8)
    dark = 0.55 * (1.0 - rendering.facing.clip(0, 1)) + 0.6 * (1.0 - _relief(rendering.depth))
    light = 1.0 - shading * dark
    image[seen] = colours[rendering.index[seen]] * light[seen, None].clip(0.1, 1)
    return image


def _relief(depth: np.ndarray, reach: int = 3, strength: float = 25.0) -> np.ndarray:
    """Eye-dome lighting (Boucheny 2009): pixels behind their neighbours are dark; values in (0, 1]."""
    log_depth = np.log2(np.where(depth > 0, depth, _FAR)).astype(np.float32)
    padded = cv2.copyMakeBorder(log_depth, reach, reach, reach, reach, cv2.BORDER_REPLICATE)
    height, width = depth.shape
    behind = np.zeros_like(log_depth)
    for dy, dx in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        y, x = reach * (1 + dy), reach * (1 + dx)
        behind += np.clip(log_depth - padded[y : y + height, x : x + width], 0, 0.1)
    return np.exp(-strength * behind / 4)
