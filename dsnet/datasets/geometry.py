"""The geometry channels of a depth image, made by the mapper's own code: what RGB-D networks are trained on."""

from dataclasses import dataclass

import numpy as np
import warp as wp

from dsmap.frame import Intrinsics
from dsmap.gravity import LEVEL, estimate_floor, estimate_up
from dsmap.kernels.camera import make_camera
from dsmap.kernels.geometry import geometry_channels
from dsmap.kernels.preprocess import depth_in_range, smooth_depth, surface_maps
from dsmap.sequences.images import resize_nearest

DEPTH_MIN, DEPTH_MAX = 0.3, 10.0
"""Depth outside this is no measurement [m]."""


def frame_geometry(
    depth: np.ndarray,
    intrinsics: Intrinsics,
    *,
    up: np.ndarray | None = None,
    floor_height: float | None = None,
    start_up: np.ndarray | tuple[float, float, float] = LEVEL,
    depth_max: float = DEPTH_MAX,
) -> np.ndarray:
    """Inverse depth, cosine to up, height above the floor and validity (see `geometry_channels`), on the CPU.

    Call `dsmap.kernels.launch.step_aside()` first in a loader's process that was forked.

    Args:
        depth: planar depth [m], shape (H, W), 0 where there is none.
        intrinsics: of the depth image.
        up: unit vector in the camera's frame; None: estimated from the image, beginning at `start_up`.
        floor_height: of the floor along up, seen from the camera [m]; None: estimated from the image.
        depth_max: farther depth is ignored [m].

    Returns:
        float32, shape (H, W, 4).
    """
    smooth = smooth_depth(depth_in_range(depth, DEPTH_MIN, depth_max), wp.get_device("cpu"))
    vertex, normal, _, _ = surface_maps(smooth, make_camera(intrinsics))
    if up is None:
        up = estimate_up(normal.numpy(), start_up).direction
    if floor_height is None:
        floor_height = estimate_floor(vertex.numpy(), normal.numpy(), up)
    return geometry_channels(vertex, normal, up, floor_height).numpy()


@dataclass(frozen=True)
class DepthView:
    """The camera of a depth image, and how it was held where that is known."""

    intrinsics: Intrinsics
    up: tuple[float, float, float] | None = None
    """In the camera's frame; None: estimated from the image."""
    floor_height: float | None = None
    """Of the floor along up, seen from the camera [m]; None: estimated from the image."""

    @classmethod
    def of_pose(cls, intrinsics: Intrinsics, T_world_camera: np.ndarray | None) -> "DepthView":
        """Of a camera in a world that stands on z = 0, z up; None: its pose is not known."""
        if T_world_camera is None:
            return cls(intrinsics)
        x, y, z, height = map(float, T_world_camera[2])
        return cls(intrinsics, (x, y, z), -height)

    def geometry(self, depth: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        """Geometry of a depth image at another size, float16, shape (*shape, 4).

        Args:
            depth: metres, of the camera's aspect ratio, any size.
        """
        height, width = shape[:2]
        small = resize_nearest(depth, width, height)
        up = None if self.up is None else np.array(self.up)
        camera = self.intrinsics.scaled(width, height)
        return frame_geometry(small, camera, up=up, floor_height=self.floor_height).astype(np.float16)
