"""Lists of poses in the manner of the TUM benchmark: a stamp, a position and a quaternion, or a matrix."""

import re
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.sequences.associate import pose_vector
from dsmap.sequences.lists import in_order_of_time
from dsmap.sequences.seven_scenes import is_rigid
from dsmap.sequences.stamps import SECONDS, Unit, unit_of
from dsmap.sequences.text import TextLine, is_number, read_lines, read_text

_FARTHEST_M = 1e7
"""No camera is further from where it began, not even in millimetres."""
_QUATERNION_TOLERANCE = 0.05
"""A quaternion may be this far from unit length: files have few digits."""
_MATRIX = (12, 16)
"""Numbers of a pose that is written as a matrix of 3 or 4 rows."""


def read_poses(path: Path, notes: list[str], unit: Unit | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Stamps [s], shape (M,), and poses x y z qx qy qz qw, shape (M, 7), in order of time.

    Lines that hold no pose are left out and counted in `notes`. A heading that names the columns is followed.

    Args:
        unit: of the stamps; None: told from the stamps.

    Raises:
        InputError: no line holds a pose.
    """
    words, rows = _rows(path, notes)
    unit = unit or unit_of(words)
    if unit != SECONDS:
        notes.append(f"{path.name}: its stamps are read as {unit.name}")
    times = unit.times(words)
    order = in_order_of_time(path, times, notes)
    return times[order], np.array(rows)[order]


def read_poses_of_frames(path: Path) -> np.ndarray | None:
    """Poses without stamps, one a frame, x y z qx qy qz qw, shape (M, 7): lines of 12 or 16 numbers (KITTI's).

    None where the file holds others; a frame whose matrix is none gets NaN.
    """
    lines = read_lines(path)
    if not lines or not all(len(line.words) in _MATRIX and all(map(is_number, line.words)) for line in lines):
        return None
    found = [_of_matrix(np.array(line.words, np.float64)) for line in lines]
    return np.array([np.full(7, np.nan) if pose is None else pose for pose in found])


def _rows(path: Path, notes: list[str]) -> tuple[list[str], list[np.ndarray]]:
    """Stamps as written, and poses. Raises InputError: there is none."""
    order = _columns(path)
    words: list[str] = []
    rows: list[np.ndarray] = []
    bad: list[TextLine] = []
    lines = read_lines(path)
    if (whole := _table(lines, order)) is not None:
        return whole
    for line in lines:
        pose = _pose(line.words, order)
        if pose is None:
            bad.append(line)
        else:
            words.append(line.words[0])
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
    return words, rows


def _table(lines: list[TextLine], order: list[int]) -> tuple[list[str], list[np.ndarray]] | None:
    """The same of a file whose every line is a pose of eight numbers, at once; None where one is not."""
    words = [line.words for line in lines]
    if not words or any(len(row) != 8 for row in words):
        return None
    try:
        poses = np.array(words, dtype=np.str_).astype(np.float64)[:, order]
    except ValueError:
        return None
    far = np.abs(poses[:, :3]).max(axis=1)
    sound = (far <= _FARTHEST_M) & (np.abs(np.linalg.norm(poses[:, 3:], axis=1) - 1) <= _QUATERNION_TOLERANCE)
    stamps = [row[0] for row in words]
    return (stamps, list(poses)) if sound.all() and all(map(is_number, stamps)) else None


def _pose(words: list[str], order: list[int]) -> np.ndarray | None:
    """x y z qx qy qz qw of a stamp and what follows it; None where that is no pose."""
    if len(words) - 1 in _MATRIX and all(map(is_number, words)):
        matrix = _of_matrix(np.array(words[1:], np.float64))
        if matrix is not None:
            return matrix
    if len(words) < 8 or not all(map(is_number, words[:8])):
        return None
    pose = np.array([float(v) for v in words[:8]])[order]
    if (
        not np.isfinite(pose).all()
        or np.abs(pose[:3]).max() > _FARTHEST_M
        or abs(np.linalg.norm(pose[3:]) - 1) > _QUATERNION_TOLERANCE
    ):
        return None
    return pose


def _of_matrix(values: np.ndarray) -> np.ndarray | None:
    T = np.eye(4)
    T[: len(values) // 4] = values.reshape(-1, 4)
    return (
        pose_vector(T)
        if np.allclose(T[3], (0, 0, 0, 1)) and is_rigid(T) and np.abs(T[:3, 3]).max() <= _FARTHEST_M
        else None
    )


def _columns(path: Path) -> list[int]:
    """Which of the eight columns hold x y z qx qy qz qw: a heading may put qw first."""
    for line in read_text(path).splitlines()[:5]:
        names = [name.lower() for name in re.findall(r"[A-Za-z_]+", line)]
        quaternion = [name for name in names if re.fullmatch(r"(q|rot)_?(rs_)?_?[wxyz]", name)]
        if [name[-1] for name in quaternion[:4]] == ["w", "x", "y", "z"]:
            return [1, 2, 3, 5, 6, 7, 4]
    return [1, 2, 3, 4, 5, 6, 7]
