"""A disk that fails: the n-th thing that is written through Python does, or all from the n-th on."""

import builtins
import contextlib
import errno
import io
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

FAULTS = {"full": errno.ENOSPC, "broken": errno.EIO, "short": errno.ENOSPC}
"""Kinds: nothing of the write arrives; the device fails; half of it arrives before the disk is full."""


class FaultyDisk:
    """Counts what is written below a folder and lets some of it fail.

    Args:
        folder: what is written elsewhere is not counted.
        fails_at: number of the first failure, from 1; 0: none.
        kind: of FAULTS.
        stays: whether all that follows fails as well, as on a disk that stays full.
    """

    def __init__(self, folder: Path, fails_at: int = 0, kind: str = "full", stays: bool = False):
        self.folder, self.fails_at, self.kind, self.stays = str(folder), fails_at, kind, stays
        self.count = 0
        self.failed: list[str] = []
        """What failed, in order: `write map.ply`, ..."""

    @contextlib.contextmanager
    def in_use(self) -> Iterator["FaultyDisk"]:
        """Inside, every file that Python writes is on this disk."""
        usual, replace, sync, mkdir = io.open, os.replace, os.fsync, os.mkdir

        def opened(file: Any, mode: str = "r", *args: Any, **options: Any) -> Any:
            stream = usual(file, mode, *args, **options)
            writes = any(letter in mode for letter in "wax+") and isinstance(file, str | os.PathLike)
            return _Stream(self, stream, os.fspath(file)) if writes and self._is_ours(file) else stream

        def replaced(source: Any, target: Any, **options: Any) -> None:
            if self._is_ours(target):
                self.happens(f"rename {target}")
            replace(source, target, **options)

        def synced(descriptor: int) -> None:
            self.happens("sync")
            sync(descriptor)

        def made(path: Any, *args: Any, **options: Any) -> None:
            if self._is_ours(path) and not os.path.isdir(path):
                self.happens(f"mkdir {path}")
            mkdir(path, *args, **options)

        with (
            mock.patch.object(io, "open", opened), mock.patch.object(builtins, "open", opened),
            mock.patch.object(os, "replace", replaced), mock.patch.object(os, "fsync", synced),
            mock.patch.object(os, "mkdir", made),
        ):  # fmt: skip
            yield self

    def happens(self, what: str) -> None:
        """Count one thing.

        Raises:
            OSError: it is the turn of this one to fail.
        """
        self.count += 1
        if self.fails_at and (self.count == self.fails_at or (self.stays and self.count > self.fails_at)):
            self.failed.append(what)
            number = FAULTS[self.kind]
            raise OSError(number, os.strerror(number))

    def _is_ours(self, path: Any) -> bool:
        return os.path.abspath(os.fspath(path)).startswith(self.folder)


class _Stream:
    """A file whose writes are counted."""

    def __init__(self, disk: FaultyDisk, stream: Any, name: str):
        self._disk, self._stream, self._name = disk, stream, name

    def write(self, data: Any) -> int:
        try:
            self._disk.happens(f"write {self._name}")
        except OSError:
            if self._disk.kind == "short":
                self._stream.write(data[: len(data) // 2])
            raise
        return self._stream.write(data)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def __enter__(self) -> "_Stream":
        return self

    def __exit__(self, *error: Any) -> None:
        self._stream.close()

    def __iter__(self) -> Any:
        return iter(self._stream)
