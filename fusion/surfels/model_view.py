"""The model as it looks from one pose: what a frame, or another view, is registered to."""

from typing import Any

import numpy as np
import warp as wp

from dsmap.kernels.odometry import gradient
from dsmap.kernels.preprocess import half_surface


class ModelView:
    """The model as predicted from one pose: a pyramid of (vertex, normal, intensity, gradient).

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
        self.levels: list[Any] = [None] * finest
        for level in range(finest, levels):
            if level > finest:
                vertex, normal, intensity = half_surface(vertex, normal, intensity)
            self.levels.append((vertex, normal, intensity, gradient(intensity, vertex)))

    @property
    def surface(self) -> list[Any]:
        """(vertex, normal, intensity) a level: the view as something that can itself be registered."""
        return [level and level[:3] for level in self.levels]
