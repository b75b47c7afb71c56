"""What readers of several formats share: poses, numbered files, frames put together by stamp."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics, orthonormal
from dsmap.sequences.associate import associate
from dsmap.sequences.base import Entry, Recording
from dsmap.sequences.calibration import Calibration
from dsmap.sequences.images import Source
from dsmap.sequences.seven_scenes import is_rigid
from dsmap.sequences.text import numbers_of

OPENGL_AXES = np.diag([1.0, -1.0, -1.0, 1.0])
"""Between a camera that looks along -z with y up (OpenGL, ARKit) and one that looks along z with y down."""


@dataclass(frozen=True)
class Stamped:
    """An image and its stamp [s]."""

    time: float
    image: Source


def numbered(folder: Path, pattern: str) -> dict[int, Path]:
    """Files of a folder whose whole name matches, by the number in the pattern's first group, in order."""
    found: dict[int, Path] = {}
    if folder.is_dir():
        for path in folder.iterdir():
            if match := re.fullmatch(pattern, path.name, re.IGNORECASE):
                found.setdefault(int(match[1]), path)
    return dict(sorted(found.items()))


def named(folder: Path, name: str) -> Path:
    """The entry of a folder with a name; where there is none, one that differs by upper and lower case alone."""
    path = folder / name
    if path.exists() or not folder.is_dir():
        return path
    return next((child for child in sorted(folder.iterdir()) if child.name.lower() == name.lower()), path)


def common_numbers(
    path: Path, colour: Mapping[int, Source], depth: Mapping[int, Source], expected: str
) -> list[int]:
    """Numbers that have both images, in order. Raises InputError if there is none."""
    numbers = sorted(colour.keys() & depth.keys())
    if not numbers:
        raise InputError(
            f"{path}: found {len(colour)} colour and {len(depth)} depth images of no common number, expected {expected}"
        )
    return numbers


def recording_by_number(
    layout: str,
    path: Path,
    colour: Mapping[int, Source],
    depth: Mapping[int, Source],
    calibration: Calibration | None,
    *,
    expected: str,
    times: Mapping[int, float] | None = None,
    rate: float = 30.0,
    poses: Mapping[int, np.ndarray | None] | None = None,
    labels: Mapping[int, Source] | None = None,
    instances: Mapping[int, Source] | None = None,
    notes: list[str] | None = None,
) -> Recording:
    """Frames of the numbers that have both images.

    Args:
        expected: for the error where no number has both.
        times: stamps by number [s]; else number / rate.
        poses: T_world_camera by number; one that is not rigid is left out.
    """
    numbers = common_numbers(path, colour, depth, expected)
    notes = notes if notes is not None else []
    given = {n: rigid(T) for n, T in (poses or {}).items()}
    missing = sum(given.get(n) is None for n in numbers)
    if given and missing:
        notes.append(f"{missing} of {len(numbers)} frames have no valid pose")
    entries = [
        Entry(
            k,
            times[n] if times is not None and n in times else n / rate,
            colour[n],
            depth[n],
            (labels or {}).get(n),
            (instances or {}).get(n),
            given.get(n),
        )
        for k, n in enumerate(numbers)
    ]
    return Recording(layout, path, entries, len(colour), len(depth), notes, calibration)


def recording_by_stamp(
    layout: str,
    path: Path,
    colour: Sequence[Stamped],
    depth: Sequence[Stamped],
    calibration: Calibration | None,
    notes: list[str],
    max_difference: float = 0.02,
) -> Recording:
    """Frames of the images whose stamps are near each other, without poses. Raises InputError if there is none."""
    pairs = (
        associate(np.array([s.time for s in colour]), np.array([s.time for s in depth]), max_difference)
        if colour and depth
        else []
    )
    if not pairs:
        raise InputError(
            f"{path}: found {len(colour)} colour and {len(depth)} depth images and no two within "
            f"{max_difference * 1000:.0f} ms, expected stamps of one clock"
        )
    entries = [
        Entry(k, colour[i].time, colour[i].image, depth[j].image, depth_time=depth[j].time)
        for k, (i, j) in enumerate(pairs)
    ]
    return Recording(layout, path, entries, len(colour), len(depth), notes, calibration)


def rigid(T: np.ndarray | None) -> np.ndarray | None:
    """The rigid transform that a (4, 4) array is but for rounding, or None."""
    if T is None or T.shape != (4, 4) or not is_rigid(T):
        return None
    return orthonormal(T)


def read_matrix_of(path: Path, rows: int = 4, columns: int = 4) -> np.ndarray | None:
    """A matrix of numbers in a text file, float64; None where there is none of this shape."""
    values = numbers_of(path)
    return values.reshape(rows, columns) if values is not None and values.size == rows * columns else None


def same_size(a: Intrinsics, b: Intrinsics) -> bool:
    return (a.width, a.height) == (b.width, b.height)


def two_cameras(
    colour: Intrinsics, depth: Intrinsics, T_color_depth: np.ndarray, depth_scale: float, source: str
) -> Calibration:
    """Frames of the depth camera, into which colour is brought."""
    if colour == depth and np.allclose(T_color_depth, np.eye(4), atol=1e-6):
        return Calibration(colour, depth_scale, source)
    T = None if np.allclose(T_color_depth, np.eye(4), atol=1e-9) else T_color_depth
    return Calibration(depth, depth_scale, source, T_color_depth=T, color_camera=colour)


def seen_from(image: np.ndarray, camera: Intrinsics, other: Intrinsics) -> np.ndarray:
    """Ids of one camera as another at the same place sees them: the nearest pixel, the border's beyond it."""
    columns = (np.arange(other.width) - other.cx) / other.fx * camera.fx + camera.cx
    rows = (np.arange(other.height) - other.cy) / other.fy * camera.fy + camera.cy
    x = np.clip(np.floor(columns + 0.5).astype(np.int64), 0, camera.width - 1)
    y = np.clip(np.floor(rows + 0.5).astype(np.int64), 0, camera.height - 1)
    return np.ascontiguousarray(image[y][:, x])


def camera_from(K: np.ndarray, size: tuple[int, int]) -> Intrinsics:
    """The pinhole camera of a matrix K, (3, 3) or (4, 4), and a (width, height)."""
    return Intrinsics(*size, float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]))


def confident(depth: np.ndarray, confidence: np.ndarray) -> np.ndarray:
    """Depth of an iPhone without the pixels of the lowest confidence (0 of 0, 1, 2).

    An image that has no other confidence is kept: the app left the values out.
    """
    if confidence.shape != depth.shape or not confidence.any():
        return depth
    return np.where(confidence > 0, depth, 0).astype(depth.dtype)
