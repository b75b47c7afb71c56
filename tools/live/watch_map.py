"""The live page beside `dsmap map`: a recording is mapped as fast as it goes, and can be watched."""

import contextlib
import signal
import time
from collections.abc import Callable, Iterator
from typing import Any

from dsmap.frame import Frame
from dsmap.fusion.mapper import StepResult
from dsmap.fusion.runs.map_live import Controls, Moment
from dsmap.fusion.runs.map_recording import RunState
from dsmap.fusion.runs.newest_frame import Arrived
from dsmap.tools.live.page import LivePage

HOST, PORT = "127.0.0.1", 8080


@contextlib.contextmanager
def watching(
    args: Any, state: RunState, asked_to_stop: Callable[[], int]
) -> Iterator[tuple[Callable[[Frame, StepResult], None], Callable[[], int]]]:
    """Serve the page; what `map_recording` takes as `watch` and `asked_to_stop`: its buttons work as Ctrl-C does.

    Args:
        args: options of `dsmap map`.
        asked_to_stop: of `signals_noted`.
    """
    controls = Controls()
    page = LivePage(HOST, PORT, args.out.resolve().name, controls)
    print(f"open {page.address}", flush=True)

    def stop() -> int:
        return asked_to_stop() or (int(signal.SIGINT) if controls.stop.is_set() else 0)

    def watch(frame: Frame, result: StepResult) -> None:
        now = time.monotonic()
        began = now - sum(result.stages_ms.values()) / 1e3
        page.show(state.mapper, Moment(Arrived(frame, began, 0), result, now))
        if controls.save.is_set():
            controls.save.clear()
            state.save(state)
            page.say(f"checkpoint after {state.mapper.time} frames")
        while controls.paused.is_set() and not stop():
            time.sleep(0.05)

    try:
        yield watch, stop
    finally:
        page.close()
