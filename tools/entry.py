"""The `dsmap` program: signals are answered from its first line on, then the command line takes over.

Only the program imports this file: it answers signals as soon as it is loaded, before anything that takes time is.
"""

import os
import signal
from types import FrameType
from typing import Any


def _end_now(number: int, frame: FrameType | None) -> None:
    """Nothing has begun yet, or a second signal does not wait for what the first one has set going."""
    try:
        os.write(2, f"dsmap: stopped by {signal.Signals(number).name}\n".encode())
    finally:
        os._exit(128 + number)


def _answer(handler: Any) -> None:
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        shielded = name == "SIGHUP" and signal.getsignal(signal.SIGHUP) == signal.SIG_IGN  # nohup
        if number is not None and not shielded:
            signal.signal(number, handler)


_answer(_end_now)

import atexit  # noqa: E402
import contextlib  # noqa: E402
import sys  # noqa: E402
from importlib import import_module  # noqa: E402

from dsmap.stopping import Stopped, exit_code, stop_printing  # noqa: E402


def main() -> None:
    """Run `dsmap`; a signal ends it with one line, and 128 + its number as the exit code."""
    try:
        _answer(_stop)
        import_module("dsmap.tools.cli").main()
    except KeyboardInterrupt as error:
        _end(error.number if isinstance(error, Stopped) else signal.SIGINT)


def _stop(number: int, frame: FrameType | None) -> None:
    _answer(_end_now)
    if number == getattr(signal, "SIGHUP", None):
        stop_printing()
    raise Stopped(number)


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
