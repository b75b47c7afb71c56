"""The loop over the frames of `dsmap map`: progress, checkpoints, signals."""

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from tqdm import tqdm

from dsmap.files import written_or_warned
from dsmap.frame import Frame
from dsmap.fusion.mapper import Mapper, StepResult
from dsmap.fusion.runs.pace import Pace
from dsmap.fusion.runs.prepare_ahead import prepare_ahead
from dsmap.sequences import Sequence
from dsmap.stopping import STOPS, is_ignored, stop_printing

STRIP_FRAMES = 4
"""Frames shown in the strip picture, spread over the sequence."""
LOG_EVERY = 20
"""Without a terminal: frames between two lines of progress."""


@dataclass
class RunState:
    """A mapper on its way through a recording."""

    mapper: Mapper
    save: Callable[["RunState"], None]
    """Writes the checkpoint."""
    done: int = 0
    """Frames of the recording that are behind us, skipped ones included."""
    skipped: list[tuple[int, str]] = field(default_factory=list)
    """Frames that could not be read: (index in the recording, reason)."""
    first_lost: tuple[int, str] | None = None
    """Index in the recording of the first frame that was not tracked, and why."""
    shown: list[tuple[int, StepResult]] = field(default_factory=list)
    """Position and result of the frames for the strip picture."""
    wall_s: float = 0.0
    """Seconds spent, before an interruption included."""
    pace: Pace | None = None
    """What was given up to keep up with a camera, or with a recording at its own speed."""
    measured: dict[str, np.ndarray] | None = None
    """The labels as fusion left them, once they are refined."""

    def note(self, frame: Frame, position: int, result: StepResult, total: int) -> None:
        """A frame of a recording of so many frames was mapped; position: in the recording."""
        before, self.done = self.done, position + 1
        if not result.tracked and self.first_lost is None:
            self.first_lost = (frame.index, result.reason)
        wanted = np.linspace(0, total - 1, STRIP_FRAMES + 2).astype(int)[1:-1]
        if ((before <= wanted) & (wanted <= position)).any():
            self.shown.append((position, result))


def map_recording(
    state: RunState,
    sequence: Sequence,
    checkpoint_every: int = 0,
    asked_to_stop: Callable[[], int] | None = None,
    watch: Callable[[Frame, StepResult], None] | None = None,
) -> int:
    """Map the frames that are not done yet; returns the signal that stopped it (Ctrl-C, SIGTERM, SIGHUP), or 0.

    The frame in hand is finished first, so that what is written can be resumed. A second signal does not wait.
    A checkpoint that cannot be written is warned of; mapping goes on.

    Args:
        asked_to_stop: of `signals_noted`, if the caller notes signals; None: they are noted here.
        watch: is shown every frame right after its step.
    """
    if asked_to_stop is None:
        with signals_noted() as asked_to_stop:
            return map_recording(state, sequence, checkpoint_every, asked_to_stop, watch)
    first, earlier, rest = state.done, state.skipped, sequence.rest(state.done)
    position_of = {entry.index: first + i for i, entry in enumerate(rest.entries)}
    with progress_bar(len(sequence), first) as bar:
        for ready in prepare_ahead(state.mapper, rest if len(rest) else ()):
            frame = ready.frame
            position = position_of[frame.index]
            _skip_to(state, position, sequence)
            result = state.mapper.step(frame, ready.maps, waited_ms=ready.waited_ms)
            if watch is not None:
                watch(frame, result)
            # Reading is one frame ahead: what it skipped there is not behind us yet.
            passed = [(index, reason) for index, reason in rest.skipped if index < frame.index]
            state.skipped = earlier + passed
            state.note(frame, position, result, len(sequence))
            show_progress(bar, state, len(sequence), result)
            due = checkpoint_every and state.done % checkpoint_every == 0 and state.done < len(sequence)
            if due and state.mapper.settled:  # nobody shall go on from a start that may be given up
                what = f"checkpoint after frame {state.done}"
                written_or_warned(what, "mapping goes on", state.save, state)
            if number := asked_to_stop():
                say("\nstopped: writing what is there so far")
                state.mapper.settle()
                return number
    _skip_to(state, len(sequence), sequence)
    state.mapper.settle()
    state.skipped = earlier + rest.skipped
    return 0


def _skip_to(state: RunState, position: int, sequence: Sequence) -> None:
    """Damaged frames up to a position: counted, with the last pose."""
    while state.done < position:
        state.mapper.skip(sequence.times[state.done])
        state.done += 1


def say(text: str) -> None:
    """Print to stderr; that nobody reads it is no reason to lose the map."""
    try:
        print(text, file=sys.stderr, flush=True)
    except OSError:
        stop_printing()


def progress_bar(total: int, done: int) -> Any:
    """A bar of so many frames; it shows nothing without a terminal."""
    return tqdm(total=total, initial=done, unit="frame", disable=None)


def show_progress(bar: Any, state: RunState, total: int, result: StepResult) -> None:
    """Say how far it is: on a terminal by the bar, else a line now and then."""
    count = state.mapper.surfels.count
    outcome = "ok" if result.tracked else f"LOST: {result.reason}"
    bar.set_postfix_str(f"{count:,} surfels, {outcome}", refresh=False)
    try:
        bar.update(state.done - bar.n)
    except OSError:
        stop_printing()
    if bar.disable and state.done % LOG_EVERY == 0:
        say(f"frame {state.done} of {total}: {count:,} surfels, {outcome}")


@contextmanager
def signals_noted() -> Iterator[Callable[[], int]]:
    """Inside, the first signal that asks to stop only makes the yielded function return its number (0 before).

    A second one is answered as it was outside.
    """
    asked = 0
    before: dict[int, Any] = {}

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    def ask(number: int, frame: Any) -> None:
        nonlocal asked
        asked = number
        restore()
        if number == getattr(signal, "SIGHUP", None):
            stop_printing()

    if threading.current_thread() is threading.main_thread():  # elsewhere signals are someone else's
        for number in STOPS:
            if not is_ignored(number):
                before[number] = signal.signal(number, ask)
    try:
        yield lambda: asked
    finally:
        restore()
