"""Views of the map: what a part of it, chosen by time, looks like from a pose."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from dsmap.frame import Intrinsics
from dsmap.fusion.config import MapConfig, TrackConfig
from dsmap.fusion.lie import pose_difference
from dsmap.fusion.surfels.model_view import ModelView
from dsmap.kernels.camera import make_camera
from dsmap.kernels.culling import Blocks
from dsmap.kernels.index_map import ALWAYS
from dsmap.kernels.predict import predict_model
from dsmap.kernels.preprocess import intensity_map
from dsmap.kernels.types import ModelMaps, SurfelMap


def pyramid_cameras(intrinsics: Intrinsics, levels: int) -> list[Any]:
    """Kernel cameras of an image pyramid, finest first: each level halves the one before, rounding down."""
    cameras = []
    for level in range(levels):
        width, height = intrinsics.width >> level, intrinsics.height >> level
        # The block means leave out an odd last row or column.
        cropped = replace(intrinsics, width=width << level, height=height << level)
        cameras.append(make_camera(cropped.scaled(width, height)))
    return cameras


def view_is_stale(config: TrackConfig, T_world_view: np.ndarray, T_world_camera: np.ndarray) -> bool:
    """Whether a camera is so far from where a view was predicted that it sees something else."""
    distance, angle = pose_difference(T_world_view, T_world_camera)
    return distance > config.predict_distance or angle > config.predict_angle_deg


class Views:
    """Renders the surfel map into the levels of the camera's pyramid.

    Args:
        config: depth range and confidence from which surfels are stable.
        blocks: the map's surfels and where they lie.
        cameras: of the pyramid, finest first.
    """

    def __init__(self, config: MapConfig, blocks: Blocks, cameras: Sequence[Any]):
        self.config, self.blocks, self.cameras = config, blocks, cameras

    @property
    def surfels(self) -> SurfelMap:
        return self.blocks.surfels

    def visible(self, T_world_camera: np.ndarray, t_max: int | None = None) -> wp.array:
        """Blocks of the map that may hold what a frame from this pose sees: `visible` of the kernels' launchers.

        t_max: only blocks that may hold surfels last updated in this frame or before; None: all.
        """
        config = self.config.surfels
        far = self.config.depth_range[1]
        gate = max(config.max_ray_distance, config.ray_distance_z2 * far**2)
        # A surfel passes the gate along a ray up to a pixel beside its own, so a little further away.
        reach = (far + gate) * (1 + 2 / self.cameras[0].fx)
        return self.blocks.visible(self.cameras[0], T_world_camera, reach, t_max)

    def empty(self, level: int = 0) -> ModelMaps:
        """Maps of the size of a pyramid level, with nothing in them."""
        camera = self.cameras[level]
        return ModelMaps.empty(camera.height, camera.width, self.surfels.device)

    def render(
        self,
        T_world_camera: np.ndarray,
        maps: ModelMaps,
        *,
        level: int = 0,
        t_min: int = 0,
        t_max: int = ALWAYS,
        visible: wp.array | None = None,
    ) -> None:
        """Render surfels updated in frames t_min .. t_max into `maps` (out, of the size of `level`)."""
        if visible is None:
            visible = self.visible(T_world_camera, t_max if t_max < ALWAYS else None)
        predict_model(
            self.surfels, self.cameras[level], T_world_camera, max_depth=self.config.depth_range[1], maps=maps,
            stable_weight=self.config.stable_weight, t_min=t_min, t_max=t_max,
            visible=visible, resolution=self.config.surfels.resolution,
        )  # fmt: skip

    def pyramid(self, T_world_camera: np.ndarray, maps: ModelMaps, level: int = 0) -> ModelView:
        """The rendered maps of `level` as something that a frame can be registered to."""
        light = intensity_map(maps.colour)
        return ModelView(maps.vertex, maps.normal, light, len(self.cameras), T_world_camera.copy(), level)
