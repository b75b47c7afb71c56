"""A recording that comes at its own speed, as if its camera were here."""

import time
import warnings
from collections.abc import Iterator

from dsmap.errors import InputWarning
from dsmap.frame import Frame
from dsmap.sequences import Sequence


class Replay:
    """Frames of a recording when their time has come.

    Args:
        speed: so many times its own.
    """

    def __init__(self, sequence: Sequence, speed: float = 1.0):
        self.sequence, self.speed = sequence, speed
        self.intrinsics = sequence.intrinsics
        self._began = self._first = 0.0

    def frames(self) -> Iterator[Frame]:
        """Each frame when its time has come; a damaged one is left out."""
        first = True
        for frame in self.sequence:
            if first:  # the clock starts once it is decoded: a camera would not wait for that
                self._began, self._first, first = time.monotonic(), frame.time, False
            time.sleep(max(self.seen_at(frame) - time.monotonic(), 0.0))
            yield frame
        for _, reason in self.sequence.skipped:
            warnings.warn(InputWarning(f"left out: {reason}"), stacklevel=2)

    def seen_at(self, frame: Frame) -> float:
        """When the camera would have seen it (time.monotonic) [s]; a frame that is decoded late has been seen then."""
        return self._began + (frame.time - self._first) / self.speed
