"""The `dsmap` program: signals are answered from its first line on, then the command line takes over.

This file imports nothing that takes time, so that there is no moment in which Ctrl-C is a traceback.
"""

import atexit
import contextlib
import os
import signal
import sys
from importlib import import_module
from types import FrameType

from dsmap.stopping import STOPS, Stopped, exit_code, is_ignored, stop_printing


def main() -> None:
    """Run `dsmap`; a signal ends it with one line, and 128 + its number as the exit code."""
    try:
        for number in STOPS:
            if not is_ignored(number):
                signal.signal(number, _stop)
        import_module("dsmap.tools.cli").main()
    except KeyboardInterrupt as error:
        _end(error.number if isinstance(error, Stopped) else signal.SIGINT)


def _stop(number: int, frame: FrameType | None) -> None:
    for other in STOPS:  # a second signal does not wait for what the first one has set going
        if not is_ignored(other):
            signal.signal(other, _end_now)
    if number == getattr(signal, "SIGHUP", None):
        stop_printing()
    raise Stopped(number)


def _end_now(number: int, frame: FrameType | None) -> None:
    os._exit(exit_code(number))


def _end(number: int) -> None:
    with contextlib.suppress(OSError, ValueError):
        print(f"dsmap: stopped by {signal.Signals(number).name}", file=sys.stderr, flush=True)
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.flush()
    with contextlib.suppress(Exception):
        atexit._run_exitfuncs()  # temporary folders
    os._exit(exit_code(number))  # not by way of threads that wait for what will not come


if __name__ == "__main__":
    main()
