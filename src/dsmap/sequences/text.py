"""Reading the text files that people's recorders and editors leave: encodings, separators, names with spaces."""

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dsmap.errors import InputError
from dsmap.limits import MAX_TEXT_BYTES
from dsmap.reading import read_bytes

COMMENTS = ("#", "%", "//", ";")
"""A line that begins with one of these says nothing."""
_SEPARATOR = re.compile(r"[\s,;]+")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?$", re.ASCII)
_LONGEST_NUMBER, _LARGEST_NUMBER = 60, 1e30


class TextLine(NamedTuple):
    """A line of a list that is no comment."""

    number: int
    """In the file, from 1."""
    text: str

    @property
    def words(self) -> list[str]:
        """Split at blanks, commas and semicolons."""
        return [word for word in _SEPARATOR.split(self.text) if word]


def read_text(path: Path) -> str:
    """A text file in UTF-8, UTF-16 (with or without a mark) or, where it is neither, Latin-1.

    Raises:
        InputError: it cannot be read, or is no text.
    """
    data = read_bytes(path, "a text file", MAX_TEXT_BYTES)
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        encodings = ["utf-16"]
    elif b"\0" in data[:400]:
        encodings = ["utf-16-le" if data[1:2] == b"\0" else "utf-16-be"]
    else:
        encodings = ["utf-8-sig", "latin-1"]
    for encoding in encodings:
        try:
            text = data.decode(encoding).lstrip("\ufeff")
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text
    raise InputError(f"{path}: not readable as text, expected UTF-8 or UTF-16")


def read_lines(path: Path) -> list[TextLine]:
    """The lines of a text file that are neither empty nor comments."""
    stripped = (line.strip() for line in read_text(path).splitlines())
    return [
        TextLine(number, line)
        for number, line in enumerate(stripped, 1)
        if line and not line.startswith(COMMENTS)
    ]


def is_number(word: str) -> bool:
    """Whether a word is a number that may be one of something: finite, and not beyond all measure."""
    return (
        len(word) < _LONGEST_NUMBER and _NUMBER.match(word) is not None and abs(float(word)) < _LARGEST_NUMBER
    )


def numbers_of(path: Path) -> np.ndarray | None:
    """All numbers of a file of numbers alone, shape (N,); None where something else is in it."""
    try:
        words = [word for line in read_lines(path) for word in line.words]
    except InputError:
        return None
    try:
        return np.array([float(word) for word in words])
    except ValueError:
        return None


def read_matrix(path: Path) -> np.ndarray | None:
    """A 4x4 matrix, also one written without its last row; None where the file holds none."""
    values = numbers_of(path) if path.is_file() else None
    return matrix_of(values)


def matrix_of(values: np.ndarray | None) -> np.ndarray | None:
    """16 or 12 numbers, row by row, as a (4, 4) matrix; None for any other number of them."""
    if values is None or len(values) not in (12, 16):
        return None
    if len(values) == 12:
        values = np.append(values, (0.0, 0.0, 0.0, 1.0))
    return values.reshape(4, 4)
