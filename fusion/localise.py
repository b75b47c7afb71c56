"""Tracking in a saved map without changing it."""

import numpy as np

from dsmap.frame import Frame, Intrinsics
from dsmap.fusion.config import MapConfig
from dsmap.fusion.loops.record import LoopRecord
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.segmenter import Segmenter
from dsmap.fusion.step_result import StepResult
from dsmap.fusion.surfels.integrator import Integrator
from dsmap.kernels.types import FrameMaps


class _Onlooker(Integrator):
    """Leaves the map as it is."""

    def associate(self, T_world_camera: np.ndarray, maps: FrameMaps, t_active: int) -> None:
        self.visible = self.views.visible(T_world_camera)

    def fuse(self, T_world_camera: np.ndarray, maps: FrameMaps, time: int) -> int:
        return 0

    def clean_up(self, T_world_camera: np.ndarray, maps: FrameMaps, time: int, t_active: int) -> None:
        pass


class Localiser(Mapper):
    """A mapper that finds and tracks the camera in the map it was given, and leaves the map as it is.

    The whole map is active: there is nothing newer that an old part could be compared with.
    """

    def __init__(self, config: MapConfig, intrinsics: Intrinsics, segmenter: Segmenter | None = None):
        super().__init__(config, intrinsics, segmenter)
        self.integrator = _Onlooker(config, self.views)

    @property
    def _t_active(self) -> int:
        return 0

    def _relocalise(self, maps: list[FrameMaps], result: StepResult) -> None:
        assert self.closer is not None
        found = self.closer.relocalise(maps, self.time, self.trajectory)
        if found is not None:
            self.T_world_camera = found
            result.tracked = result.relocalised = True

    def _segment(self, frame: Frame, maps: FrameMaps) -> None:
        return None

    def _close_loops(self, maps: list[FrameMaps]) -> LoopRecord | None:
        return None
