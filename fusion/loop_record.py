"""What a loop closure looks at, and what it leaves behind."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dsmap.fusion.tracker import ModelView
from dsmap.fusion.trajectory import TrajectoryPoint
from dsmap.kernels.types import FrameMaps, ModelMaps


@dataclass
class LoopRecord:
    """One closed loop."""

    kind: str
    """local or global."""
    frame: int
    frame_destination: int
    """The frame that saw the inactive surface last."""
    T_destination_frame: np.ndarray
    """Takes points of the camera of `frame` into that of `frame_destination`, as estimated, shape (4, 4)."""
    shift_m: float
    """RMS distance by which the loop moves the points in view."""
    residual_m2: float
    """Mean squared point-to-plane distance of the registration."""
    inliers: int
    """Matched pixels, as if the image had 640x480."""
    similarity: float
    """Of the keyframe; 1 for local loops."""
    nodes: int
    """Of the deformation graph."""


@dataclass
class Moment:
    """All that a loop closure looks at: the map's state after a frame was fused and the view predicted."""

    frame: Sequence[FrameMaps]
    view: ModelView
    """The active model from the camera's pose, every level."""
    maps: ModelMaps
    """The same, finest level, with surfel indices."""
    time: int
    t_active: int
    """Surfels updated since are active."""
    trajectory: list[TrajectoryPoint]
    """All frames up to now; a loop moves them with the map."""

    @property
    def T_world_camera(self) -> np.ndarray:
        return self.view.T_world_camera
