"""A recording that comes at its own speed, as if its camera were here."""

import time
import warnings
from collections.abc import Iterator

import numpy as np

from dsmap.errors import InputError, InputWarning
from dsmap.frame import Frame
from dsmap.fusion.runs.newest_frame import NewestFrame
from dsmap.sequences import Sequence


class Replay:
    """Frames of a recording when their time has come.

    Args:
        speed: so many times its own.
    """

    def __init__(self, sequence: Sequence, speed: float = 1.0):
        self.sequence, self.speed = sequence, speed
        self.intrinsics = sequence.intrinsics
        self.left_out = 0
        """Frames that were never decoded: the next one's time had come as well."""
        self.skipped: list[tuple[int, str]] = []
        """Damaged frames: (index in the recording, reason)."""
        times = sequence.times
        self._first = float(times[0]) if len(times) else 0.0
        self._due_s = (times - self._first) / speed
        self._began = 0.0

    def frames(self) -> Iterator[Frame]:
        """Each frame when its time has come, decoded before, as long as there is time for that."""
        at, self._began = 0, time.monotonic()
        while at < len(self._due_s):
            overdue = int(np.searchsorted(self._due_s, time.monotonic() - self._began, side="right")) - 1
            newest = max(at, overdue)
            self.left_out += newest - at
            try:
                frame = self.sequence.frame(newest)
            except InputError as error:
                self.skipped.append((self.sequence.entries[newest].index, str(error)))
                warnings.warn(InputWarning(f"left out: {error}"), stacklevel=2)
            else:
                time.sleep(max(self.seen_at(frame) - time.monotonic(), 0.0))
                yield frame
            at = newest + 1

    def seen_at(self, frame: Frame) -> float:
        """When the camera would have had it (time.monotonic) [s]."""
        return self._began + (frame.time - self._first) / self.speed

    def newest(self) -> NewestFrame:
        """Plays it: the newest frame, as old as it is."""
        return NewestFrame(self.frames(), self.seen_at, lambda: self.left_out)
