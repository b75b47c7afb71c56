"""Writing files so that a crash never leaves half of one behind; plain values as JSON and YAML."""

import contextlib
import json
import os
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import yaml

from dsmap.errors import InputWarning, WriteError


@contextlib.contextmanager
def atomic_path(path: Path | str, durable: bool = False) -> Iterator[Path]:
    """Yield a temporary path beside `path`; rename it to `path` on success, delete it on failure.

    `durable` waits for the disk before the old file goes: for what must outlive a power cut, not only a crash.

    The temporary name keeps the suffix, so that writers which look at it (images, arrays) still work.

    Raises:
        WriteError: the disk is full, or the folder cannot be written.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.tmp{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        os.chmod(temporary, 0o666 & ~_umask())  # some writers make files that only their owner can read
        if durable:
            with open(temporary, "rb") as file:
                os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError as error:
        why = error.strerror or str(error)
        raise WriteError(f"cannot write {path}: {why}", (path.name,), why) from error
    finally:
        with contextlib.suppress(OSError):  # a parent that is a file must not hide the error above
            temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def all_that_fits(folder: Path) -> Iterator[Callable[..., bool]]:
    """Yield a function that calls a writer with its arguments; a file that cannot be written is no reason to give up
    the others. The function says whether it was.

    Raises:
        WriteError: at the end, with the names of all that could not be written.
    """
    missing: list[str] = []
    reasons: list[str] = []

    def attempt(write: Callable[..., Any], *args: Any, **options: Any) -> bool:
        try:
            write(*args, **options)
        except WriteError as error:
            missing.extend(error.files or (str(error),))
            reasons.append(error.reason or str(error))
            return False
        return True

    yield attempt
    if missing:
        why = "; ".join(dict.fromkeys(reasons))
        raise WriteError(f"{folder}: not written: {', '.join(missing)} ({why})", tuple(missing), why)


def written_or_warned(what: str, then: str, write: Callable[..., Any], *args: Any) -> bool:
    """Call a writer with its arguments; whether it could write. If not, a warning says `what` is missing, and `then`.

    For what is written on the way, so that a crash loses little: a full disk is no reason to lose everything.
    """
    try:
        write(*args)
    except WriteError as error:
        warnings.warn(f"no {what} ({error}); {then}", InputWarning, stacklevel=2)
        return False
    return True


def write_json(path: Path | str, values: Any, indent: int | None = 1) -> None:
    """Write plain values as indented JSON; indent None: all on one line."""
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(values, indent=indent) + "\n", encoding="utf-8")


def write_yaml(path: Path | str, values: Any) -> None:
    """Write plain values as YAML, in their order; tuples become lists."""
    with atomic_path(path) as temporary:
        temporary.write_text(yaml.safe_dump(as_read_back(values), sort_keys=False))


def as_read_back(values: Any) -> Any:
    """Plain values as they come back from a file: tuples are lists."""
    return json.loads(json.dumps(values))


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
