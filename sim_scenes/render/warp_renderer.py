"""Rendering a scene: colour, planar depth, class and instance of every pixel in one pass.

`open_renderer` gives a `Renderer`; the default one is mujoco-warp's ray tracer, which needs neither
OpenGL nor a screen. OpenGL renderers are in `render_gl`.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo fills its module at run time.)

import threading
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sim_scenes.scene import LEAK, Scene

RENDERERS = ("warp", "mujoco", "pyrender")
_ONE_AT_A_TIME = threading.Lock()
"""Warp builds a kernel in Python when it is first launched: two threads at it mix up each other's code."""


_SMOOTH = ((0.0, 0.0), (0.0, -0.4), (0.35, 0.2), (-0.35, 0.2))
"""Where in the pixel the rays of a smooth image go [px from its centre]: their mean is the centre."""


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


def open_renderer(
    name: str, scene: Scene, camera: Intrinsics, *, shadows: bool = True, smooth: bool = False
) -> Renderer:
    """A renderer by name (`RENDERERS`).

    Args:
        name: `warp`, `mujoco` or `pyrender`.
        scene: what to render.
        camera: any pinhole camera; `warp` renders lens distortions too.
        shadows: of the lights; the ray tracer needs about half the time without them.
        smooth: colour as the mean of four rays a pixel, about four times the cost (`warp`; the others
            always smooth a little). Depth and labels are those of the pixel's centre in any case.

    Raises:
        InputError: unknown name, or its system library is missing (says which package brings it).
    """
    if name == "warp":
        return WarpRenderer(scene, camera, shadows, smooth)
    if name in RENDERERS:
        from dsmap.sim_scenes.render import opengl

        return opengl.open_renderer(name, scene, camera, shadows)
    raise InputError(f"unknown renderer {name!r}; expected one of: {', '.join(RENDERERS)}")


def pixel_rays(camera: Intrinsics, shift: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """Unit vector along the ray of every pixel's centre in the camera's axes, float32, shape (H, W, 3).

    `shift` moves the points off the centres [px].
    A lens distortion is undone point by point: such a picture is exact, not a bent copy of a straight one.
    """
    x, y = np.meshgrid(np.arange(camera.width) + shift[0], np.arange(camera.height) + shift[1])
    if camera.distortion is None:
        rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones(x.shape)], -1)
    else:
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-9)
        seen = np.stack([x, y], -1).reshape(-1, 1, 2)
        straight = cv2.undistortPoints(seen, camera.K, np.array(camera.distortion), criteria=criteria)
        rays = np.concatenate([straight.reshape(*x.shape, 2), np.ones((*x.shape, 1))], -1)
    return (rays / np.linalg.norm(rays, axis=-1, keepdims=True)).astype(np.float32)


def part_tables(scene: Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Class (uint8), instance (uint16) and glass (bool) of each part, each (parts + 1,): the last is nothing."""
    label = np.array([p.label for p in scene.parts] + [0], np.uint8)
    instance = np.array([p.instance for p in scene.parts] + [0], np.uint16)
    glass = np.array([scene.materials[p.material].glass for p in scene.parts] + [False])
    return label, instance, glass


class WarpRenderer:
    """mujoco-warp's ray tracer on the CPU. Its kernel depends on the number of lights only, not on the scene."""

    def __init__(self, scene: Scene, camera: Intrinsics, shadows: bool = True, smooth: bool = False) -> None:
        import warp as wp

        # As dsmap.kernels sets them: a kernel compiled under one setting is not found under another.
        wp.config.log_level, wp.config.enable_backward = wp.LOG_WARNING, False
        import mujoco
        import mujoco_warp

        from dsmap.sim_scenes.render.mjcf import build_model

        self._wp, self._mjw = wp, mujoco_warp
        self._shape = (camera.height, camera.width)
        self._fresh, self._default_is_cpu = True, wp.get_device().is_cpu
        model = build_model(scene, camera)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        with wp.ScopedDevice("cpu"):
            self._model = mujoco_warp.put_model(model)
            self._data = mujoco_warp.put_data(model, data)
            self._context = mujoco_warp.create_render_context(
                model,
                cam_res=(camera.width, camera.height),
                render_rgb=True,
                render_depth=True,
                render_seg=True,
                use_shadows=shadows,
                samples_per_pixel=2 if smooth else 1,
                use_fast_math=False,
                deterministic=True,
                shadow_light_fraction=LEAK,
            )
            # The camera model of mujoco-warp knows only centred images: each pixel gets its ray from us.
            # With several rays a pixel, depth and labels come of the first.
            shifts = _SMOOTH if smooth else ((0.0, 0.0),)
            rays = np.concatenate([pixel_rays(camera, shift).reshape(-1, 3) for shift in shifts])
            self._context.ray.assign(rays * [1, -1, -1])
            self._rest = (self._data.geom_xpos.numpy().copy(), self._data.geom_xmat.numpy().copy())
            self._scene = scene
            mujoco_warp.refit_bvh(self._model, self._data, self._context)

    def __call__(self, T_world_camera: np.ndarray, T_world_body: np.ndarray | None = None) -> Image:
        """Render from a pose, shape (4, 4). Renderers may run side by side, each in a thread of its own."""
        if self._fresh or not self._default_is_cpu:
            # Where a GPU is Warp's default, going to the CPU for a while concerns the whole process.
            with _ONE_AT_A_TIME, self._wp.ScopedDevice("cpu"):
                self._fresh = False
                return self._render(T_world_camera, T_world_body)
        return self._render(T_world_camera, T_world_body)

    def _move(self, T_world_body: np.ndarray | None) -> None:
        """Bring the geoms of moving parts to where they are now."""
        position, rotation = (values.copy() for values in self._rest)
        for geom, T_now_rest in self._scene.moved_by(T_world_body).items():
            position[0, geom] = T_now_rest[:3, :3] @ position[0, geom] + T_now_rest[:3, 3]
            rotation[0, geom] = T_now_rest[:3, :3] @ rotation[0, geom]
        self._data.geom_xpos.assign(position)
        self._data.geom_xmat.assign(rotation)
        self._mjw.refit_bvh(self._model, self._data, self._context)

    def _render(self, T_world_camera: np.ndarray, T_world_body: np.ndarray | None) -> Image:
        context = self._context
        if self._scene.bodies:
            self._move(T_world_body)
        # MuJoCo's camera looks along -z with y up.
        rotation = T_world_camera[:3, :3] @ np.diag([1.0, -1.0, -1.0])
        self._data.cam_xmat.assign(rotation[None, None].astype(np.float32))
        self._data.cam_xpos.assign(T_world_camera[None, None, :3, 3].astype(np.float32))
        self._mjw.render(self._model, self._data, context)
        blue_green_red = context.rgb_data.numpy()[0].view(np.uint8).reshape(*self._shape, 4)
        depth = context.depth_data.numpy()[0].reshape(self._shape).copy()
        hit = context.seg_data.numpy()[0].reshape(*self._shape, 2)
        return Image(
            np.ascontiguousarray(blue_green_red[..., 2::-1]),
            depth,
            np.ascontiguousarray(hit[..., 0], dtype=np.int32),
        )

    @property
    def kernel_name(self) -> str:
        """Name and hash of the compiled kernel, once a frame was rendered: equal names share one compilation."""
        return str(self._context._megakernel.module.name)  # pyright: ignore[reportOptionalMemberAccess]

    def close(self) -> None:
        """Free the model and its images."""
        del self._model, self._data, self._context
