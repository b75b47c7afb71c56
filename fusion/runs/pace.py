"""Keeping up with a camera: what a live session gives up, and when, so that frames are shown while they are new.

Frames that come too fast are dropped (`newest_frame`). Before that the model is predicted less often, and labels wait
until their share of the time is there again.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dsmap.fusion.mapper import Mapper, StepResult

LABEL_SHARE = 0.25
"""Of the time, at most, goes into labels."""
_MOST_SELDOM = 4
"""The model is predicted in every n-th frame at least: at 30 frames a second a view is as old as 0.13 s."""
_BUSY, _IDLE = 0.9, 0.6
"""Shares of the time between two frames: a step that takes more is too slow, one that takes less has time to spare."""
_MEMORY = 0.1
"""Weight of the newest frame in the means."""
_LABELLING = ("segment", "label")


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
    period_s: float = 0.0
    """Mean time between two frames of the camera, dropped ones included."""
    _last_time: float | None = None
    _last_dropped: int = 0

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
        labelling = sum(result.stages_ms.get(name, 0.0) for name in _LABELLING) / 1e3
        step = sum(result.stages_ms.values()) / 1e3 - labelling
        self.step_s = step if not self.step_s else self.step_s + _MEMORY * (step - self.step_s)
        if self._last_time is not None and time > self._last_time:
            period = (time - self._last_time) / (1 + dropped - self._last_dropped)
            self.period_s = (
                period if not self.period_s else self.period_s + _MEMORY * (period - self.period_s)
            )
        self._last_time, self._last_dropped = time, dropped
        if result.segmented:
            self.mapper.labeller.rest_until = time + labelling / LABEL_SHARE
        self._predict_as_often_as_there_is_time()

    def _predict_as_often_as_there_is_time(self) -> None:
        if not self.period_s:
            return
        model, busy = self.mapper.model, self.step_s / self.period_s
        if busy > _BUSY:
            model.predict_every = min(model.predict_every + 1, max(_MOST_SELDOM, self.usual))
        elif busy < _IDLE:
            model.predict_every = max(model.predict_every - 1, self.usual)

    def summary(self, dropped: int) -> str:
        """Latency and what was given up, in a line."""
        if not self.delays_s:
            return "no frame was mapped"
        median, most = (1e3 * percentile(self.delays_s, q) for q in (50, 95))
        return (
            f"latency {median:.0f} ms (median), {most:.0f} ms (95 %); {dropped} frames dropped, "
            f"{len(self.delays_s)} mapped; at the end predicted in every {self.mapper.model.predict_every}. frame"
        )


def percentile(values: Sequence[float], q: float) -> float:
    """Of a sequence that is not empty."""
    return float(np.percentile(np.asarray(values), q))
