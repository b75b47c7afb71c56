"""Poses that were found in the map, but not for certain: several frames in a row have to find the same."""

import numpy as np

from dsmap.fusion.config import RelocaliseConfig
from dsmap.fusion.lie import pose_difference
from dsmap.fusion.places.relocalise import Relocation

_STEP_M, _STEP_DEG = 0.1, 10.0
"""A hand-held camera moves by no more than this between two frames [m, deg]."""


class Sightings:
    """Remembers uncertain poses of the last frames.

    Each frame is searched for on its own, so a look-alike that fits in one frame does not fit in the next ones, or
    somewhere else.
    """

    def __init__(self, config: RelocaliseConfig):
        self.config = config
        self.seen: list[tuple[int, np.ndarray]] = []
        """Frame and T_world_camera of those in a row that agree, oldest first."""

    def pose(self, time: int, found: Relocation | None) -> np.ndarray | None:
        """T_world_camera if it is to be believed, else None.

        Args:
            found: in frame `time`; None: nothing.
        """
        if found is None:
            self.seen.clear()
            return None
        T = found.T_world_camera
        if not found.certain:
            if self.seen and not self._follows(time, T):
                self.seen.clear()
            self.seen.append((time, T))
            if len(self.seen) < self.config.sightings:
                return None
        self.seen.clear()
        return T

    def _follows(self, time: int, T_world_camera: np.ndarray) -> bool:
        before, T_before = self.seen[-1]
        distance, angle = pose_difference(T_before, T_world_camera)
        return time == before + 1 and distance < _STEP_M and angle < _STEP_DEG
