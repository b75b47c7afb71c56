"""A room seen by a camera that pans while a box slides through, ray cast: frames for tests of moving things."""

import numpy as np

from dsmap.frame import Frame, Intrinsics
from dsmap.kernels.camera import make_camera
from dsmap.tools.twins import images as reference

INTRINSICS = Intrinsics(160, 120, 140.0, 140.0, 79.5, 59.5)
HALF = np.array([0.25, 0.4, 0.25])
"""Half sizes of the box [m]; world axes as the first camera's: x right, y down, z forward."""
FLOOR, BACK, SIDE = 1.0, 3.0, 2.0


def pose(number: int) -> np.ndarray:
    """T_world_camera: a slow sway."""
    a = 0.08 * np.sin(number / 25)
    T = np.eye(4)
    T[:3, :3] = [[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]]
    T[:3, 3] = [0.05 * np.sin(number / 20), 0.02 * np.sin(number / 13), 0]
    return T


def frame(number: int, box: np.ndarray | None, rng: np.random.Generator | None = None) -> Frame:
    """One frame; `box` is the centre of the box, None without it; `rng` adds a Kinect's depth noise."""
    T = pose(number)
    d = reference.rays(make_camera(INTRINSICS)) @ T[:3, :3].T
    o = T[:3, 3]
    depth = np.full(d.shape[:2], np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for axis, value in ((1, FLOOR), (2, BACK), (0, -SIDE), (0, SIDE), (1, -1.5)):
            t = (value - o[axis]) / d[..., axis]
            depth = np.where((t > 0) & (t < depth), t, depth)
        shade = np.zeros(depth.shape)
        if box is not None:
            low, high = (box - HALF - o) / d, (box + HALF - o) / d
            near, far = np.minimum(low, high).max(-1), np.maximum(low, high).min(-1)
            hit = (near < far) & (near > 0) & (near < depth)
            depth, shade = np.where(hit, near, depth), np.where(hit, 0.25, 0.0)
    p = o + depth[..., None] * d
    light = (
        0.4 + shade + 0.12 * np.sin(7 * p[..., 0] + 1) * np.cos(6 * p[..., 1]) + 0.1 * np.sin(8 * p[..., 2])
    )
    rgb = np.repeat((255 * light.clip(0, 1))[..., None], 3, axis=2).astype(np.uint8)
    if rng is not None:
        depth = depth + rng.normal(0, 0.0012, depth.shape) * depth**2
    return Frame(number, number / 30, rgb, depth.astype(np.float32), T)


def slide(number: int, start: int = 40, stop: int = 100) -> np.ndarray:
    """Centre of the box: at rest on the left, pushed to the right, at rest there."""
    share = np.clip((number - start) / (stop - start), 0, 1)
    return np.array([-0.9 + 1.6 * share, FLOOR - HALF[1], 2.2])


def distance_to_box(points: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Signed distance [m] of world points, shape (N, 3), to the surface of the box; negative inside."""
    q = np.abs(points - box) - HALF
    return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)


def distance_to_room(points: np.ndarray) -> np.ndarray:
    """Distance [m] of points to the nearest of floor, ceiling and walls."""
    planes = [
        points[:, 1] - FLOOR,
        points[:, 1] + 1.5,
        points[:, 2] - BACK,
        points[:, 0] + SIDE,
        points[:, 0] - SIDE,
    ]
    return np.abs(np.stack(planes)).min(axis=0)
