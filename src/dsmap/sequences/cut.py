"""Cutting a stretch out of a recording, without touching the images."""

import shutil
from collections import Counter
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from dsmap.classes import write_classes
from dsmap.errors import InputError
from dsmap.files import atomic_path
from dsmap.sequences.associate import MAX_DIFFERENCE_S, pose_vector
from dsmap.sequences.base import Sequence
from dsmap.sequences.calibration import write_calibration
from dsmap.sequences.images import Packed, Source, encoded
from dsmap.sequences.lists import read_image_list
from dsmap.sequences.mesh import MESH_FILE as MESH
from dsmap.sequences.pose_lists import read_poses
from dsmap.sequences.writer import LISTS

_POSE_MARGIN_S = 1.0
"""Poses this long before and after the stretch are kept, so that its ends can be interpolated [s]."""


@dataclass
class CutResult:
    """Lines written to each list, by its name (`rgb`, `depth`, `groundtruth`, ...)."""

    counts: dict[str, int]
    begin: float
    """First stamp of the stretch [s]."""


def cut_sequence(
    sequence: Sequence, destination: Path | str, *, start_s: float, seconds: float, outside: bool = False
) -> CutResult:
    """Copy a stretch of a recording into a new sequence in the TUM layout.

    Image files are copied as they are, labels of another set become the 13 classes, or are left out where it is not
    known. From a TUM recording all lists are cut to the stretch, with the images that have no partner and the poses
    of one second around it; other layouts give their pairs.

    Args:
        sequence: the recording, opened whole.
        start_s: beginning, after the first colour stamp [s].
        seconds: length [s]; the end is left out.
        outside: copy what lies outside the recording's folder as well, where a list or a link leads there.

    Raises:
        InputError: the stretch holds no colour image, an image is missing or lies outside, or the destination exists.
    """
    destination = Path(destination)
    if destination.exists() and (not destination.is_dir() or any(destination.iterdir())):
        raise InputError(f"{destination}: found something there already, expected a new folder")
    if not (np.isfinite([start_s, seconds]).all() and start_s >= 0 and seconds > 0):
        raise InputError(f"start {start_s} s and length {seconds} s: expected a start >= 0 and a length > 0")
    images, poses, first = _tum_content(sequence) if sequence.layout == "tum" else _pair_content(sequence)
    begin = first + start_s
    # An image without a partner at the ends must not lose it to the cut: other lists reach 20 ms further.
    chosen = {
        name: [
            (t, file)
            for t, file in rows
            if begin - (name != "rgb") * MAX_DIFFERENCE_S
            <= t
            < begin + seconds + (name != "rgb") * MAX_DIFFERENCE_S
        ]
        for name, rows in images.items()
    }
    if not chosen["rgb"]:
        raise InputError(
            f"{sequence.path}: no colour image from {start_s} s to {start_s + seconds} s after its start"
        )
    kept = [(t, pose) for t, pose in poses if begin - _POSE_MARGIN_S <= t < begin + seconds + _POSE_MARGIN_S]
    mesh = sequence.path / MESH
    if not outside:
        named = [file for rows in chosen.values() for _, file in rows if isinstance(file, Path)]
        _check_inside(sequence.path, named + ([mesh] if mesh.exists() else []))
    write_calibration(destination, sequence.calibration)
    lines = {name: _copied(destination, name, rows) for name, rows in chosen.items() if rows}
    lines["groundtruth"] = [f"{t:.6f} " + " ".join(f"{v:.7f}" for v in pose) for t, pose in kept]
    for name, rows in lines.items():
        if rows:
            with atomic_path(destination / f"{name}.txt") as path:
                path.write_text(LISTS[name] + "\n".join(rows) + "\n")
    if "label" in lines:
        write_classes(destination / "classes.json")
    if mesh.is_file():
        with atomic_path(destination / MESH) as path:
            shutil.copyfile(mesh, path)
    return CutResult({name: len(rows) for name, rows in lines.items()}, begin)


def _check_inside(folder: Path, files: list[Path]) -> None:
    """A list may name any file of this machine: who is sent a recording must not pass such files on with a cut."""
    inside = folder.resolve()
    for file in files:
        if not file.resolve().is_relative_to(inside):
            raise InputError(
                f"{file}: lies outside the recording {folder}, expected its own files (--outside copies others, too)"
            )


ListedImages = list[tuple[float, Source]]
Poses = list[tuple[float, np.ndarray]]


def _tum_content(sequence: Sequence) -> tuple[dict[str, ListedImages], Poses, float]:
    folder = sequence.path
    images: dict[str, ListedImages] = {}
    for name in ("rgb", "depth", "instance"):
        if (folder / f"{name}.txt").exists():
            found = read_image_list(folder / f"{name}.txt", [])
            images[name] = list(zip(found.times.tolist(), found.files, strict=True))
    poses: Poses = []
    if (folder / "groundtruth.txt").exists():
        pose_times, vectors = read_poses(folder / "groundtruth.txt", [])
        poses = list(zip(pose_times.tolist(), vectors, strict=True))
    images["label"] = _labels(sequence)
    return images, poses, images["rgb"][0][0]


def _pair_content(sequence: Sequence) -> tuple[dict[str, ListedImages], Poses, float]:
    entries = sequence.entries
    images: dict[str, ListedImages] = {
        "rgb": [(e.time, e.rgb) for e in entries],
        "depth": [(e.time, e.depth) for e in entries],
        "label": _labels(sequence),
    }
    poses = [(e.time, pose_vector(e.T_world_camera)) for e in entries if e.T_world_camera is not None]
    return images, poses, entries[0].time


def _labels(sequence: Sequence) -> ListedImages:
    """Label images of the frames: files of the 13 classes as they are, those of another set as these classes."""
    labelled = [(e.time, e.label) for e in sequence.entries if e.label is not None]
    if sequence.recording.label_map.name is None:
        return [(t, label) for t, label in labelled]
    read = sequence.recording.label_map.read
    return [(t, Packed(sequence.path, str(label), partial(read, label))) for t, label in labelled]


def _copied(destination: Path, name: str, rows: ListedImages) -> list[str]:
    """Copy the images of one kind and return the lines of their list."""
    lines: list[str] = []
    taken: Counter[str] = Counter()
    for time, source in rows:
        stamp = f"{time:.6f}"
        stem = f"{stamp}_{taken[stamp]}" if taken[stamp] else stamp  # several images may have one stamp
        taken[stamp] += 1
        lines.append(f"{stamp} {_copy(destination, f'{name}/{stem}', source)}")
    return lines


def _copy(destination: Path, stem: str, source: Source) -> str:
    """Copy one image and return its name in the new sequence."""
    if isinstance(source, Packed):
        suffix, data = encoded(source)
        with atomic_path(destination / f"{stem}{suffix}") as path:
            path.write_bytes(data)
        return f"{stem}{suffix}"
    suffix = source.suffix.lower()
    if not source.is_file():
        raise InputError(f"{source}: no such file, expected the image that a list names")
    with atomic_path(destination / f"{stem}{suffix}") as path:
        shutil.copyfile(source, path)
    return f"{stem}{suffix}"
