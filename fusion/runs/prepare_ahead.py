"""Preparing the next frame's maps while this one is tracked and fused: they depend on nothing but the frame."""

import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2

from dsmap.frame import Frame
from dsmap.fusion.mapper import Mapper
from dsmap.kernels.launch import step_aside
from dsmap.kernels.types import FrameMaps


@dataclass
class Prepared:
    """A frame whose maps are there."""

    frame: Frame
    maps: list[FrameMaps]
    begun: float
    """When its preparation began (time.perf_counter) [s]."""
    waited_ms: float = 0.0
    """How long the mapper had to wait for it."""


def prepare_ahead(mapper: Mapper, frames: Iterable[Frame]) -> Iterator[Prepared]:
    """Read and prepare each frame in a thread of its own, one frame ahead of the caller.

    A step of the mapper leaves the cores idle between its kernels, for about a fifth of its time; this work fills
    the gaps and otherwise stands aside: a core that it took from a kernel would make the other one wait, since both
    get half of the rows. It makes no difference to the maps. A frame is shown the later for it, see `dsmap bench`.

    Raises:
        InputError: of a frame, when it is that frame's turn.
    """
    source = iter(frames)

    def work() -> Prepared | None:
        frame = next(source, None)
        begun = time.perf_counter()
        return None if frame is None else Prepared(frame, mapper.prepare(frame), begun)

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)  # its threads would not stand aside
    try:
        with ThreadPoolExecutor(1, thread_name_prefix="dsmap-ahead", initializer=step_aside) as thread:
            ahead = thread.submit(work)
            while True:
                start = time.perf_counter()
                ready = ahead.result()
                if ready is None:
                    return
                ready.waited_ms = (time.perf_counter() - start) * 1e3
                ahead = thread.submit(work)
                yield ready
    finally:
        cv2.setNumThreads(threads)
