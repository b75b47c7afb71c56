"""The loop over the frames of `dsmap map`: progress, checkpoints, Ctrl-C."""

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from tqdm import tqdm

from dsmap.fusion.mapper import Mapper, StepResult
from dsmap.fusion.runs.prepare_ahead import prepare_ahead
from dsmap.sequences import Sequence

STRIP_FRAMES = 4
"""Frames shown in the strip picture, spread over the sequence."""
LOG_EVERY = 20
"""Without a terminal: frames between two lines of progress."""
INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells expect; everything so far is written."""


@dataclass
class Run:
    """A mapper on its way through a recording."""

    mapper: Mapper
    save: Callable[["Run"], None]
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


def run(state: Run, sequence: Sequence, checkpoint_every: int = 0) -> bool:
    """Map the frames that are not done yet; returns whether Ctrl-C (or SIGTERM) stopped it.

    The frame in hand is finished first, so that what is written can be resumed. A second Ctrl-C does not wait.
    """
    first, earlier, rest = state.done, state.skipped, sequence.rest(state.done)
    position_of = {entry.index: first + i for i, entry in enumerate(rest.entries)}
    positions = set(np.linspace(0, len(sequence) - 1, STRIP_FRAMES + 2).astype(int)[1:-1].tolist())
    bar = tqdm(total=len(sequence), initial=first, unit="frame", disable=None)  # None: off without a terminal
    with bar, _interruptible() as asked_to_stop:
        for ready in prepare_ahead(state.mapper, rest if len(rest) else ()):
            frame = ready.frame
            position = position_of[frame.index]
            while state.done < position:  # a damaged frame: counted, with the last pose
                state.mapper.skip(sequence.times[state.done])
                state.done += 1
            result = state.mapper.step(frame, ready.maps, waited_ms=ready.waited_ms)
            # Reading is one frame ahead: what it skipped there is not behind us yet.
            passed = [(index, reason) for index, reason in rest.skipped if index < frame.index]
            state.done, state.skipped = position + 1, earlier + passed
            if not result.tracked and state.first_lost is None:
                state.first_lost = (frame.index, result.reason)
            if position in positions:
                state.shown.append((position, result))
            _progress(bar, state, len(sequence), result)
            if checkpoint_every and state.done % checkpoint_every == 0 and state.done < len(sequence):
                state.save(state)
            if asked_to_stop():
                print("\nstopped: writing what is there so far", file=sys.stderr)
                return True
    state.skipped = earlier + rest.skipped
    return False


def _progress(bar: Any, state: Run, total: int, result: StepResult) -> None:
    count = state.mapper.surfels.count
    outcome = "ok" if result.tracked else f"LOST: {result.reason}"
    bar.set_postfix_str(f"{count:,} surfels, {outcome}", refresh=False)
    bar.update(state.done - bar.n)
    if bar.disable and state.done % LOG_EVERY == 0:
        print(f"frame {state.done} of {total}: {count:,} surfels, {outcome}", file=sys.stderr)


@contextmanager
def _interruptible() -> Iterator[Callable[[], bool]]:
    """Inside, the first SIGINT or SIGTERM only makes the yielded function true; a second SIGINT interrupts."""
    asked = False

    def ask(number: int, frame: Any) -> None:
        nonlocal asked
        asked = True
        signal.signal(signal.SIGINT, signal.default_int_handler)

    try:
        before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    except ValueError:  # not the main thread: signals are someone else's
        before = {}
    try:
        yield lambda: asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
