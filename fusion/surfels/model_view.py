"""The model as it looks from one pose: what a frame, or another view, is registered to."""

import numpy as np
import warp as wp

from dsmap.kernels.odometry import gradient
from dsmap.kernels.preprocess import half_surface
from dsmap.kernels.types import Surface


class ModelView:
    """The model as predicted from one pose: a pyramid of surfaces.

    The maps given are those of pyramid level `finest`; `levels` has None below it.
    """

    def __init__(
        self,
        vertex: wp.array,
        normal: wp.array,
        intensity: wp.array,
        levels: int,
        T_world_camera: np.ndarray,
        finest: int = 0,
    ):
        self.T_world_camera = T_world_camera
        self.finest = finest
        self.levels: list[Surface | None] = [None] * finest
        for level in range(finest, levels):
            if level > finest:
                vertex, normal, intensity = half_surface(vertex, normal, intensity)
            self.levels.append(Surface(vertex, normal, intensity, gradient(intensity, vertex)))

    def level(self, number: int) -> Surface:
        """The surface of a level that is there."""
        surface = self.levels[number]
        assert surface is not None, f"this view begins at level {self.finest}"
        return surface
