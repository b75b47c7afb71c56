"""mujoco-warp's ray tracer: colour, planar depth and parts in one pass, without OpenGL or a screen."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo fills its module at run time.)

import threading

import numpy as np

from dsmap.frame import Intrinsics
from dsmap.sim_scenes.render.renderer import Image, pixel_rays
from dsmap.sim_scenes.scene import LEAK, Scene

_ONE_AT_A_TIME = threading.Lock()
"""Warp builds a kernel in Python when it is first launched: two threads at it mix up each other's code."""


_SMOOTH = ((0.0, 0.0), (0.0, -0.4), (0.35, 0.2), (-0.35, 0.2))
"""Where in the pixel the rays of a smooth image go [px from its centre]: their mean is the centre."""


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

    def aim(self, rays: np.ndarray) -> None:
        """Send these rays through the pixels: unit vectors in the camera's axes, shape (H, W, 3)."""
        self._context.ray.assign(rays.reshape(-1, 3) * [1, -1, -1])

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

    def close(self) -> None:
        """Free the model and its images."""
        del self._model, self._data, self._context
