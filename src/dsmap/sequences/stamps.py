"""Time stamps of unknown unit: seconds, milli-, micro-, nanoseconds, or just the number of the frame."""

from dataclasses import dataclass
from decimal import Decimal

import numpy as np

FRAME_RATE = 30.0
"""Frames that are only numbered were most likely taken at this rate [1/s]: those of 7-Scenes and Redwood were."""
_EPOCH = (
    ("nanoseconds", 1e17, 1e-9),
    ("microseconds", 1e14, 1e-6),
    ("milliseconds", 1e11, 1e-3),
    ("seconds", 1e8, 1.0),
)
"""Unit, least stamp since 1970 in it, and seconds a unit."""
_STEPS = (
    ("seconds", 4.0, 1.0),
    ("milliseconds", 2.5e3, 1e-3),
    ("microseconds", 2.5e6, 1e-6),
    ("nanoseconds", np.inf, 1e-9),
)
"""Unit, largest usual step between two frames in it, and seconds a unit."""
_MAX_STEP_S = 60.0
"""No camera takes its frames so slowly [s]."""
_USUAL_MS = {16, 17, 20, 25, 33, 34, 40, 50, 66, 67, 100}
"""Whole milliseconds between frames of usual cameras."""


@dataclass(frozen=True)
class Unit:
    """What stamps are given in."""

    name: str
    """seconds, milliseconds, microseconds, nanoseconds or frame numbers."""
    seconds: float
    """Seconds a unit."""

    def times(self, words: list[str]) -> np.ndarray:
        """Stamps [s], float64, shape (N,)."""
        scale = Decimal(1) / int(FRAME_RATE) if self.name == "frame numbers" else Decimal(str(self.seconds))
        return np.array([float(Decimal(word) * scale) for word in words])


SECONDS = Unit("seconds", 1.0)
FRAMES = Unit("frame numbers", 1.0 / FRAME_RATE)


def unit_of(words: list[str]) -> Unit:
    """The unit of stamps, from their size and from the steps between them.

    Args:
        words: as written.
    """
    try:
        values = np.array([float(word) for word in words])
    except ValueError:
        return SECONDS
    if not len(values):
        return SECONDS
    typical = float(np.median(np.abs(values)))
    steps = np.diff(np.unique(values))
    for name, least, seconds in _EPOCH:
        # Stamps that count from the recording's start may be as large; their steps are too large then.
        if typical >= least and (not len(steps) or np.median(steps) * seconds <= _MAX_STEP_S):
            return Unit(name, seconds)
    if not len(steps):
        return FRAMES if _whole(values) and "." not in words[0] else SECONDS
    step = float(np.median(steps))
    if _whole(values) and _is_count(steps, step):
        return FRAMES
    return next(Unit(name, seconds) for name, most, seconds in _STEPS if step < most)


def _whole(values: np.ndarray) -> bool:
    return bool((values == np.round(values)).all())


def _is_count(steps: np.ndarray, step: float) -> bool:
    """Whether whole stamps count frames: one by one, or every k-th of them."""
    if step == 1:
        return True
    return step <= 1000 and step not in _USUAL_MS and bool((steps % step == 0).all())
