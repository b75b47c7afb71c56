"""Frames of a camera that does not wait: the newest one is taken, those before it are dropped."""

import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from dsmap.frame import Frame


@dataclass(frozen=True)
class Arrived:
    """A frame, and when the camera gave it."""

    frame: Frame
    at: float
    """time.monotonic() [s]."""
    dropped: int
    """Frames before it that came too fast."""


class NewestFrame:
    """Reads a source in a thread of its own and keeps its newest frame.

    Args:
        frames: blocks until the next frame is there; its end is the end of the source. It is closed in the thread.
        seen_at: when the camera saw a frame (time.monotonic) [s]; None: when it came.
        left_out: frames so far that the source did not give since newer ones were there.
    """

    def __init__(
        self,
        frames: Iterable[Frame],
        seen_at: Callable[[Frame], float] | None = None,
        left_out: Callable[[], int] = lambda: 0,
    ):
        self._replaced = 0
        """Frames that a newer one replaced before anybody took them."""
        self.ended = False
        """Nothing more will come."""
        self._error: BaseException | None = None
        self._slot: Arrived | None = None
        self._seen_at = seen_at or (lambda _: time.monotonic())
        self._left_out = left_out
        self._changed = threading.Condition()
        self._closing = False
        self._thread = threading.Thread(target=self._read, args=(frames,), name="dsmap-camera", daemon=True)
        self._thread.start()

    @property
    def dropped(self) -> int:
        """Frames so far that nobody will take."""
        return self._replaced + self._left_out()

    def take(self, timeout_s: float) -> Arrived | None:
        """The newest frame, once; None where none comes within the time, or the source has ended.

        Raises:
            Exception: what the source raised, after its last frame.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._slot is not None or self.ended, timeout_s)
            arrived, self._slot = self._slot, None
            if arrived is None and self._error is not None:
                raise self._error
            return arrived

    def close(self, timeout_s: float = 5.0) -> None:
        """Ask the source to end at its next frame."""
        self._closing = True
        self._thread.join(timeout_s)

    def _read(self, frames: Iterable[Frame]) -> None:
        try:
            for frame in frames:
                with self._changed:
                    if self._closing:
                        break
                    self._replaced += self._slot is not None
                    self._slot = Arrived(frame, self._seen_at(frame), self.dropped)
                    self._changed.notify()
        except BaseException as error:  # the taker raises it: a thread's traceback would be lost
            self._error = error
        with self._changed:
            self.ended = True
            self._changed.notify()
