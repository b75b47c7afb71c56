"""The Redwood/Open3D layout: `image/` or `color/`, `depth/`, optional `trajectory.log`."""

import re
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.sequences.base import Entry, Recording
from dsmap.sequences.seven_scenes import FRAME_RATE, is_rigid

_SUFFIXES = {".png", ".jpg", ".jpeg", ".tif", ".tiff"}


def is_redwood(folder: Path) -> bool:
    return (folder / "depth").is_dir() and any((folder / name).is_dir() for name in ("image", "color"))


def read_redwood(folder: Path) -> Recording:
    """Pair the images of a folder in the Redwood layout by the number that leads their names.

    Stamps are number / 30 Hz. `trajectory.log` holds camera-to-world poses, the first for the first number.

    Raises:
        InputError: no frame has both colour and depth, or `trajectory.log` is malformed.
    """
    colour = _numbered(folder / ("image" if (folder / "image").is_dir() else "color"))
    depth = _numbered(folder / "depth")
    numbers = sorted(colour.keys() & depth.keys())
    if not numbers:
        raise InputError(
            f"{folder}: found {len(colour)} colour and {len(depth)} depth images of no common number, "
            "expected image/00000.jpg beside depth/00000.png"
        )
    poses = _trajectory(folder / "trajectory.log")
    first = min(colour.keys() | depth.keys())
    notes: list[str] = []
    if poses and len(poses) != len(numbers):
        notes.append(f"trajectory.log holds {len(poses)} poses for {len(numbers)} frames")
    entries = [
        Entry(
            k,
            n / FRAME_RATE,
            colour[n],
            depth[n],
            T_world_camera=poses[n - first] if n - first < len(poses) else None,
        )
        for k, n in enumerate(numbers)
    ]
    return Recording("redwood", folder, entries, len(colour), len(depth), notes)


def _numbered(folder: Path) -> dict[int, Path]:
    found = {}
    for path in sorted(folder.iterdir()):
        match = re.search(r"\d+", path.stem)
        if match and path.suffix.lower() in _SUFFIXES:
            found[int(match[0])] = path
    return found


def _trajectory(path: Path) -> list[np.ndarray | None]:
    """Camera-to-world poses in the file's order; None where one is no rigid transform."""
    if not path.exists():
        return []
    try:
        lines = [line.split() for line in path.read_text().splitlines() if line.strip()]
        blocks = [np.array(lines[i + 1 : i + 5], dtype=np.float64) for i in range(0, len(lines), 5)]
    except (OSError, ValueError) as error:
        raise InputError(
            f"{path}: {error}, expected blocks of a line of three numbers and a 4x4 matrix"
        ) from error
    if any(block.shape != (4, 4) for block in blocks):
        raise InputError(
            f"{path}: found {len(lines)} lines, expected blocks of a line of three numbers and a 4x4 matrix"
        )
    return [T if is_rigid(T) else None for T in blocks]
