"""Mapping a camera while it films: the step of `map`, on the newest frame there is."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from dsmap.fusion.mapper import Mapper, StepResult
from dsmap.fusion.runs.newest_frame import Arrived, NewestFrame
from dsmap.fusion.runs.pace import Pace

_POLL_S = 0.1
"""So often a loop without frames looks at its controls."""


@dataclass
class Controls:
    """What may be asked of a session from another thread."""

    paused: threading.Event = field(default_factory=threading.Event)
    stop: threading.Event = field(default_factory=threading.Event)
    save: threading.Event = field(default_factory=threading.Event)


@dataclass(frozen=True)
class Moment:
    """A frame that was mapped."""

    arrived: Arrived
    result: StepResult
    mapped_at: float
    """time.monotonic() [s]."""

    @property
    def dropped(self) -> int:
        """Frames before it that came too fast."""
        return self.arrived.dropped

    @property
    def delay_s(self) -> float:
        """From the camera to the map."""
        return self.mapped_at - self.arrived.at


def map_live(
    mapper: Mapper,
    frames: NewestFrame,
    controls: Controls,
    watch: Callable[[Moment], None],
    save: Callable[[], None],
    asked_to_stop: Callable[[], int] = lambda: 0,
    pace: Pace | None = None,
) -> int:
    """Map until the source ends or somebody asks to stop; returns the number of frames that were mapped.

    Args:
        watch: is shown every frame right after its step; it should not take long.
        save: writes what is there, between two frames, when it is asked for.
        asked_to_stop: of `signals_noted`.
        pace: gives up what it must to keep up with the camera; None: nothing but frames.
    """
    count = 0
    while not controls.stop.is_set() and not asked_to_stop():
        if controls.save.is_set():
            controls.save.clear()
            save()
        arrived = frames.take(_POLL_S)
        if arrived is None:
            if frames.ended:
                break
            continue
        if controls.paused.is_set():  # the camera films on; nobody looks
            continue
        result = mapper.step(arrived.frame)
        count += 1
        moment = Moment(arrived, result, time.monotonic())
        if pace is not None:
            pace.observe(arrived.frame.time, result, moment.delay_s, moment.dropped)
        watch(moment)
    mapper.settle()
    return count
