"""What a frame did to the map."""

from dataclasses import dataclass, field

import numpy as np

from dsmap.fusion.loops.record import LoopRecord
from dsmap.fusion.tracking.tracker import Health


@dataclass
class StepResult:
    """What one frame did to the map."""

    T_world_camera: np.ndarray
    tracked: bool
    health: Health | None
    """None where poses are given, and for the first frame."""
    reason: str
    """Why the frame is lost, in words; empty when tracked."""
    inserted: int
    segmented: bool
    relocalised: bool = False
    """Tracking had lost this frame; it was found again by keyframes."""
    loop: LoopRecord | None = None
    """The loop that was closed after this frame."""
    moving: float = 0.0
    """Share of the image that moves and is left out of the map."""
    stages_ms: dict[str, float] = field(default_factory=dict)
