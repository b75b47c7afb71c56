"""The 7-Scenes layout: `frame-XXXXXX.{color.jpg|color.png, depth.png, pose.txt}`."""

import re
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import orthonormal
from dsmap.sequences.base import Entry, Recording
from dsmap.sequences.images import IMAGE_SUFFIXES
from dsmap.sequences.stamps import FRAME_RATE
from dsmap.sequences.text import read_matrix

_SUFFIXES = "|".join(suffix.lstrip(".") for suffix in IMAGE_SUFFIXES)
_FARTHEST_M = 1e7
"""No camera is further from where it began, not even in millimetres."""
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


def are_rigid(poses: np.ndarray) -> np.ndarray:
    """`is_rigid` of many (N, 4, 4) arrays at once, shape (N,)."""
    R = poses[:, :3, :3]
    with np.errstate(all="ignore"):
        turns = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2)) < 1e-2  # not so for NaN
        last = np.abs(poses[:, 3] - (0, 0, 0, 1)).max(axis=1) < 1e-3
        return turns & last & (np.abs(poses).max(axis=(1, 2)) < _FARTHEST_M) & (np.linalg.det(R) > 0)


def is_rigid(T: np.ndarray) -> bool:
    """Whether a (4, 4) array is finite, its rotation orthonormal (to the files' few digits), its last row 0 0 0 1."""
    return T.shape == (4, 4) and bool(are_rigid(T[None])[0])


def _pose(path: Path) -> np.ndarray | None:
    """Camera to world; None where the file is missing or holds no rigid transform (lost frames do)."""
    T = read_matrix(path)
    return orthonormal(T) if T is not None and is_rigid(T) else None
