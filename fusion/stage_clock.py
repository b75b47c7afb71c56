"""How long each stage of a step takes."""

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

import warp as wp


class StageClock:
    """Wall time of the stages of every step.

    Args:
        device: kernels on it are waited for at the end of a stage.
    """

    def __init__(self, device: wp.Device):
        self._device = device
        self.step_ms: dict[str, float] = {}
        """Stage to milliseconds, of the step under way."""
        self.stages_ms: dict[str, list[float]] = defaultdict(list)
        """Stage to milliseconds of every step that had it."""

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
            self.stages_ms[name].append(ms)
