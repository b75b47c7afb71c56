"""Which frames are segmented, and what the segmenter is told about them."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from dsmap.frame import Frame, Intrinsics
from dsmap.fusion.config import MapConfig
from dsmap.fusion.labels.gravity import MapGravity
from dsmap.fusion.labels.mirrored import Mirrored
from dsmap.fusion.labels.segment import segment
from dsmap.fusion.labels.semantics import Schedule
from dsmap.fusion.segmenter import Segmenter, wants_geometry
from dsmap.fusion.state import part_of, with_prefix
from dsmap.fusion.tracking.rolling_shutter import corrected_frame
from dsmap.fusion.trajectory import TrajectoryPoint
from dsmap.kernels.types import FrameMaps, SurfelMap


class Labeller:
    """Asks a segmenter for class probabilities of the frames that are due; knows up and the floor of the map.

    Args:
        config: every parameter.
        intrinsics: of the frames.
        segmenter: None: no frame has labels.
    """

    def __init__(self, config: MapConfig, intrinsics: Intrinsics, segmenter: Segmenter | None):
        self.config, self.segmenter = config, segmenter
        self.schedule = Schedule(config.labels)
        self.gravity = MapGravity(intrinsics, config.camera_up)
        self.rest_until = -math.inf
        """No frame before this time [s] is segmented: a live session that has to keep up sets it."""

    def probabilities(
        self,
        frame: Frame,
        maps: FrameMaps,
        T_world_camera: np.ndarray,
        surfels: SurfelMap,
        trajectory: Sequence[TrajectoryPoint],
    ) -> np.ndarray | None:
        """Of a frame that has been fused, shape (h, w, 14); None where it is not due.

        Args:
            maps: the frame's finest.
            surfels: of the map, with this frame; trajectory: of all frames, with this one.
        """
        if self.segmenter is None or frame.time < self.rest_until or not self.schedule.due(T_world_camera):
            return None
        if wants_geometry(self.segmenter):
            self.gravity.update(surfels, self.config.stable_weight, trajectory)
        frame = corrected_frame(frame, maps) if self.config.shutter_s else frame
        segmenter = Mirrored(self.segmenter) if self.schedule.mirrored else self.segmenter
        return segment(segmenter, frame, maps, T_world_camera, self.gravity)

    def state(self) -> dict[str, Any]:
        """What is carried from frame to frame."""
        state: dict[str, Any] = {
            "schedule_frames": self.schedule.frames,
            "schedule_taken": self.schedule.taken,
        }
        if self.schedule.last is not None:
            state["schedule.last"] = self.schedule.last
        return state | with_prefix("gravity.", self.gravity.state())

    def load_state(self, state: dict[str, Any]) -> None:
        """Go on where `state` was taken."""
        self.schedule.frames, self.schedule.last = state["schedule_frames"], state.get("schedule.last")
        self.schedule.taken = state.get("schedule_taken", 0)  # older checkpoints have none
        self.gravity.load_state(part_of(state, "gravity."))
