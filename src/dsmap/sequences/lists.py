"""Lists of images: lines led by a time stamp, in the manner of the TUM benchmark, or as other programs arrange them."""

import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from dsmap.errors import InputError
from dsmap.reading import is_file
from dsmap.sequences.images import IMAGE_SUFFIXES
from dsmap.sequences.stamps import FRAMES, SECONDS, Unit, unit_of
from dsmap.sequences.text import is_number, read_lines

_GAP = r"[\s,;]+"
_STAMP = r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)"
_COLUMN = re.compile(rf"{_STAMP}{_GAP}")
_PLAIN = re.compile(r"[^\s,;\"'\\]+")
"""A name that can be spelt in one way."""
_LOOKED_AT = 20
"""Lines of a list from which its arrangement is told."""
_MANY_ALIKE = 0.1
"""Share of equal stamps from which it is said."""
_HEADINGS = 3
"""Lines before the first of a list that may say something else."""

Row = tuple[tuple[str, str], ...]
"""Stamps as plain numbers and what follows as the file's name: one pair, or two for colour and depth."""


@dataclass(frozen=True)
class ImageList:
    """A list like `rgb.txt`, in order of time."""

    times: np.ndarray
    """Stamps [s], shape (N,)."""
    files: list[Path]
    unit: Unit
    words: list[str]
    """The stamps as written."""


def _plain_number(text: str) -> str:
    """A stamp with commas: those between thousands go (1,560,000,083.25), a lone one is the decimal point."""
    if "," not in text:
        return text
    if re.fullmatch(r"\d{1,3}(?:,\d{3})+(?:\.\d+)?", text) and (text.count(",") > 1 or "." in text):
        return text.replace(",", "")
    return text.replace(",", ".", 1)


def _arranged(pattern: str, *groups: tuple[int, int]) -> Callable[[str], Row | None]:
    """A reader of lines: the groups of the stamp (0: none) and of the file's name, for each image of a line."""
    compiled = re.compile(pattern)

    def read(text: str) -> Row | None:
        match = compiled.fullmatch(text)
        if match is None:
            return None
        row = tuple((_plain_number(match[s]) if s else "", match[f]) for s, f in groups)
        return row if all(is_number(stamp) or not stamp for stamp, _ in row) else None

    return read


_LISTS = (
    _arranged(rf"(\S+?){_GAP}(.+)", (1, 2)),
    _arranged(r"([\d,.]+)[\s;]+(.+)", (1, 2)),  # a comma in the stamp
    _arranged(rf"\d+{_GAP}{_STAMP}{_GAP}(.+)", (1, 2)),  # a number of the line first
    _arranged(rf"(.+?){_GAP}{_STAMP}", (2, 1)),  # the file first
)
"""Arrangements of a list of one kind of image, the usual one first."""
_PAIRS = (
    _arranged(rf"(\S+?){_GAP}(.+?){_GAP}([-+]?\d[\d.eE+-]*){_GAP}(.+)", (1, 2), (3, 4)),
    _arranged(rf"{_STAMP}{_GAP}(\S+?){_GAP}(\S+)", (1, 2), (1, 3)),  # one stamp for both
    _arranged(rf"(\S+?){_GAP}(\S+)", (0, 1), (0, 2)),  # no stamp
    _arranged(rf"(\S+?){_GAP}{_STAMP}{_GAP}(\S+?){_GAP}{_STAMP}", (2, 1), (4, 3)),  # files first
)
"""Arrangements of a list of colour and depth images."""


def read_image_list(path: Path, notes: list[str]) -> ImageList:
    """Read a list like `rgb.txt`; columns may be arranged otherwise, names may have spaces and backslashes.

    Headings are passed over, a torn line is left out; both are said in `notes`.

    Raises:
        InputError: lines have no stamp and file.
    """
    files = _Files(path)
    rows = _rows(path, files, _LISTS, notes, "2 columns led by a time stamp")
    return _image_list(path, [row[0][0] for row in rows], [files.named(row[0][1]) for row in rows], notes)


def read_associations(path: Path, notes: list[str]) -> tuple[ImageList, ImageList]:
    """Both lists of a file of lines `stamp file stamp file`, colour first, each in order of time.

    Lines may also be `stamp file file` or `file file`, whose stamps are the numbers of the lines.

    Raises:
        InputError: lines are not of this form, or there is none.
    """
    files = _Files(path)
    rows = _rows(path, files, _PAIRS, notes, "'stamp file stamp file'")
    if not rows:
        raise InputError(f"{path}: found no line, expected 'stamp file stamp file'")
    first, second = (
        _image_list(
            path, [row[i][0] or str(k) for k, row in enumerate(rows)], [files.named(row[i][1]) for row in rows], notes
        )
        for i in (0, 1)
    )  # fmt: skip
    return (second, first) if looks_like_depth(first.files[0]) else (first, second)


def looks_like_depth(file: Path) -> bool:
    """Whether a file's name or its folder's says depth."""
    return "depth" in f"{file.parent.name}/{file.name}".lower()


