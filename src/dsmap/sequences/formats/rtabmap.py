"""Folders exported by RTAB-Map: `rgb/`, `depth/`, `calib/` (also `NAME_rgb/`, ...), and a list of poses."""

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.lens import coefficients
from dsmap.sequences.associate import pose_matrix
from dsmap.sequences.base import Recording
from dsmap.sequences.calibration import Calibration
from dsmap.sequences.formats.parts import Stamped, recording_by_stamp
from dsmap.sequences.formats.protocol import Options, Reader
from dsmap.sequences.images import IMAGE_SUFFIXES
from dsmap.sequences.text import read_text

_STEM = re.compile(r"\d+(?:\.\d+)?")
_RATE = 30.0
_LARGEST_ID = 1e7
"""Names below this are numbers of nodes, above it stamps of seconds since 1970."""


def _detect(path: Path) -> bool:
    return path.is_dir() and _folders(path) is not None


def _folders(path: Path) -> tuple[Path, Path, Path] | None:
    for calib in sorted(path.glob("*calib")):
        begin = calib.name.removesuffix("calib")
        rgb = next(
            (path / f"{begin}{name}" for name in ("rgb", "left") if (path / f"{begin}{name}").is_dir()), None
        )
        if rgb is not None and (path / f"{begin}depth").is_dir() and any(calib.glob("*.yaml")):
            return rgb, path / f"{begin}depth", calib
    return None


def _read(path: Path, _options: Options) -> Recording:
    folders = _folders(path)
    if folders is None:
        raise InputError(f"{path}: found no rgb, depth and calib folders, expected RTAB-Map's export")
    rgb, depth, calib = folders
    colour, by_depth = _stamped(rgb), _stamped(depth)
    numbers = bool(colour) and colour[-1].time < _LARGEST_ID
    if numbers:
        colour, by_depth = (
            [Stamped(s.time / _RATE, s.image) for s in images] for images in (colour, by_depth)
        )
    calibration, T_base_camera = _camera(sorted(calib.glob("*.yaml"))[0])
    notes: list[str] = []
    recording = recording_by_stamp("rtabmap", path, colour, by_depth, calibration, notes, 1e-3)
    poses = _poses(path, numbers, T_base_camera)
    if not poses:
        return recording
    keys = np.array(sorted(poses))
    entries = []
    for entry in recording.entries:
        nearest = float(keys[np.abs(keys - entry.time).argmin()])
        entries.append(
            replace(entry, T_world_camera=poses[nearest] if abs(nearest - entry.time) < 1e-3 else None)
        )
    return replace(recording, entries=entries)


READER = Reader("rtabmap", _detect, _read)


def _stamped(folder: Path) -> list[Stamped]:
    files = [f for f in folder.iterdir() if f.suffix.lower() in IMAGE_SUFFIXES and _STEM.fullmatch(f.stem)]
    return sorted((Stamped(float(f.stem), f) for f in files), key=lambda s: s.time)


def _camera(file: Path) -> tuple[Calibration, np.ndarray]:
    """The camera of a file in OpenCV's YAML, and where it sits on the robot (`local_transform`), (4, 4)."""
    read_text(file)
    try:
        storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_READ)
        size = (int(storage.getNode("image_width").real()), int(storage.getNode("image_height").real()))
        K = _matrix(storage, "camera_matrix", 3, 3)
        D = _matrix(storage, "distortion_coefficients", 1, -1)
        local = _matrix(storage, "local_transform", 3, 4)
    except cv2.error as error:
        raise InputError(
            f"{file}: not readable as OpenCV's YAML ({error.err}), expected a camera_matrix"
        ) from error
    if K is None or min(size) < 1:
        raise InputError(
            f"{file}: found no image_width, image_height and camera_matrix, expected RTAB-Map's camera"
        )
    distortion = None
    if D is not None and D.any():
        # A fisheye has 4 coefficients among 6 there; see rtabmap's CameraModel.
        distortion = (
            coefficients("fisheye", D.ravel()[[0, 1, 4, 5]])
            if D.size == 6
            else coefficients("radtan", D.ravel()[:8])
        )
    camera = Intrinsics(*size, K[0, 0], K[1, 1], K[0, 2], K[1, 2], distortion)
    T = np.eye(4) if local is None else np.vstack([local, (0, 0, 0, 1)])
    return Calibration(camera, 1000.0, f"{file.parent.name}/{file.name}"), T


def _matrix(storage: cv2.FileStorage, name: str, rows: int, columns: int) -> np.ndarray | None:
    node = storage.getNode(name)
    if node.empty():
        return None
    values = node.getNode("data")  # a plain map of rows, cols and data, or with OpenCV's type
    plain = node.getNode("dt").empty()
    data = np.array([values.at(i).real() for i in range(values.size())]) if plain else node.mat()
    return np.array(data, np.float64).reshape(rows, columns) if np.size(data) else None


def _poses(path: Path, numbers: bool, T_base_camera: np.ndarray) -> dict[float, np.ndarray]:
    """Camera-to-world poses by stamp, of lines of stamp x y z qx qy qz qw [id]; of the robot or of the camera."""
    files = sorted(path.glob("*poses*.txt"))
    file = next((f for f in files if "camera_poses" in f.name), files[0] if files else None)
    if file is None:
        return {}
    of_camera = "camera_poses" in file.name
    found = {}
    for line in read_text(file).splitlines():
        words = line.split()
        if len(words) < 8 or words[0].startswith("#"):
            continue
        try:
            values = np.array(words[:9], np.float64)
        except ValueError as error:
            raise InputError(f"{file}: {error}, expected lines of stamp x y z qx qy qz qw id") from error
        if np.isfinite(values).all() and np.linalg.norm(values[4:8]) > 0.5:
            key = (values[8] if len(values) > 8 else values[0]) / _RATE if numbers else values[0]
            found[float(key)] = pose_matrix(values[1:8]) @ (np.eye(4) if of_camera else T_base_camera)
    return found
