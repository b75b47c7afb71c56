"""The TUM RGB-D layout: `rgb.txt`, `depth.txt`, optional `groundtruth.txt`, `label.txt`, `instance.txt`."""

from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.sequences.associate import associate, poses_at
from dsmap.sequences.base import Entry, Recording


def is_tum(folder: Path) -> bool:
    return (folder / "rgb.txt").is_file() and (folder / "depth.txt").is_file()


def read_tum(folder: Path, depth_time_offset_s: float = 0.0) -> Recording:
    """Associate colour, depth, labels and poses of a folder in the TUM layout.

    Poses are those at the stamps of the depth images: the geometry is seen from there.

    Args:
        depth_time_offset_s: added to the depth stamps before pairing [s].

    Raises:
        InputError: a list is malformed, or no colour image has a depth image.
    """
    notes: list[str] = []
    rgb_times, rgb_files = read_image_list(folder / "rgb.txt", notes)
    depth_times, depth_files = read_image_list(folder / "depth.txt", notes)
    depth_times = depth_times + depth_time_offset_s
    pairs = associate(rgb_times, depth_times)
    if not pairs:
        raise InputError(
            f"{folder}: found {len(rgb_times)} colour and {len(depth_times)} depth stamps and no two within "
            "20 ms, expected stamps of one clock in rgb.txt and depth.txt"
        )
    times = rgb_times[[i for i, _ in pairs]]
    exposed = depth_times[[j for _, j in pairs]]
    poses = _poses(folder / "groundtruth.txt", exposed, notes)
    labels = _optional(folder / "label.txt", times, notes)
    instances = _optional(folder / "instance.txt", times, notes)
    entries = [
        Entry(
            k,
            float(times[k]),
            rgb_files[i],
            depth_files[j],
            labels.get(k),
            instances.get(k),
            poses[k],
            float(exposed[k]),
        )  # fmt: skip
        for k, (i, j) in enumerate(pairs)
    ]
    return Recording("tum", folder, entries, len(rgb_times), len(depth_times), notes)


def read_rows(path: Path, columns: int) -> list[list[str]]:
    """The lines of a TUM text file, split, comments left out.

    Raises:
        InputError: a line has fewer than `columns` columns or does not begin with a finite stamp.
    """
    try:
        lines = path.read_text().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not readable as text ({error})") from error
    rows = []
    for number, line in enumerate(lines, 1):
        words = line.replace(",", " ").split()
        if not words or words[0].startswith("#"):
            continue
        if len(words) < columns or not _is_finite(words[0]):
            raise InputError(
                f"{path}:{number}: found {line.strip()!r}, expected {columns} columns led by a time stamp"
            )
        rows.append(words)
    return rows


def read_image_list(path: Path, notes: list[str]) -> tuple[np.ndarray, list[Path]]:
    """Stamps [s], shape (N,), and files of a list like `rgb.txt`, in order of time."""
    rows = read_rows(path, 2)
    times = np.array([float(row[0]) for row in rows])
    order = _order(path, times, notes)
    return times[order], [path.parent / rows[i][1] for i in order]


def read_poses(path: Path, notes: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Stamps [s], shape (M,), and poses x y z qx qy qz qw, shape (M, 7), in order of time.

    Raises:
        InputError: a value is no finite number, or a quaternion is not of unit length.
    """
    rows = read_rows(path, 8)
    try:
        table = np.array([[float(v) for v in row[:8]] for row in rows]).reshape(-1, 8)
    except ValueError as error:
        raise InputError(f"{path}: {error}, expected lines of t tx ty tz qx qy qz qw") from error
    bad = ~np.isfinite(table).all(axis=1) | (np.abs(np.linalg.norm(table[:, 4:], axis=1) - 1) > 0.05)
    if bad.any():
        row = " ".join(rows[int(np.argmax(bad))])
        raise InputError(
            f"{path}: found the pose {row!r}, expected t tx ty tz qx qy qz qw with a unit quaternion"
        )
    table = table[_order(path, table[:, 0], notes)]
    return table[:, 0], table[:, 1:]


def _order(path: Path, times: np.ndarray, notes: list[str]) -> np.ndarray:
    backwards = int((np.diff(times) < 0).sum())
    if backwards:
        notes.append(
            f"{path.name}: {backwards} of {len(times)} time stamps were out of order and have been sorted"
        )
    return np.argsort(times, kind="stable")


def _poses(path: Path, times: np.ndarray, notes: list[str]) -> list[np.ndarray | None]:
    if not path.exists():
        return [None] * len(times)
    poses = poses_at(times, *read_poses(path, notes))
    missing = sum(pose is None for pose in poses)
    if missing:
        notes.append(f"{path.name}: {missing} of {len(times)} frames have no pose within 20 ms")
    return poses


def _optional(path: Path, times: np.ndarray, notes: list[str]) -> dict[int, Path]:
    """Frame position to file for a list that need not exist nor cover all frames."""
    if not path.exists():
        return {}
    stamps, files = read_image_list(path, notes)
    return {k: files[j] for k, j in associate(times, stamps)}


def _is_finite(word: str) -> bool:
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False
