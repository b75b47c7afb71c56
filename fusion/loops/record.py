"""What a loop closure looks at, and what it leaves behind."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from dsmap.fusion.lie import inverse
from dsmap.fusion.surfels.model_view import ModelView
from dsmap.fusion.tracking.tracker import Health
from dsmap.fusion.trajectory import Trajectory
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
    """Of the deformation graph; 0 where both parts agreed within `negligible` and nothing was bent."""


def record_values(record: LoopRecord) -> dict[str, Any]:
    """A loop as plain values: an entry of loops.json."""
    values = asdict(record)
    return {name: v.tolist() if isinstance(v, np.ndarray | np.generic) else v for name, v in values.items()}


@dataclass
class LoopQuery:
    """All that a loop closure looks at: the map's state after a frame was fused and the view predicted."""

    frame: Sequence[FrameMaps]
    view: ModelView
    """The active model from the camera's pose, every level."""
    maps: ModelMaps
    """The same, finest level, with surfel indices."""
    time: int
    trajectory: Trajectory
    """All frames up to now; a loop moves them with the map."""
    relocalised: bool = False
    """Whether what the frame sees of the map has just become active again."""

    @property
    def T_world_camera(self) -> np.ndarray:
        return self.view.T_world_camera


@dataclass
class LoopCandidate:
    """Where in the inactive map the active view fits."""

    kind: str
    """local or global."""
    T_world_camera: np.ndarray
    """Of the camera, as found."""
    shift_m: float
    """RMS distance by which that moves the points in view."""
    health: Health
    """Of the registration."""
    similarity: float
    """Of the keyframe; 1 for local loops."""

    def record(self, now: LoopQuery, frame_destination: int, nodes: int = 0) -> LoopRecord:
        """The loop that this match is; before the trajectory is bent."""
        T_world_destination = now.trajectory[frame_destination].T_world_camera
        return LoopRecord(
            self.kind, now.time, frame_destination, inverse(T_world_destination) @ self.T_world_camera, self.shift_m,
            self.health.rms_icp**2, round(self.health.inliers), self.similarity, nodes,
        )  # fmt: skip
