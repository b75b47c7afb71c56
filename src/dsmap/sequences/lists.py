"""Lists of images and of poses: lines led by a time stamp, in the manner of the TUM benchmark."""

import re
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from dsmap.errors import InputError
from dsmap.reading import is_file
from dsmap.sequences.stamps import SECONDS, Unit, unit_of
from dsmap.sequences.text import Line, is_number, read_lines, read_text

_LEAD = re.compile(r"(\S+?)[\s,;]+(.+)$")
_FOUR = re.compile(r"(\S+?)[\s,;]+(.+?)[\s,;]+([-+]?\d[\d.eE+-]*)[\s,;]+(.+)$")
_FARTHEST_M = 1e5
"""No camera is further from where it began."""
_QUATERNION_TOLERANCE = 0.05
"""A quaternion may be this far from unit length: files have few digits."""


@dataclass(frozen=True)
class ImageList:
    """A list like `rgb.txt`, in order of time."""

    times: np.ndarray
    """Stamps [s], shape (N,)."""
    files: list[Path]
    unit: Unit
    words: list[str]
    """The stamps as written."""


def read_image_list(path: Path, notes: list[str]) -> ImageList:
    """Read a list like `rgb.txt`. A first line of names is passed over; names may have spaces and backslashes.

    Raises:
        InputError: a line has no stamp and file.
    """
    words, files = [], []
    for line in _without_header(read_lines(path), notes, path):
        match = _LEAD.match(line.text)
        if match is None or not is_number(match[1]):
            raise InputError(
                f"{path}:{line.number}: found {line.text!r}, expected 2 columns led by a time stamp"
            )
        words.append(match[1])
        files.append(_file(path.parent, match[2]))
    return _image_list(path, words, files, notes)


def read_associations(path: Path, notes: list[str]) -> tuple[ImageList, ImageList]:
    """Both lists of a file of lines `stamp file stamp file`, colour first, each in order of time.

    Raises:
        InputError: a line is not of this form, or it cannot be told which is the depth.
    """
    rows = []
    for line in _without_header(read_lines(path), notes, path):
        match = _FOUR.match(line.text)
        if match is None or not is_number(match[1]):
            raise InputError(f"{path}:{line.number}: found {line.text!r}, expected 'stamp file stamp file'")
        rows.append((match[1], match[2], match[3], match[4]))
    first, second = (
        _image_list(path, [row[i] for row in rows], [_file(path.parent, row[i + 1]) for row in rows], notes)
        for i in (0, 2)
    )
    if not first.files:
        raise InputError(f"{path}: found no line, expected 'stamp file stamp file'")
    return (second, first) if looks_like_depth(first.files[0]) else (first, second)


def looks_like_depth(file: Path) -> bool:
    """Whether a file's name or its folder's says depth."""
    return "depth" in f"{file.parent.name}/{file.name}".lower()


def read_poses(path: Path, notes: list[str], unit: Unit | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Stamps [s], shape (M,), and poses x y z qx qy qz qw, shape (M, 7), in order of time.

    Lines that hold no pose are left out and counted in `notes`. A heading that names the columns is followed.

    Args:
        unit: of the stamps; None: told from the stamps.

    Raises:
        InputError: no line holds a pose.
    """
    order = _columns(path)
    words, rows, bad = [], [], []
    lines = read_lines(path)
    for line in lines:
        values = line.words
        pose = _pose(values[:8], order) if len(values) >= 8 else None
        if pose is None:
            bad.append(line)
        else:
            words.append(values[0])
            rows.append(pose)
    if bad and not is_number(bad[0].words[0]) and bad[0] == lines[0]:
        bad = bad[1:]  # a heading
    if not rows:
        found = f"the pose {bad[0].text!r}" if bad else "no pose"
        raise InputError(f"{path}: found {found}, expected t tx ty tz qx qy qz qw with a unit quaternion")
    if bad:
        notes.append(
            f"{path.name}: {len(bad)} of {len(bad) + len(rows)} lines hold no pose and are left out "
            f"(line {bad[0].number}: {bad[0].text[:60]!r})"
        )
    unit = unit or unit_of(words)
    if unit != SECONDS:
        notes.append(f"{path.name}: its stamps are read as {unit.name}")
    times, table = unit.times(words), np.array(rows)
    order_of_time = _order(path, times, notes)
    return times[order_of_time], table[order_of_time]


def _pose(values: list[str], order: list[int]) -> np.ndarray | None:
    if not all(map(is_number, values)):
        return None
    pose = np.array([float(v) for v in values])[order]
    if (
        not np.isfinite(pose).all()
        or np.abs(pose[:3]).max() > _FARTHEST_M
        or abs(np.linalg.norm(pose[3:]) - 1) > _QUATERNION_TOLERANCE
    ):
        return None
    return pose


def _columns(path: Path) -> list[int]:
    """Which of the eight columns hold x y z qx qy qz qw: a heading may put qw first."""
    for line in read_text(path).splitlines()[:5]:
        names = [name.lower() for name in re.findall(r"[A-Za-z_]+", line)]
        quaternion = [name for name in names if re.fullmatch(r"(q|rot)_?(rs_)?_?[wxyz]", name)]
        if [name[-1] for name in quaternion[:4]] == ["w", "x", "y", "z"]:
            return [1, 2, 3, 5, 6, 7, 4]
    return [1, 2, 3, 4, 5, 6, 7]


def _without_header(lines: list[Line], notes: list[str], path: Path) -> list[Line]:
    """The lines after a heading: a first line that is led by a word where the others are led by a stamp."""
    if len(lines) > 1 and not is_number(lines[0].words[0]) and is_number(lines[1].words[0]):
        notes.append(f"{path.name}: its first line, {lines[0].text[:60]!r}, is taken as a heading")
        return lines[1:]
    return lines


def _file(folder: Path, text: str) -> Path:
    """The image that a line names; where that is not there, the one of the same name in the listed folder."""
    text = text.strip().strip("\"'").replace("\\", "/").strip()
    first = re.split(r"[\s,;]+", text)[0]
    for name in dict.fromkeys((text, first)):
        if is_file(folder / name):
            return folder / name
    for name in dict.fromkeys((text, first)):  # a path of the machine that wrote the list
        parts = PurePosixPath(name).parts
        for candidate in (Path(*parts[-2:]), Path(parts[-1])):
            if is_file(folder / candidate):
                return folder / candidate
    return folder / (first if Path(first).suffix else text)


def _image_list(path: Path, words: list[str], files: list[Path], notes: list[str]) -> ImageList:
    unit = unit_of(words)
    if unit != SECONDS:
        rate = " at 30 Hz" if unit.name == "frame numbers" else ""
        notes.append(f"{path.name}: its stamps are read as {unit.name}{rate}")
    times = unit.times(words)
    order = _order(path, times, notes)
    return ImageList(times[order], [files[i] for i in order], unit, [words[i] for i in order])


def _order(path: Path, times: np.ndarray, notes: list[str]) -> np.ndarray:
    backwards = int((np.diff(times) < 0).sum())
    if backwards:
        notes.append(
            f"{path.name}: {backwards} of {len(times)} time stamps were out of order and have been sorted"
        )
    return np.argsort(times, kind="stable")
