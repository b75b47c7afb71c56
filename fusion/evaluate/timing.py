"""Timing the mapper on frames that are already in memory."""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from dsmap.frame import Frame, Intrinsics
from dsmap.fusion.config import MapConfig
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.runs.prepare_ahead import prepare_ahead
from dsmap.fusion.segmenter import Segmenter
from dsmap.fusion.stage_clock import WARM_UP


@dataclass
class Timing:
    """What one system did with a recording."""

    frame_ms: list[float] = field(default_factory=list)
    """Wall time of every frame [ms]."""
    poses: list[np.ndarray] = field(default_factory=list)
    """T_world_camera of every frame, shape (4, 4); a lost frame carries the last one."""
    tracked: list[bool] = field(default_factory=list)
    stages_ms: dict[str, list[float]] = field(default_factory=dict)
    """Wall time of every stage of every frame that had it [ms]."""
    latency_ms: list[float] = field(default_factory=list)
    """From the start of a frame's preparation to its pose and map [ms]."""

    @property
    def fps(self) -> float:
        """Frames per second, without the first WARM_UP frames, in which code is compiled and loaded."""
        counted = self.frame_ms[WARM_UP:] or self.frame_ms
        return 1000 * len(counted) / sum(counted)

    def stages(self) -> dict[str, dict[str, float]]:
        """Mean and median of every stage [ms], without the first WARM_UP frames."""
        counted = {name: np.array(ms[WARM_UP:] or ms) for name, ms in self.stages_ms.items()}
        return {
            name: {"mean": float(ms.mean()), "median": float(np.median(ms))} for name, ms in counted.items()
        }


def time_steps(frames: Iterable, step: Callable[..., tuple[np.ndarray, bool]]) -> Timing:
    """Call `step(frame)`, which returns a pose and whether it was tracked, and time every call."""
    timing = Timing()
    for frame in frames:
        start = time.perf_counter()
        T_world_camera, tracked = step(frame)
        timing.frame_ms.append(1000 * (time.perf_counter() - start))
        timing.latency_ms.append(timing.frame_ms[-1])
        timing.poses.append(T_world_camera)
        timing.tracked.append(tracked)
    return timing


def time_mapper(
    frames: Sequence[Frame], intrinsics: Intrinsics, config: MapConfig, segmenter: Segmenter | None = None
) -> Timing:
    """Map frames, with labels if there is a segmenter, and time every frame and stage.

    A frame's time runs from the end of the one before, so that the times add up to the whole run: what is done
    beside another frame, its preparation, is in that frame's.
    """
    mapper, timing = Mapper(config, intrinsics, segmenter), Timing()
    start = time.perf_counter()
    for ready in prepare_ahead(mapper, frames):
        result = mapper.step(ready.frame, ready.maps, waited_ms=ready.waited_ms)
        end = time.perf_counter()
        timing.frame_ms.append(1000 * (end - start))
        timing.latency_ms.append(1000 * (end - ready.begun))
        timing.poses.append(result.T_world_camera)
        timing.tracked.append(result.tracked)
        for name, ms in result.stages_ms.items():
            timing.stages_ms.setdefault(name, []).append(ms)
        start = end
    return timing
