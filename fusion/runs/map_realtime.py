"""A recording at its own speed: mapped as a camera's frames would be, late ones dropped."""

import dataclasses
from collections.abc import Callable

import numpy as np

from dsmap.frame import Frame
from dsmap.fusion.config import MapConfig
from dsmap.fusion.mapper import Mapper, StepResult
from dsmap.fusion.runs.map_live import Controls, Moment, map_live
from dsmap.fusion.runs.map_recording import RunState, progress_bar, say, show_progress
from dsmap.fusion.runs.pace import Pace, largest_that_keeps_up, sizes, trial
from dsmap.fusion.runs.replay import Replay
from dsmap.fusion.segmenter import Segmenter
from dsmap.sequences import Sequence

_LABELS_TRIED = 3
"""In a trial every n-th frame is labelled: what one costs is to be measured, not how often there is one."""


def size_that_keeps_up(sequence: Sequence, config: MapConfig, segmenter: Segmenter | None) -> tuple[int, int]:
    """The (width, height) to map a recording in at its own speed: the first frames are mapped, and thrown away.

    Args:
        config: `resolved_for` the recording.
    """
    times = np.diff(sequence.times)
    period_s = float(np.median(times)) if len(times) else 0.0
    labels = dataclasses.replace(config.labels, every=_LABELS_TRIED)
    tried = dataclasses.replace(config, labels=labels)

    def try_out(size: tuple[int, int]) -> tuple[float, float]:
        frames = sequence.resized(size)
        return trial(Mapper(tried, frames.intrinsics, segmenter), frames)

    camera = sequence.intrinsics
    return largest_that_keeps_up(sizes(camera.width, camera.height), try_out, period_s)


def map_realtime(
    state: RunState,
    sequence: Sequence,
    asked_to_stop: Callable[[], int],
    watch: Callable[[Frame, StepResult], None] | None = None,
) -> None:
    """Map a recording from its beginning at its own speed; `state.pace` tells what was given up for it.

    Args:
        asked_to_stop: of `signals_noted`.
        watch: is shown every frame right after its step.
    """
    replay, pace = Replay(sequence), Pace(state.mapper)
    frames = replay.newest()
    position_of = {entry.index: i for i, entry in enumerate(sequence.entries)}
    state.pace = pace
    with progress_bar(len(sequence), 0) as bar:

        def note(moment: Moment) -> None:
            frame, result = moment.arrived.frame, moment.result
            if watch is not None:
                watch(frame, result)
            state.note(frame, position_of[frame.index], result, len(sequence))
            show_progress(bar, state, len(sequence), result)

        try:
            map_live(state.mapper, frames, Controls(), note, lambda: None, asked_to_stop, pace)
        finally:
            frames.close()
    if asked_to_stop():
        say("\nstopped: writing what is there so far")
    else:
        state.done = len(sequence)
    state.skipped = list(replay.skipped)
