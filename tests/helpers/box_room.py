"""A box-shaped room, ray cast: points and normals of what a camera in it sees, tilted and rolled as one likes."""

import numpy as np

from dsmap.frame import Frame, Intrinsics

CAMERA = Intrinsics(160, 120, 100.0, 100.0, 79.5, 59.5)


def turned(pitch_deg: float, roll_deg: float) -> np.ndarray:
    """R_camera_room of a camera that looks down by `pitch` and is rolled clockwise; the room's y points down."""
    p, r = np.deg2rad([-pitch_deg, roll_deg])
    pitch = np.array([[1, 0, 0], [0, np.cos(p), -np.sin(p)], [0, np.sin(p), np.cos(p)]]).T
    roll = np.array([[np.cos(r), -np.sin(r), 0], [np.sin(r), np.cos(r), 0], [0, 0, 1]]).T
    return roll @ pitch


def room(R_camera_room: np.ndarray, above: float = 1.4, table: float = 0.0, noise: float = 0.0):
    """Points and normals, shape (H, W, 3), of a box-shaped room from `above` its floor; a table in its middle."""
    y, x = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays = np.stack([(x - CAMERA.cx) / CAMERA.fx, (y - CAMERA.cy) / CAMERA.fy, np.ones(x.shape)], axis=-1)
    d = rays @ R_camera_room  # in the room's axes
    yaw = np.deg2rad(30)
    across, ahead = (
        np.array([np.cos(yaw), 0, -np.sin(yaw)]),
        np.array([np.sin(yaw), 0, np.cos(yaw)]),
    )
    down = np.array([0, 1.0, 0])
    planes = [
        (down, above), (-down, 2.5 - above), (across, 2.0), (-across, 1.5), (ahead, 3.0), (-ahead, 2.0)
    ]  # fmt: skip
    depth, normal = np.full(x.shape, np.inf), np.zeros((*x.shape, 3))
    for n, distance in planes:
        with np.errstate(divide="ignore"):
            t = np.where(d @ n > 1e-9, distance / (d @ n), np.inf)
        normal[t < depth] = -n
        depth = np.minimum(depth, t)
    if table:
        t = (above - table) / np.maximum(d[..., 1], 1e-9)
        on = (t < depth) & (np.abs(t * d[..., 0]) < 0.8) & (t * d[..., 2] < 2.0)
        normal[on], depth = -down, np.where(on, t, depth)
    rng = np.random.default_rng(0)
    normal = normal @ R_camera_room.T + rng.normal(0, noise, normal.shape)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return depth[..., None] * rays, normal


def frame(index: int, R_camera_room: np.ndarray, scale: float = 1.0) -> Frame:
    """A frame from there, with its true pose; the world's axes are those of the room, and y points down."""
    T = np.eye(4)
    T[:3, :3] = R_camera_room.T
    points, normals = room(R_camera_room)
    light = 127 + 100 * np.sin(5 * points).prod(axis=-1, keepdims=True) * np.ones(3)
    depth = (scale * points[..., 2]).astype(np.float32)
    label = np.where(normals @ (R_camera_room @ [0, -1, 0]) > 0.9, 5, 12).astype(np.uint8)
    return Frame(index, index / 30, light.astype(np.uint8), depth, T, label)
