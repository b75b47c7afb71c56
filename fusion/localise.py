"""Tracking in a saved map without changing it."""

from dsmap.frame import Frame
from dsmap.fusion.loop_closure import LoopRecord
from dsmap.fusion.mapper import Mapper, StepResult
from dsmap.kernels.types import FrameMaps


class Localiser(Mapper):
    """A mapper that finds and tracks the camera in the map it was given, and leaves the map as it is.

    The whole map is active: there is nothing newer that an old part could be compared with.
    """

    @property
    def _t_active(self) -> int:
        return 0

    def _relocalise(self, maps: list[FrameMaps], result: StepResult) -> None:
        assert self.closer is not None
        found = self.closer.relocalise(maps, self.time)
        if found is not None:
            self.T_world_camera = found
            result.tracked = result.relocalised = True

    def _associate(self, maps: FrameMaps) -> None:
        self._visible = self.visible(self.T_world_camera)

    def _fuse(self, maps: FrameMaps) -> int:
        return 0

    def _clean_up(self, maps: FrameMaps) -> None:
        pass

    def _segment(self, frame: Frame) -> None:
        return None

    def _close_loops(self, maps: list[FrameMaps]) -> LoopRecord | None:
        return None
