"""Stray Scanner: `rgb.mp4`, `depth/000000.png`, `confidence/`, `camera_matrix.csv`, `odometry.csv`."""

import csv
from functools import partial
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sequences.associate import pose_matrix
from dsmap.sequences.base import Recording
from dsmap.sequences.formats.film import Film
from dsmap.sequences.formats.parts import (
    confident,
    named,
    numbered,
    read_matrix_of,
    recording_by_number,
    two_cameras,
)
from dsmap.sequences.formats.protocol import Options, Reader
from dsmap.sequences.images import Packed, Source, image_size, read_ids, read_stored
from dsmap.sequences.text import read_text

_CAMERA, _ODOMETRY, _FILM = "camera_matrix.csv", "odometry.csv", "rgb.mp4"


def _detect(path: Path) -> bool:
    return named(path, _CAMERA).is_file() and named(path, _FILM).is_file() and named(path, "depth").is_dir()


def _read(path: Path, _options: Options) -> Recording:
    camera_file, odometry, pictures = (named(path, name) for name in (_CAMERA, _ODOMETRY, _FILM))
    film = Film(pictures)
    if not film.streams:
        raise InputError(f"{pictures}: found no pictures, expected a film")
    index, _, _, width, height = film.streams[0]
    ticks = film.times(index)
    colour: dict[int, Source] = {
        k: Packed(pictures, f"frame {k}", partial(film.frame, index, tick, "rgb24"))
        for k, (tick, _) in enumerate(ticks)
    }
    times, poses = _odometry(odometry)
    files = numbered(named(path, "depth"), r"(\d+)\.(?:png|npy)")
    sure = numbered(named(path, "confidence"), r"(\d+)\.png")
    depth: dict[int, Source] = {
        n: Packed(path, f"depth/{file.name}", partial(_depth, file, sure.get(n))) for n, file in files.items()
    }
    notes = [] if len(colour) == len(files) else [f"the film has {len(colour)} frames, depth/ {len(files)}"]
    K = read_matrix_of(camera_file, 3, 3)
    if K is None:
        raise InputError(f"{camera_file}: found no 3x3 matrix, expected the camera's")
    camera = Intrinsics(width, height, K[0, 0], K[1, 1], K[0, 2], K[1, 2])
    size = _size(next(iter(files.values()))) if files else None
    calibration = two_cameras(camera, camera.scaled(*size), np.eye(4), 1000.0, _CAMERA) if size else None
    return recording_by_number(
        "stray-scanner", path, colour, depth, calibration, expected="rgb.mp4 and depth/000000.png",
        times=times or {k: t for k, (_, t) in enumerate(ticks)}, poses=poses, notes=notes,
    )  # fmt: skip


READER = Reader("stray-scanner", _detect, _read)


def _size(file: Path) -> tuple[int, int] | None:
    if file.suffix == ".npy":
        height, width = _depth(file, None).shape
        return width, height
    return image_size(file)


def _depth(file: Path, confidence: Path | None) -> np.ndarray:
    """Depth [mm]; early versions of the app wrote arrays instead of images."""
    depth = read_stored(file)
    depth = depth.astype(np.uint16)
    return confident(depth, read_ids(confidence)) if confidence is not None else depth


def _odometry(path: Path) -> tuple[dict[int, float], dict[int, np.ndarray]]:
    """Stamps [s] and camera-to-world poses by frame number; the camera's axes are x right, y down, z forward."""
    if not path.is_file():
        return {}, {}
    rows = list(csv.DictReader(read_text(path).splitlines(), skipinitialspace=True))
    times, poses = {}, {}
    try:
        for k, row in enumerate(rows):
            n = int(row.get("frame") or k)
            times[n] = float(row["timestamp"])
            pose = np.array([float(row[key]) for key in ("x", "y", "z", "qx", "qy", "qz", "qw")])
            if np.isfinite(pose).all() and np.linalg.norm(pose[3:]) > 0.5:
                poses[n] = pose_matrix(pose)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: {error!r}, expected timestamp, frame, x, y, z, qx, qy, qz, qw") from error
    return times, poses
