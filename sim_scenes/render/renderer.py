"""What a renderer is, and what it gives: colour, planar depth and the part of the scene at every pixel."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dsmap.frame import Intrinsics
from dsmap.lens import undistort_points
from dsmap.sim_scenes.scene import Scene

RENDERERS = ("warp", "mujoco", "pyrender")


@dataclass(frozen=True)
class Image:
    """What a camera sees: arrays of shape (H, W)."""

    rgb: np.ndarray
    """uint8 (H, W, 3)."""
    depth: np.ndarray
    """Planar depth through pixel centres [m], float32; 0 where nothing was hit."""
    part: np.ndarray
    """Index into `scene.parts`, int32; -1 where nothing was hit."""


class Renderer(Protocol):
    """One scene seen through one camera."""

    def __call__(self, T_world_camera: np.ndarray, T_world_body: np.ndarray | None = None) -> Image:
        """Render from a pose, shape (4, 4); camera axes x right, y down, z forward.

        `T_world_body` are the poses of `scene.bodies` in this frame, shape (bodies, 4, 4); None = at rest.
        """
        ...

    def close(self) -> None:
        """Free what the renderer holds."""
        ...


def default_camera(width: int, height: int) -> Intrinsics:
    """A Kinect-like pinhole camera: f = 525 px at a width of 640, principal point in the image centre.

    Renderers put pixel centres at .5; in the integer convention the centre of the image is (W-1)/2.
    """
    focal = 525.0 * width / 640.0
    return Intrinsics(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)


def pixel_rays(camera: Intrinsics, shift: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """Unit vector along the ray of every pixel's centre in the camera's axes, float32, shape (H, W, 3).

    `shift` moves the points off the centres [px].
    A lens distortion is undone point by point: such a picture is exact, not a bent copy of a straight one.
    """
    x, y = np.meshgrid(np.arange(camera.width) + shift[0], np.arange(camera.height) + shift[1])
    straight = undistort_points(np.stack([x, y], -1).reshape(-1, 2), camera)
    rays = np.concatenate([straight.reshape(*x.shape, 2), np.ones((*x.shape, 1))], -1)
    return (rays / np.linalg.norm(rays, axis=-1, keepdims=True)).astype(np.float32)


def part_tables(scene: Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Class (uint8), instance (uint16) and glass (bool) of each part, each (parts + 1,): the last is nothing."""
    label = np.array([p.label for p in scene.parts] + [0], np.uint8)
    instance = np.array([p.instance for p in scene.parts] + [0], np.uint16)
    glass = np.array([scene.materials[p.material].glass for p in scene.parts] + [False])
    return label, instance, glass
