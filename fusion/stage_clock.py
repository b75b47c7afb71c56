"""How long each stage of a step takes."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import warp as wp

from dsmap.fusion.state import part_of

WARM_UP = 5
"""First frames that speed figures leave out: caches are cold and buffers grow."""


@dataclass
class StageTime:
    """Wall time of a stage over all steps that had it, in as much memory for a million of them as for ten."""

    first_ms: list[float] = field(default_factory=list)
    """Of the first WARM_UP steps."""
    count: int = 0
    """Steps after those."""
    total_ms: float = 0.0
    """Of the steps after those."""

    def add(self, ms: float) -> None:
        """One more step had it."""
        if len(self.first_ms) < WARM_UP:
            self.first_ms.append(ms)
        else:
            self.count, self.total_ms = self.count + 1, self.total_ms + ms

    @property
    def counted_ms(self) -> float:
        """Sum over all steps but the first; of a stage that had no others, over those."""
        return self.total_ms if self.count else sum(self.first_ms)

    @property
    def mean_ms(self) -> float:
        """Mean over the same steps."""
        return self.counted_ms / (self.count or max(len(self.first_ms), 1))


class StageClock:
    """Wall time of the stages of every step.

    Args:
        device: kernels on it are waited for at the end of a stage.
    """

    def __init__(self, device: wp.Device):
        self._device = device
        self.step_ms: dict[str, float] = {}
        """Stage to milliseconds, of the step under way."""
        self.stages: dict[str, StageTime] = {}
        """Stage to its time over all steps."""

    def begin(self, waited_ms: float) -> None:
        """A step begins, after its maps were waited for."""
        self.step_ms = {"preprocess": waited_ms}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time what happens inside as one stage of this step."""
        start = time.perf_counter()
        yield
        if self._device.is_cuda:
            wp.synchronize_device(self._device)
        self.step_ms[name] = (time.perf_counter() - start) * 1e3

    def end(self) -> None:
        """The step is over."""
        for name, ms in self.step_ms.items():
            self.stages.setdefault(name, StageTime()).add(ms)

    def state(self) -> dict[str, Any]:
        """What is carried from frame to frame: of each stage count, sum, and the first times."""
        return {
            f"clock.{name}": np.array([stage.count, stage.total_ms, *stage.first_ms])
            for name, stage in self.stages.items()
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Go on where `state` was taken; older states hold the time of every step."""
        for name, ms in part_of(state, "stage.").items():
            self.stages[name] = StageTime()
            for value in ms.tolist():
                self.stages[name].add(value)
        for name, values in part_of(state, "clock.").items():
            count, total, *first = values.tolist()
            self.stages[name] = StageTime(first, int(count), total)
