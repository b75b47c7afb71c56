"""What the signals that ask a program to end have in common; imports nothing that takes time."""

import contextlib
import os
import signal
import stat

STOPS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Ctrl-C, the system's request to end, and the closed terminal."""


class Stopped(KeyboardInterrupt):
    """A signal asked the program to end."""

    def __init__(self, number: int):
        super().__init__(signal.Signals(number).name)
        self.number = number


def exit_code(number: int) -> int:
    """Of a program that a signal ended, as shells count."""
    return 128 + number


def is_ignored(number: int) -> bool:
    """Whether whoever started the program wants it to outlive the terminal (nohup).

    A shell ignores Ctrl-C for its background jobs, too; one that is sent to the program itself is meant all the same.
    """
    return number == getattr(signal, "SIGHUP", None) and signal.getsignal(number) == signal.SIG_IGN


def stop_printing() -> None:
    """Whoever read what is printed is gone: from now on it goes nowhere, instead of being an error.

    A standard stream that is a plain file stays as it is.
    """
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        with contextlib.suppress(OSError):
            if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                os.dup2(nowhere, descriptor)
    os.close(nowhere)
