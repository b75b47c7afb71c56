"""Folders that a command writes for a long time: one process at a time, and nothing left of one that was killed."""

import atexit
import contextlib
import os
import re
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from dsmap.errors import InputError, WriteError

try:
    import fcntl
except ImportError:  # not a Unix: nothing to lock with
    fcntl = None  # type: ignore[assignment]

_TEMPORARY = re.compile(r"\..+\.\d+\.tmp(\.\w+)?")
"""Names of `files.atomic_path`."""

_YOUNG_S = 60.0
"""A temporary folder this young may be about to be locked [s]."""
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


def temporary_folder(kind: str) -> Path:
    """A new folder among the system's temporary ones, which goes with the process; those of killed ones go now.

    Args:
        kind: a word for its name.
    """
    for old in Path(tempfile.gettempdir()).glob(f"dsmap-{kind}-*"):
        with contextlib.suppress(OSError, InputError):
            about = old.lstat()
            ours = stat.S_ISDIR(about.st_mode) and about.st_uid == os.getuid()
            if ours and time.time() - about.st_ctime > _YOUNG_S:
                with locked(old, kind):  # whoever made it is gone
                    shutil.rmtree(old, ignore_errors=True)
    folder = Path(tempfile.mkdtemp(prefix=f"dsmap-{kind}-"))
    held = contextlib.ExitStack()
    held.callback(shutil.rmtree, folder, ignore_errors=True)
    held.enter_context(locked(folder, kind))
    atexit.register(held.close)
    return folder


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
