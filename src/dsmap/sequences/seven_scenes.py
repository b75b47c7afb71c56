"""The 7-Scenes layout: `frame-XXXXXX.{color.jpg|color.png, depth.png, pose.txt}`."""

import re
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import orthonormal
from dsmap.sequences.base import Entry, Recording
from dsmap.sequences.images import IMAGE_SUFFIXES
from dsmap.sequences.text import read_matrix

FRAME_RATE = 30.0
"""7-Scenes and Redwood store no stamps; both were taken at 30 Hz."""
_SUFFIXES = "|".join(suffix.lstrip(".") for suffix in IMAGE_SUFFIXES)
_FARTHEST_M = 1e5
"""No camera is further from where it began."""
_NAME = re.compile(rf"frame-(\d+)\.(color|depth)\.(?:{_SUFFIXES})$", re.IGNORECASE)


def is_seven_scenes(folder: Path) -> bool:
    return any(_NAME.match(path.name) for path in folder.glob("frame-*.depth.*"))


def read_seven_scenes(folder: Path) -> Recording:
    """Pair the files of a folder in the 7-Scenes layout by their frame number; stamps are number / 30 Hz.

    Raises:
        InputError: no frame has both colour and depth.
    """
    found: dict[str, dict[int, Path]] = {"color": {}, "depth": {}}
    for path in sorted(folder.iterdir()):
        if match := _NAME.match(path.name):
            found[match[2].lower()].setdefault(int(match[1]), path)
    numbers = sorted(found["color"].keys() & found["depth"].keys())
    if not numbers:
        raise InputError(
            f"{folder}: found {len(found['depth'])} depth images and {len(found['color'])} colour images "
            "of no common number, expected frame-XXXXXX.color.jpg (or .png) beside frame-XXXXXX.depth.png"
        )
    notes: list[str] = []
    poses = [_pose(folder / f"{found['depth'][n].name.split('.')[0]}.pose.txt") for n in numbers]
    missing = sum(pose is None for pose in poses)
    if 0 < missing < len(numbers):
        notes.append(f"{missing} of {len(numbers)} frames have no valid pose.txt")
    entries = [
        Entry(k, n / FRAME_RATE, found["color"][n], found["depth"][n], T_world_camera=poses[k])
        for k, n in enumerate(numbers)
    ]
    return Recording("7-scenes", folder, entries, len(found["color"]), len(found["depth"]), notes)


def is_rigid(T: np.ndarray) -> bool:
    """Whether a (4, 4) array is finite, its rotation orthonormal (to the files' few digits), its last row 0 0 0 1."""
    R = T[:3, :3]
    return bool(
        np.isfinite(T).all()
        and np.abs(T[3] - (0, 0, 0, 1)).max() < 1e-3
        and np.abs(T).max() < _FARTHEST_M
        and np.abs(R @ R.T - np.eye(3)).max() < 1e-2
        and np.linalg.det(R) > 0
    )


def _pose(path: Path) -> np.ndarray | None:
    """Camera to world; None where the file is missing or holds no rigid transform (lost frames do)."""
    T = read_matrix(path)
    return orthonormal(T) if T is not None and is_rigid(T) else None
