"""A run as a recording: its frames with the poses that mapping found and the labels that the map shows."""

from dataclasses import replace

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Frame
from dsmap.fusion.runs.map_renderer import MapRenderer
from dsmap.fusion.runs.read_run import SavedRun, pair_frames
from dsmap.sequences import Sequence


class RunFrames(Sequence):
    """The tracked frames of a run at the recording's image size; whoever writes a recording writes this as well.

    Labels are the map's, rendered into each frame's pose; there are no instances.
    """

    def __init__(self, run: SavedRun, recording: Sequence, stride: int = 1):
        """Pair the run with the recording that was mapped.

        Args:
            recording: opened whole; at another size than it was mapped is fine.
            stride: every n-th tracked frame.

        Raises:
            InputError: it is another recording, or no frame was tracked.
        """
        pairs = [(i, j) for i, j in pair_frames(run, recording) if run.tracked[i]][::stride]
        if not pairs:
            raise InputError(f"{run.path}: no frame was tracked, expected some to export")
        entries = [
            replace(recording.entries[j], T_world_camera=run.colour_poses[i], label=None, instance=None)
            for i, j in pairs
        ]
        own = recording.intrinsics
        super().__init__(
            recording.recording, recording.calibration, (own.width, own.height), entries, recording.undistort
        )
        self._render = MapRenderer(run, self.intrinsics)

    @property
    def has_labels(self) -> bool:
        return bool(self._render.label.any())

    def frame(self, i: int) -> Frame:
        """Frame `i` with the run's pose and the map's labels."""
        return replace(super().frame(i), label=self.label(i))

    def label(self, i: int) -> np.ndarray:
        """The map's classes in frame `i`, uint8, shape (H, W), 0 where it has none."""
        T_world_camera = self.T_world_camera(i)
        assert T_world_camera is not None
        return self._render.labels(T_world_camera)

    def index(self, i: int) -> np.ndarray:
        """Surfel that each pixel of frame `i` sees, int32, shape (H, W), -1 where none."""
        T_world_camera = self.T_world_camera(i)
        assert T_world_camera is not None
        return self._render.index(T_world_camera)
