"""Images of a camera that reads its rows one after the other, ray traced band by band.

A band of a few rows is rendered from where the camera is at its middle row. Within the band each row's rays are turned
by what the camera turns until then, which is exact; what it moves on by (0.2 mm at 1 m/s) is left out.
"""

from dataclasses import replace

import numpy as np

from dsmap.frame import Intrinsics
from dsmap.sim_scenes.render.renderer import Image, pixel_rays
from dsmap.sim_scenes.render.warp_renderer import WarpRenderer
from dsmap.sim_scenes.scene import Scene

_BANDS = 40
"""Bands of an image, about."""


class RollingRenderer:
    """mujoco-warp's ray tracer with a pose for every row."""

    def __init__(self, scene: Scene, camera: Intrinsics, shadows: bool = True):
        height = camera.height
        self._rows = next(rows for rows in range(max(height // _BANDS, 1), height + 1) if height % rows == 0)
        self._rays = pixel_rays(camera)
        self._inner = WarpRenderer(scene, replace(camera, height=self._rows), shadows)

    def __call__(self, T_world_camera: np.ndarray, T_world_body: np.ndarray | None = None) -> Image:
        """Render from the poses of all rows, shape (H, 4, 4); bodies as the other renderers."""
        bands = []
        for first in range(0, len(T_world_camera), self._rows):
            poses, rays = T_world_camera[first : first + self._rows], self._rays[first : first + self._rows]
            T = poses[self._rows // 2]
            turned = np.einsum("hij,hwj->hwi", T[:3, :3].T @ poses[:, :3, :3], rays).astype(np.float32)
            self._inner.aim(turned)
            image = self._inner(T, T_world_body)
            # Planar depth is that of the row's own camera.
            bands.append(replace(image, depth=image.depth * rays[..., 2] / turned[..., 2]))
        return Image(
            *(np.concatenate([getattr(band, n) for band in bands]) for n in ("rgb", "depth", "part"))
        )

    def close(self) -> None:
        """Free what the renderer holds."""
        self._inner.close()
