"""The TUM RGB-D layout: `rgb.txt`, `depth.txt`, optional `groundtruth.txt`, `label.txt`, `instance.txt`."""

from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.sequences.associate import associate, pose_matrix, poses_at
from dsmap.sequences.base import Entry, Recording
from dsmap.sequences.lists import ImageList, read_image_list
from dsmap.sequences.pose_lists import read_poses, read_poses_of_frames
from dsmap.sequences.stamps import FRAMES


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
    rgb, depth = (read_image_list(folder / name, notes) for name in ("rgb.txt", "depth.txt"))
    return paired("tum", folder, rgb, depth, depth_time_offset_s, notes)


def paired(
    layout: str, folder: Path, rgb: ImageList, depth: ImageList, depth_time_offset_s: float, notes: list[str]
) -> Recording:
    """The recording of two lists of images, with the other lists of the folder. Raises InputError: no pair."""
    offset = 0.0 if depth.unit == FRAMES else depth_time_offset_s
    depth_times = depth.times + offset
    pairs = associate(rgb.times, depth_times)
    if not pairs:
        raise InputError(
            f"{folder}: found {len(rgb.times)} colour and {len(depth_times)} depth stamps and no two within "
            "20 ms, expected stamps of one clock in rgb.txt and depth.txt"
        )
    times = rgb.times[[i for i, _ in pairs]]
    exposed = depth_times[[j for _, j in pairs]]
    poses = listed_poses(folder / "groundtruth.txt", exposed, notes)
    labels = _optional(folder / "label.txt", times, notes)
    instances = _optional(folder / "instance.txt", times, notes)
    entries = [
        Entry(
            k,
            float(times[k]),
            rgb.files[i],
            depth.files[j],
            labels.get(k),
            instances.get(k),
            poses[k],
            float(exposed[k]),
        )  # fmt: skip
        for k, (i, j) in enumerate(pairs)
    ]
    return Recording(layout, folder, entries, len(rgb.times), len(depth_times), notes)


def listed_poses(path: Path, times: np.ndarray, notes: list[str]) -> list[np.ndarray | None]:
    """Poses of a list at some stamps; none, and a note, where the list cannot be read."""
    if not path.exists():
        return [None] * len(times)
    try:
        if (found := read_poses_of_frames(path)) is not None:
            return _in_order(path, found, len(times), notes)
        poses = poses_at(times, *read_poses(path, notes))
    except InputError as error:
        notes.append(f"poses are not used: {error}")
        return [None] * len(times)
    missing = sum(pose is None for pose in poses)
    if missing:
        notes.append(f"{path.name}: {missing} of {len(times)} frames have no pose within 20 ms")
    return poses


def _in_order(path: Path, found: np.ndarray, frames: int, notes: list[str]) -> list[np.ndarray | None]:
    """Poses without stamps, if there are as many as frames."""
    if len(found) != frames:
        notes.append(f"poses are not used: {path.name} holds {len(found)} without stamps for {frames} frames")
        return [None] * frames
    notes.append(f"{path.name}: its poses have no stamps and are taken frame by frame")
    return [None if np.isnan(pose).any() else pose_matrix(pose) for pose in found]


def _optional(path: Path, times: np.ndarray, notes: list[str]) -> dict[int, Path]:
    """Frame position to file for a list that need not exist nor cover all frames."""
    if not path.exists():
        return {}
    try:
        found = read_image_list(path, notes)
    except InputError as error:
        notes.append(f"{path.stem}s are not used: {error}")
        return {}
    return {k: found.files[j] for k, j in associate(times, found.times)}
