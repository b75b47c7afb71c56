"""Keeping up with a camera: what a session gives up, and when, so that frames are in the map while they are new.

Frames that come too fast are dropped (`newest_frame`). Before that the model is predicted less often, and labels wait
until their share of the time is there again. Images that are too large for any of this are made smaller before the map
begins (`largest_that_keeps_up`).
"""

import itertools
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dsmap.frame import Frame
from dsmap.fusion.mapper import Mapper, StepResult

LABEL_SHARE = 0.25
"""Of the time, at most, goes into labels."""
LATENCY_S = 0.1
"""So old 95 of 100 frames may be when they are in the map: those who act on it reckon with a tenth of a second."""
_LATE_SHARE = 0.04
"""Labelled frames that are later than that are rarer than the 5 of 100 which may be."""
_MOST_SELDOM = 4
"""The model is predicted in every n-th frame at least: at 30 frames a second a view is as old as 0.13 s."""
_BUSY, _IDLE = 0.9, 0.6
"""Shares of the time between two frames: a step that takes more is too slow, one that takes less has time to spare."""
_MEMORY = 0.1
"""Weight of the newest frame in the means."""
_LABELLING = ("segment", "label")
_NARROWEST = 320
"""Images are made no narrower, whatever the machine: dropping every other frame costs less accuracy."""
_SCALES = (1.0, 0.75, 0.5, 0.375, 0.25)
TRIED, _WARM_UP = 12, 3
"""Frames of a trial, and those of them that are not counted: caches are cold and buffers grow."""


@dataclass
class Pace:
    """Looks at every step, and changes how often the mapper predicts and labels.

    Args:
        mapper: whose model and labeller are told how often.
    """

    mapper: Mapper
    delays_s: list[float] = field(default_factory=list)
    """From the camera to the map, of every mapped frame."""
    step_s: float = 0.0
    """Mean time of a step without labels."""
    label_s: float = 0.0
    """Mean time of labelling a frame."""
    period_s: float = 0.0
    """Mean time between two frames of the camera, dropped ones included."""
    dropped: int = 0
    """Frames that came too fast, up to the one mapped last."""
    labelled_at: list[float] = field(default_factory=list)
    """Stamps of the frames that were labelled [s]."""
    _last_time: float | None = None

    def __post_init__(self) -> None:
        self.usual = self.mapper.model.predict_every

    def observe(self, time: float, result: StepResult, delay_s: float, dropped: int) -> None:
        """A frame was mapped.

        Args:
            time: the frame's own [s].
            delay_s: from the camera to the map.
            dropped: frames so far that came too fast.
        """
        self.delays_s.append(delay_s)
        step, labelling = seconds_of(result)
        self.step_s = _mean(self.step_s, step)
        if self._last_time is not None and time > self._last_time:
            self.period_s = _mean(self.period_s, (time - self._last_time) / (1 + dropped - self.dropped))
        self._last_time, self.dropped = time, dropped
        if result.segmented:
            self.label_s = _mean(self.label_s, labelling)
            self.labelled_at.append(time)
            self.mapper.labeller.rest_until = time + self.rest_s(labelling)
        self._predict_as_often_as_there_is_time()

    def rest_s(self, labelling: float) -> float:
        """From a labelled frame to the next one at least, where labelling it took so long."""
        rest = labelling / LABEL_SHARE
        if self.period_s + self.step_s + labelling > LATENCY_S:  # it has waited for a frame's time at most
            rest = max(rest, max(self.step_s, self.period_s) / _LATE_SHARE)
        return rest

    def _predict_as_often_as_there_is_time(self) -> None:
        if not self.period_s:
            return
        model, busy = self.mapper.model, self.step_s / self.period_s
        if busy > _BUSY:
            model.predict_every = min(model.predict_every + 1, max(_MOST_SELDOM, self.usual))
        elif busy < _IDLE:
            model.predict_every = max(model.predict_every - 1, self.usual)

    def report(self) -> dict[str, Any]:
        """Latency, what was dropped, and what was chosen: plain values for stats.json."""
        late = [1e3 * percentile(self.delays_s, q) if self.delays_s else None for q in (50, 95)]
        camera, between = self.mapper.intrinsics, np.diff(self.labelled_at)
        return {
            "latency_ms": {"median": late[0], "p95": late[1]},
            "mapped_frames": len(self.delays_s),
            "dropped_frames": self.dropped,
            "size": [camera.width, camera.height],
            "labelled_frames": len(self.labelled_at),
            "label_interval_s": float(np.median(between)) if len(between) else None,
            "predict_every": self.mapper.model.predict_every,
            "step_ms": 1e3 * self.step_s,
            "label_ms": 1e3 * self.label_s,
            "camera_period_ms": 1e3 * self.period_s,
        }

    def summary(self) -> str:
        """Latency and what was given up, in two lines."""
        if not self.delays_s:
            return "no frame was mapped"
        told = self.report()
        late, interval = told["latency_ms"], told["label_interval_s"]
        labels = "" if interval is None else f", labels every {interval:.1f} s"
        return (
            f"latency {late['median']:.0f} ms (median), {late['p95']:.0f} ms (95 %); {self.dropped} frames dropped, "
            f"{len(self.delays_s)} mapped\n"
            f"chosen: {told['size'][0]}x{told['size'][1]}{labels}, at the end the model predicted in every "
            f"{told['predict_every']}. frame"
        )


def seconds_of(result: StepResult) -> tuple[float, float]:
    """What a step took [s]: without labels, and for labels."""
    labelling = sum(result.stages_ms.get(name, 0.0) for name in _LABELLING) / 1e3
    return sum(result.stages_ms.values()) / 1e3 - labelling, labelling


def sizes(width: int, height: int) -> list[tuple[int, int]]:
    """Sizes that images may be mapped in, largest first: their own, and smaller ones of the same shape."""
    scaled = [(round(width * s / 2) * 2, round(height * s / 2) * 2) for s in _SCALES[1:]]
    return [(width, height)] + [size for size in scaled if size[0] >= _NARROWEST]


def largest_that_keeps_up(
    candidates: Sequence[tuple[int, int]],
    try_out: Callable[[tuple[int, int]], tuple[float, float]],
    period_s: float,
) -> tuple[int, int]:
    """The largest size in which a step leaves labels their share of the time between two frames; else the smallest.

    Args:
        candidates: largest first.
        try_out: what a step takes at a size [s]: without labels, and for labels (0: there are none).
        period_s: between two frames of the camera.
    """
    for size in candidates[:-1]:
        step, labelling = try_out(size)
        if step <= period_s * (1 - LABEL_SHARE if labelling else _BUSY):
            return size
    return candidates[-1]


def trial(mapper: Mapper, frames: Iterable[Frame]) -> tuple[float, float]:
    """What a step of that mapper takes [s]: without labels, and for labels (0: none). It is not good for more.

    The medians of a few frames; all kernels are compiled, and the network is loaded, when it is over.
    """
    with warnings.catch_warnings(action="ignore"):  # what is wrong with a recording, its mapping says
        took = [seconds_of(mapper.step(frame)) for frame in itertools.islice(frames, TRIED)]
    steps, labelling = np.array(took[_WARM_UP:] or took).reshape(-1, 2).T
    labelled = labelling[labelling > 0]
    return float(np.median(steps)), float(np.median(labelled)) if len(labelled) else 0.0


def _mean(mean: float, value: float) -> float:
    return value if not mean else mean + _MEMORY * (value - mean)


def percentile(values: Sequence[float], q: float) -> float:
    """Of a sequence that is not empty."""
    return float(np.percentile(np.asarray(values), q))
