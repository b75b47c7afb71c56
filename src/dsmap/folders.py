"""Folders that a command writes for a long time: one process at a time, and nothing left of one that was killed."""

import contextlib
import os
import re
from collections.abc import Iterator
from pathlib import Path

from dsmap.errors import InputError, WriteError

try:
    import fcntl
except ImportError:  # not a Unix: nothing to lock with
    fcntl = None  # type: ignore[assignment]

_TEMPORARY = re.compile(r"\..+\.\d+\.tmp(\.\w+)?")
"""Names of `files.atomic_path`."""

_held: set[int] = set()


def _let_go() -> None:
    """A forked process (one that prepares images) must not keep the lock of a parent that is killed."""
    for handle in _held:
        os.close(handle)
    _held.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_let_go)


@contextlib.contextmanager
def locked(folder: Path, what: str) -> Iterator[None]:
    """Create a folder and be the only process that writes it, until the end of the block or of the process.

    The lock is the kernel's, on the folder itself: nothing is left of it, however the process ends.

    Args:
        what: for messages: `run`, `training`, ...

    Raises:
        InputError: another process writes it.
        WriteError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise WriteError(
            f"{folder} cannot be written ({error.strerror}); expected a writable folder"
        ) from error
    _held.add(handle)
    try:
        _lock(handle, folder, what)
        yield
    finally:
        _held.discard(handle)
        os.close(handle)


def remove_leftovers(folder: Path) -> None:
    """Delete what killed processes were writing into a folder; call it while it is `locked`."""
    with contextlib.suppress(OSError):  # an unreadable folder shows as soon as it is written
        for file in sorted(folder.iterdir()):
            if _TEMPORARY.fullmatch(file.name) and file.is_file() and not file.is_symlink():
                file.unlink()


def _lock(handle: int, folder: Path, what: str) -> None:
    if fcntl is None:
        return
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise InputError(
            f"{folder}: another process is writing this {what}; expected it to end first, or another folder"
        ) from error
    except OSError:
        pass  # a file system without locks: two runs are the user's to keep apart
