"""A textured corner of three planes, ray cast: what a small camera sees of it, and how far points are from it.

For tests that want a curved surface, too, there may be a ball in it.
"""

import numpy as np

from dsmap.frame import Intrinsics
from dsmap.fusion.lie import exp_se3
from dsmap.kernels.camera import make_camera
from dsmap.tools.twins import images as reference

INTRINSICS = Intrinsics(96, 72, 90.0, 91.0, 47.2, 35.9)
LEVEL_CAMERAS = [make_camera(INTRINSICS.scaled(96 >> level, 72 >> level)) for level in range(3)]
READOUT = 0.026
"""Of a rolling shutter [s]."""
TWIST = np.array([0.3, -0.4, 0.2, 0.5, 0.9, -0.4])
"""Walking pace and 60 degrees a second."""
_PLANES = [((0, 0, -1), -2.5), ((1, 0, -0.3), -1.6), ((0, -1, -0.2), -1.7)]


def view(T_world_camera: np.ndarray, ball: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Colour, uint8, and depth [m], float32, from there."""
    direction = reference.rays(LEVEL_CAMERAS[0]) @ T_world_camera[:3, :3].T
    origin = T_world_camera[:3, 3]
    depth = np.full(direction.shape[:2], np.inf)
    for normal, offset in _PLANES:
        n = np.array(normal, dtype=np.float64)
        with np.errstate(divide="ignore"):
            t = (offset - origin @ n) / (direction @ n)
        depth = np.where((t > 0) & (t < depth), t, depth)
    if ball:
        centre, size = np.array([0.2, 0.1, 1.8]), 0.4
        b = direction @ (origin - centre)
        a = (direction**2).sum(-1)
        disc = b**2 - a * ((origin - centre) @ (origin - centre) - size**2)
        t = (-b - np.sqrt(np.maximum(disc, 0))) / a
        depth = np.where((disc > 0) & (t > 0) & (t < depth), t, depth)
    depth[~np.isfinite(depth)] = 0
    p = origin + depth[..., None] * direction
    light = 0.5 + 0.2 * np.sin(6 * p[..., 0] + 1) * np.cos(5 * p[..., 1]) + 0.15 * np.sin(7 * p[..., 2])
    rgb = np.repeat((255 * light.clip(0, 1))[..., None], 3, axis=2)
    return rgb.astype(np.uint8), depth.astype(np.float32)


def room(T_world_camera: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same with the ball."""
    return view(T_world_camera, ball=True)


def distance(points: np.ndarray) -> np.ndarray:
    """Of world points, shape (N, 3), to the nearest plane [m]."""
    off = [np.abs(points @ np.array(n) - d) / np.linalg.norm(n) for n, d in _PLANES]
    return np.min(off, axis=0)


def rolled(T_world_camera: np.ndarray, twist: np.ndarray = TWIST) -> tuple[np.ndarray, np.ndarray]:
    """Colour and depth of the corner, each row from where the camera is when it is read."""
    height = LEVEL_CAMERAS[0].height
    times = (np.arange(height) / (height - 1) - 0.5) * READOUT
    views = [view(T_world_camera @ exp_se3(twist * t)) for t in times]
    rgb, depth = (np.stack([view[k][row] for row, view in enumerate(views)]) for k in (0, 1))
    return rgb, depth
