"""The boundary to foreign files: what may be opened, how much of it, and what its damage is turned into."""

import contextlib
import lzma
import os
import sqlite3
import stat
import struct
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2

from dsmap.errors import InputError

DECODER_ERRORS = (
    ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RuntimeError, MemoryError, EOFError, OSError,
    AssertionError, NotImplementedError, SyntaxError, struct.error, zlib.error, lzma.LZMAError, zipfile.BadZipFile,
    sqlite3.Error, cv2.error,
)  # fmt: skip
"""What decoders and parsers raise when the bytes are not what they take them for."""
_KINDS = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device",
          stat.S_IFSOCK: "a socket"}  # fmt: skip


@contextlib.contextmanager
def reading(where: Any, expected: str, *more: type[Exception]) -> Iterator[None]:
    """Whatever a parser raises inside means that what it reads is damaged.

    Args:
        where: the file, for the message.
        expected: what it should have been.
        more: exceptions of the parser's own, beside those of Python.

    Raises:
        InputError: in place of any of them.
    """
    try:
        yield
    except (*DECODER_ERRORS, *more) as error:
        raise InputError(
            f"{brief_path(where)}: not readable ({reason(error)}), expected {expected}"
        ) from error


def read_bytes(path: Path | str, expected: str, most: int) -> bytes:
    """The content of a plain file.

    Args:
        expected: what it should be, for the message.
        most: how large it may be [bytes].

    Raises:
        InputError: it is not there, no plain file (a folder, a pipe, a device), too large, or cannot be read.
    """
    check_plain(path, expected, most)
    try:
        return Path(path).read_bytes()
    except (OSError, ValueError, MemoryError) as error:
        raise InputError(
            f"{brief_path(path)}: cannot be read ({reason(error)}), expected {expected}"
        ) from error


def check_plain(path: Path | str, expected: str, most: int | None = None) -> None:
    """Refuse what would block or never end when it is read: pipes and devices; folders; files that are too large.

    Raises:
        InputError: also where nothing is there, or the name is none.
    """
    try:
        found = os.stat(path)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise InputError(
            f"{brief_path(path)}: cannot be read ({reason(error)}), expected {expected}"
        ) from error
    kind = stat.S_IFMT(found.st_mode)
    if kind != stat.S_IFREG:
        raise InputError(
            f"{brief_path(path)}: found {_KINDS.get(kind, 'no plain file')}, expected {expected}"
        )
    if most is not None and found.st_size > most:
        raise InputError(
            f"{brief_path(path)}: found {found.st_size / 1e6:,.0f} MB, expected {expected} of at most "
            f"{most / 1e6:,.0f} MB"
        )


def is_file(path: Path) -> bool:
    """Whether there is a plain file; a name that cannot be one (a NUL, too long, a loop of links) is none."""
    try:
        return stat.S_ISREG(os.stat(path).st_mode)
    except (OSError, ValueError):
        return False


def reason(error: BaseException) -> str:
    """An exception as part of a sentence: its first line, or its name where it says nothing."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    if isinstance(error, RecursionError):
        return "nested too deeply"
    if isinstance(error, MemoryError):
        return "not enough memory"
    text = " ".join(str(error).split())
    if isinstance(error, KeyError | IndexError | AttributeError | AssertionError) or not text:
        text = f"{type(error).__name__} {text}".strip()
    return text if len(text) <= _LONGEST else text[:_LONGEST] + "..."


_LONGEST = 200
"""Of what a message quotes [characters]."""


def brief_path(path: Any) -> str:
    """A path for a message: what cannot be printed is escaped, what is too long is cut."""
    text = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in str(path))
    return text if len(text) <= 2 * _LONGEST else f"{text[:_LONGEST]}...{text[-_LONGEST:]}"
