"""A closed, textured room that a camera can turn around in, ray cast in NumPy; and drift put into a map."""

import numpy as np

from dsmap.frame import Frame, Intrinsics
from dsmap.fusion.config import MapConfig
from dsmap.fusion.lie import exp_se3
from dsmap.fusion.mapper import Mapper
from dsmap.kernels.camera import Camera, make_camera
from dsmap.tools.twins import images as reference

INTRINSICS = Intrinsics(128, 96, 110.0, 110.0, 63.5, 47.5)
_CAMERA = make_camera(INTRINSICS)
_LOW, _HIGH = np.array([-2.2, -1.2, -1.8]), np.array([2.4, 1.3, 2.1])
_BOXES = [
    (np.array([-0.6, 0.5, 1.3]), np.array([0.2, 1.3, 1.8])), (np.array([1.5, -0.2, -0.5]), np.array([2.4, 1.3, 0.4])),
    (np.array([-2.2, 0.3, -1.0]), np.array([-1.5, 1.3, 0.2])), (np.array([0.1, 0.6, -1.8]), np.array([1.0, 1.3, -1.2])),
]  # fmt: skip
TURN = np.deg2rad(3.0)
"""Between two frames [rad]."""
AWAY, DRIFT = 52, np.array([0.06, 0.0, 0.05, 0.0, 0.02, 0.0])
"""Steps of the turn away, and the twist that is put into the map as its drift."""


def look(
    T_world_camera: np.ndarray, paper: int = 0, camera: Camera = _CAMERA
) -> tuple[np.ndarray, np.ndarray]:
    """Colour and depth of the room with four boxes in it; another `paper` is other wallpaper on the same walls."""
    direction = reference.rays(camera) @ T_world_camera[:3, :3].T
    origin = T_world_camera[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.maximum((_LOW - origin) / direction, (_HIGH - origin) / direction).min(axis=-1)
        for low, high in _BOXES:
            a, b = (low - origin) / direction, (high - origin) / direction
            near, far = np.minimum(a, b).max(axis=-1), np.maximum(a, b).min(axis=-1)
            depth = np.where((near < far) & (near > 0) & (near < depth), near, depth)
    p = origin + depth[..., None] * direction
    waves = [(7, 4, 2, 0.0), (-3, 6, 8, 1.0), (5, -5, 6, 2.0), (11, 3, -9, 0.5)]
    light = sum(np.sin(p @ np.roll(k[:3], paper) * (1 + 0.3 * paper) + k[3]) for k in waves)
    colour = np.stack([0.5 + 0.1 * light, 0.5 + 0.1 * np.roll(light, 2, axis=1), 0.6 - 0.08 * light], axis=-1)
    return (255 * colour.clip(0, 1)).astype(np.uint8), depth.astype(np.float32)


def pose(step: float) -> np.ndarray:
    """T_world_camera after `step` frames of turning about the vertical, on a small circle."""
    return exp_se3(np.array([0.0, 0.0, 0.0, 0.0, TURN * step, 0.0])) @ exp_se3(
        np.array([0.1, 0, 0.25, 0, 0, 0])
    )


def frame(index: int, step: float, paper: int = 0) -> Frame:
    """What the camera sees after `step` steps."""
    T = pose(step)
    return Frame(index, index / 30, *look(T, paper), T)


def mapper(window: int = 15, **changes) -> Mapper:
    """A mapper of the room whose active window is short."""
    config = MapConfig(depth_max=6.0)
    config.surfels.active_window = window
    config.loops.max_covariance = (
        1e-3  # the drift is put in so fast that a later frame meets surfaces bent by it
    )
    config.loops.negligible = 0.02  # and after so short a way it is 3 cm
    for name, value in changes.items():
        setattr(config.loops, name, value)
    return Mapper(config, INTRINSICS)


def drift(m: Mapper, xi: np.ndarray, first: int) -> None:
    """Bend a mapper's world as drift would have: nothing before frame `first`, exp(xi^) for what is new now."""
    last = m.time - 1

    def bend(time: int) -> np.ndarray:
        return exp_se3(xi * np.clip((time - first) / (last - first), 0, 1))

    surfels = m.surfels.numpy()
    for time in np.unique(surfels["t_created"]):
        of, T = surfels["t_created"] == time, bend(int(time))
        surfels["position"][of] = surfels["position"][of] @ T[:3, :3].T + T[:3, 3]
        surfels["normal"][of] = surfels["normal"][of] @ T[:3, :3].T
    m.trajectory.set_poses(np.array([bend(time) for time in range(m.time)]) @ m.trajectory.poses)
    m.model.blocks.forget()
    m.T_world_camera = m.trajectory[-1].T_world_camera.copy()
    m.model.predict(m.T_world_camera)
