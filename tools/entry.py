"""The `dsmap` program: signals are answered from its first line on, then the command line takes over.

This file imports nothing but what Python itself has loaded, so that there is no time in which Ctrl-C is a traceback.
"""

import contextlib
import os
import signal
import stat
import sys
from types import FrameType

_STOPS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


class Stopped(KeyboardInterrupt):
    """A signal asked the program to end."""

    def __init__(self, number: int):
        super().__init__(signal.Signals(number).name)
        self.number = number


def main() -> None:
    """Run `dsmap`; a signal ends it with one line, and 128 + its number as the exit code."""
    try:
        for number in _STOPS:
            if (
                signal.getsignal(number) != signal.SIG_IGN
            ):  # nohup, or a shell that shields its background jobs
                signal.signal(number, _stop)
        from dsmap.tools.cli import main as command_line

        command_line()
    except KeyboardInterrupt as error:
        _end(error.number if isinstance(error, Stopped) else signal.SIGINT)


def hang_up() -> None:
    """The terminal is gone: what is printed goes nowhere instead of being an error."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        with contextlib.suppress(OSError):
            if stat.S_ISCHR(os.fstat(descriptor).st_mode):
                os.dup2(nowhere, descriptor)
    os.close(nowhere)


def _stop(number: int, frame: FrameType | None) -> None:
    if number == getattr(signal, "SIGHUP", None):
        hang_up()
    for other in _STOPS:  # a second signal does not wait for what the first one has set going
        if signal.getsignal(other) != signal.SIG_IGN:
            signal.signal(other, _end_now)
    raise Stopped(number)


def _end_now(number: int, frame: FrameType | None) -> None:
    os._exit(128 + number)


def _end(number: int) -> None:
    with contextlib.suppress(OSError, ValueError):
        print(f"dsmap: stopped by {signal.Signals(number).name}", file=sys.stderr, flush=True)
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.flush()
    os._exit(128 + number)  # not by way of threads that wait for what will not come


if __name__ == "__main__":
    main()
