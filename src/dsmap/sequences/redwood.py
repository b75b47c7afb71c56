"""Folders of images: `image/`, `color/` or `rgb/` beside `depth/`, paired by name or by lists of stamps.

Redwood and Open3D leave `image/00000.jpg`, `depth/00000.png` and `trajectory.log`; other programs name files by stamp
or date, or leave `associations.txt`, or `color.txt` and `depth.txt`.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.sequences.base import Entry, Recording
from dsmap.sequences.lists import read_associations, read_image_list
from dsmap.sequences.names import (
    COLOUR_FOLDERS,
    DEPTH_FOLDERS,
    folder_of,
    images_in,
    mixed_images,
    pair_by_name,
)
from dsmap.sequences.seven_scenes import is_rigid
from dsmap.sequences.text import read_text
from dsmap.sequences.tum import listed_poses, paired

_LAYOUT_OF_RGB = "folders"
"""Of `rgb/` beside `depth/`: no camera is the usual one there."""
_LEAST_MIXED = 3
"""Colour and depth images in one folder make a recording from this many on."""
_ASSOCIATIONS = ("associations.txt", "association.txt", "associated.txt", "associate.txt", "assoc.txt")


def is_redwood(folder: Path) -> bool:
    if not folder.is_dir():
        return False
    if folder_of(folder, COLOUR_FOLDERS) is not None and folder_of(folder, DEPTH_FOLDERS) is not None:
        return True
    return min(map(len, mixed_images(folder))) >= _LEAST_MIXED


def read_redwood(folder: Path, depth_time_offset_s: float = 0.0) -> Recording:
    """Pair the images of two folders by lists of stamps where there are some, else by what varies in their names.

    Numbers are frames at 30 Hz. `trajectory.log` holds camera-to-world poses, the first for the first number.

    Raises:
        InputError: no frame has both colour and depth, or `trajectory.log` is malformed.
    """
    colour, depth = folder_of(folder, COLOUR_FOLDERS), folder_of(folder, DEPTH_FOLDERS)
    if colour is None or depth is None:
        images = mixed_images(folder)
        layout = _LAYOUT_OF_RGB
    else:
        images = images_in(colour), images_in(depth)
        layout = "redwood" if colour.name.lower() in ("image", "color") else _LAYOUT_OF_RGB
    if not all(images):
        raise InputError(
            f"{folder}: found no folder of colour or depth images, expected image/ beside depth/"
        )
    if (listed := _by_lists(layout, folder, depth_time_offset_s)) is not None:
        return listed
    pairs = pair_by_name(folder, *images, depth_time_offset_s)
    poses = _trajectory(folder / "trajectory.log")
    given: list[np.ndarray | None] = [None] * len(pairs.times)
    if poses and pairs.numbers is not None:
        if len(poses) != len(pairs.numbers):
            pairs.notes.append(f"trajectory.log holds {len(poses)} poses for {len(pairs.numbers)} frames")
        first = pairs.first_number if pairs.first_number is not None else min(pairs.numbers)
        given = [poses[n - first] if n - first < len(poses) else None for n in pairs.numbers]
    elif poses and len(poses) == len(given):
        given = list(poses)
    elif poses:
        pairs.notes.append(f"poses are not used: trajectory.log holds {len(poses)} for {len(given)} frames")
    else:
        given = listed_poses(folder / "groundtruth.txt", pairs.depth_times, pairs.notes)
    entries = [
        Entry(
            k, float(pairs.times[k]), pairs.colour[k], pairs.depth[k], T_world_camera=given[k],
            depth_time=None if pairs.numbers is not None else float(pairs.depth_times[k]),
        )
        for k in range(len(pairs.times))
    ]  # fmt: skip
    return Recording(layout, folder, entries, pairs.num_colour, pairs.num_depth, pairs.notes)


def _by_lists(layout: str, folder: Path, depth_time_offset_s: float) -> Recording | None:
    """By `associations.txt`, or `color.txt` beside `depth.txt`; None where there are none."""
    notes: list[str] = []
    file = next((folder / name for name in _ASSOCIATIONS if (folder / name).is_file()), None)
    if file is not None:
        rgb, depth = read_associations(file, notes)
        return paired(layout, folder, rgb, depth, depth_time_offset_s, notes)
    rgb_list, depth_list = _list_of(folder, COLOUR_FOLDERS), _list_of(folder, DEPTH_FOLDERS)
    if rgb_list is None or depth_list is None:
        return None
    rgb, depth = read_image_list(rgb_list, notes), read_image_list(depth_list, notes)
    return paired(layout, folder, rgb, depth, depth_time_offset_s, notes)


def _list_of(folder: Path, names: Iterable[str]) -> Path | None:
    """The list of the images of a kind: that of the folder which is read, else any."""
    images = folder_of(folder, names)
    own = [images.name] if images else []
    return next((file for name in (*own, *names) if (file := folder / f"{name}.txt").is_file()), None)


def _trajectory(path: Path) -> list[np.ndarray | None]:
    """Camera-to-world poses in the file's order; None where one is no rigid transform."""
    if not path.exists():
        return []
    lines = [line.split() for line in read_text(path).splitlines() if line.strip()]
    try:
        blocks = [np.array(lines[i + 1 : i + 5], dtype=np.float64) for i in range(0, len(lines), 5)]
    except ValueError as error:
        raise InputError(
            f"{path}: {error}, expected blocks of a line of three numbers and a 4x4 matrix"
        ) from error
    if any(block.shape != (4, 4) for block in blocks):
        raise InputError(
            f"{path}: found {len(lines)} lines, expected blocks of a line of three numbers and a 4x4 matrix"
        )
    return [T if is_rigid(T) else None for T in blocks]