def in_order_of_time(path: Path, times: np.ndarray, notes: list[str]) -> np.ndarray:
    """Indices that sort the stamps of a list; a note where they were not in order."""
    backwards = int((np.diff(times) < 0).sum())
    if backwards:
        notes.append(
            f"{path.name}: {backwards} of {len(times)} time stamps were out of order and have been sorted"
        )
    return np.argsort(times, kind="stable")


class _Files:
    """The images that the lines of a list name."""

    def __init__(self, listed_in: Path):
        self._folder, self._own = listed_in.parent, listed_in.stem
        self._listings: dict[Path, dict[str, Path]] = {}
        self._there: dict[str, set[str]] = {}

    def named(self, text: str) -> Path:
        """The image; where it is not there, one of the same name in a folder beside the list."""
        names = _spellings(text)
        if (found := self._exact(names)) is not None:
            return found
        for name in names:  # a path of the machine that wrote the list
            parts = PurePosixPath(name).parts
            for place in (parts[-2:], parts[-1:], (self._own, *parts[-1:])) if parts else ():
                if (found := self._alike(place)) is not None:
                    return found
        return self._folder / (names[-1] if Path(names[-1]).suffix else names[0])

    def has(self, text: str) -> bool:
        """Whether a line's rest names an image that is there, and does not begin with another column."""
        if self._exact(_spellings(text)) is not None:
            return True
        return _COLUMN.match(text) is None and is_file(self.named(text))

    def _exact(self, names: list[str]) -> Path | None:
        for name in names:
            folder, _, base = name.rpartition("/")
            if base in self._plain_files(folder):
                return self._folder / name
        return None

    def _plain_files(self, folder: str) -> set[str]:
        """Names of the files of a folder, asked for once: lists have a million lines."""
        if folder not in self._there:
            try:
                with os.scandir(os.path.join(self._folder, folder)) as found:
                    self._there[folder] = {entry.name for entry in found if entry.is_file()}
            except (OSError, ValueError):  # ValueError: a NUL in the name
                self._there[folder] = set()
        return self._there[folder]

    def _alike(self, parts: tuple[str, ...]) -> Path | None:
        """The image of this name, in upper or lower case, or without its suffix."""
        folder = self._folder
        for part in parts[:-1]:
            inner = self._listing(folder).get(part.lower())
            if inner is None:
                return None
            folder = inner
        known, name = self._listing(folder), parts[-1].lower()
        found = next((known[name + s] for s in ("", *IMAGE_SUFFIXES) if name + s in known), None)
        return found if found is not None and is_file(found) else None

    def _listing(self, folder: Path) -> dict[str, Path]:
        """What a folder holds, by name in lower case."""
        if folder not in self._listings:
            try:
                children = sorted(folder.iterdir(), reverse=True)
            except OSError:
                children = []
            self._listings[folder] = {child.name.lower(): child for child in children}
        return self._listings[folder]


def _spellings(text: str) -> list[str]:
    """The rest of a line as a name that may have blanks, and its first word: more columns may follow."""
    if _PLAIN.fullmatch(text):  # nearly all: lists have a million lines
        return [text]
    text = text.strip().strip("\"'").replace("\\", "/").strip()
    return list(dict.fromkeys((text, re.split(_GAP, text)[0].strip("\"'"))))


def _rows(
    path: Path,
    files: _Files,
    arrangements: tuple[Callable[[str], Row | None], ...],
    notes: list[str],
    expected: str,
) -> list[Row]:
    """The lines of a list, read in the arrangement in which the most of the first name files that are there."""
    lines = read_lines(path)

    def score(read: Callable[[str], Row | None]) -> int:
        rows = [row for line in lines[:_LOOKED_AT] if (row := read(line.text)) is not None]
        return sum(all(files.has(name) for _, name in row) for row in rows)

    read = max(arrangements, key=score)
    rows = [read(line.text) for line in lines]
    begin = next((k for k, row in enumerate(rows) if row is not None), 0)
    if 0 < begin <= _HEADINGS:
        notes.append(f"{path.name}: its first line, {lines[0].text[:60]!r}, is taken as a heading")
        lines, rows = lines[begin:], rows[begin:]
    if len(rows) > 1 and rows[-1] is None:  # a recorder was stopped
        notes.append(f"{path.name}: its last line, {lines[-1].text[:60]!r}, is no entry and left out")
        lines, rows = lines[:-1], rows[:-1]
    bad = next((line for line, row in zip(lines, rows, strict=True) if row is None), None)
    if bad is not None:
        raise InputError(f"{path}:{bad.number}: found {bad.text!r}, expected {expected}")
    return [row for row in rows if row is not None]


def _image_list(path: Path, words: list[str], files: list[Path], notes: list[str]) -> ImageList:
    unit = unit_of(words)
    if unit != SECONDS:
        rate = " at 30 Hz" if unit == FRAMES else ""
        notes.append(f"{path.name}: its stamps are read as {unit.name}{rate}")
    times = unit.times(words)
    order = in_order_of_time(path, times, notes)
    same = int((np.diff(times[order]) == 0).sum())
    if same > _MANY_ALIKE * len(times):
        notes.append(
            f"{path.name}: {same} of {len(times)} stamps are that of the image before; such images are taken in the "
            "order of the list"
        )
    return ImageList(times[order], [files[i] for i in order], unit, [words[i] for i in order])
