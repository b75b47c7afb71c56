"""Folders that state a depth camera beside the colour camera: edges tell whether depth is its, or aligned to colour."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.lens import coefficients
from dsmap.plain import parse_json
from dsmap.sequences.base import Recording
from dsmap.sequences.calibration import Calibration
from dsmap.sequences.calibration_checks import check_camera
from dsmap.sequences.camera_files import FileCamera, camera_in, camera_of
from dsmap.sequences.edges import colour_at_edges
from dsmap.sequences.formats.parts import two_cameras
from dsmap.sequences.images import read_colour, read_depth
from dsmap.sequences.registration import register_colour
from dsmap.sequences.text import read_matrix, read_text

_PLACES = (".", "intrinsic", "intrinsics", "extrinsic", "extrinsics", "calib", "calibration", "camera", "cam")
_SUFFIXES = (".json", ".txt", ".yaml", ".yml", ".csv")
_CAMERA = re.compile(r"intrinsic|camera|calib|metadata|(^|_)cam(_|$)|(^|_)k(_|$)")
_DEPTH = re.compile(r"depth(?!_?to)|(^|_)ir($|_)")
_BETWEEN = re.compile(r"extrinsic|depth_?(to|2)_?(colou?r|rgb)|(colou?r|rgb)_?(to|2)_?depth|t_color_depth")
_FROM_COLOUR = re.compile(r"(colou?r|rgb)_?(to|2)_?depth")
_SAMPLES = 6
_SAME_FOCAL, _SAME_PLACE_PX = 0.005, 2.0
_BETTER = 1.05
"""Edges that fit so much better with two cameras say that depth is not aligned."""
_MOST_M = 1.0
"""Cameras further apart than this are stated in millimetres."""
_MAX_BYTES = 1 << 20


@dataclass(frozen=True)
class _Stated:
    camera: Intrinsics
    source: str
    T_color_depth: np.ndarray


def with_own_depth_camera(
    calibration: Calibration, recording: Recording, depth_size: tuple[int, int] | None
) -> Calibration:
    """The calibration with the depth camera that a file of the folder states, where depth turns out to be its own.

    A sentence in the recording's notes says which was taken.

    Args:
        calibration: that of colour, found in a file beside the images.
        depth_size: (width, height) of the depth images.

    Raises:
        InputError: the file states a camera that none is.
    """
    colour = calibration.color_camera or calibration.intrinsics
    if calibration.color_camera is not None or depth_size is None or not recording.path.is_dir():
        return calibration
    stated = _stated(recording.path, depth_size)
    if stated is None or _are_alike(stated, colour):
        return calibration
    check_camera(recording.path / stated.source, stated.camera)
    as_it_is, its_own = _agreements(recording, calibration, stated)
    if as_it_is is not None and its_own < _BETTER * as_it_is:
        recording.notes.append(
            f"{stated.source} states a depth camera of its own, but depth lies on colour as it is: taken as aligned"
        )
        return calibration
    recording.notes.append(
        f"depth is taken as that of the camera of {stated.source}, not aligned to colour: colours are looked up from it"
    )
    source = f"{calibration.source} and {stated.source}"
    return two_cameras(colour, stated.camera, stated.T_color_depth, calibration.depth_scale, source)


def _stated(folder: Path, size: tuple[int, int]) -> _Stated | None:
    """The depth camera of a file of its own, or of a part of a file of both."""
    files = list(_files(folder))
    for file in files:
        name = file.stem.lower()
        is_one = _DEPTH.search(name) and _CAMERA.search(name) and not _BETWEEN.search(name)
        if is_one and (camera := _at(camera_in(file, size), size)) is not None:
            return _Stated(camera, file.relative_to(folder).as_posix(), _between(files))
    for file in files:
        parts = {str(key).lower(): part for key, part in _content(file).items()}
        for name, part in parts.items():
            is_one = _DEPTH.search(name) and not _BETWEEN.search(name) and isinstance(part, dict)
            if is_one and (camera := _at(camera_of(part), size)) is not None:
                T = _of_parts(parts)
                return _Stated(
                    camera, file.relative_to(folder).as_posix(), _between(files) if T is None else T
                )
    return None


def _files(folder: Path) -> Iterator[Path]:
    for place in _PLACES:
        inner = folder / place
        if inner.is_dir():
            yield from sorted(
                f
                for f in inner.iterdir()
                if f.suffix.lower() in _SUFFIXES and f.is_file() and f.stat().st_size <= _MAX_BYTES
            )


def _content(file: Path) -> dict[str, Any]:
    """A JSON file that is a mapping; else nothing."""
    if file.suffix.lower() != ".json":
        return {}
    try:
        found = parse_json(read_text(file), file)
    except InputError:
        return {}
    return found if isinstance(found, dict) else {}


def _at(found: FileCamera | None, size: tuple[int, int]) -> Intrinsics | None:
    """The camera at the size of the depth images; None where it is that of other images."""
    if found is None:
        return None
    w, h = found.size or size
    if abs(w * size[1] / (h * size[0]) - 1) > 0.01:
        return None
    camera = Intrinsics(w, h, *found.values, coefficients(found.model, found.distortion))
    return camera if (w, h) == size else camera.scaled(*size)


def _between(files: list[Path]) -> np.ndarray:
    """The pose of the depth camera in the colour camera that a file states; the same place where none does."""
    for file in files:
        if not _BETWEEN.search(file.stem.lower()):
            continue
        content = _content(file)
        parts = {str(key).lower(): part for key, part in content.items()}
        T = read_matrix(file) if not content else _pose(content)
        T = _of_parts(parts) if T is None else _direction(file.stem.lower(), T)
        if T is not None:
            return T
    return np.eye(4)


def _of_parts(parts: dict[str, Any]) -> np.ndarray | None:
    poses = ((name, _pose(part)) for name, part in parts.items() if _BETWEEN.search(name))
    return next((_direction(name, T) for name, T in poses if T is not None), None)


def _pose(part: Any) -> np.ndarray | None:
    """A 3x4 or 4x4 matrix, or a rotation and a translation; RealSense lists nine numbers by columns."""
    try:
        if not isinstance(part, dict):
            values = np.array(part, np.float64).ravel()
            return np.vstack([values[:12].reshape(3, 4), np.eye(4)[3]]) if values.size in (12, 16) else None
        own = {str(key).lower(): value for key, value in part.items()}
        rotation = np.array(own.get("rotation", own.get("r")), np.float64)
        translation = np.array(own.get("translation", own.get("t")), np.float64).ravel()
        if rotation.size != 9 or translation.size != 3:
            return None
    except (TypeError, ValueError):
        return None
    T = np.eye(4)
    T[:3, :3] = rotation if rotation.ndim == 2 else rotation.reshape(3, 3).T
    T[:3, 3] = translation
    return T


def _direction(name: str, T: np.ndarray) -> np.ndarray | None:
    """A stated pose as T_color_depth in metres; None where it is no pose."""
    R = T[:3, :3]
    if not np.isfinite(T).all() or not np.allclose(R @ R.T, np.eye(3), atol=1e-2) or np.linalg.det(R) < 0:
        return None
    if np.linalg.norm(T[:3, 3]) > _MOST_M:
        T = T.copy()
        T[:3, 3] /= 1000
    return np.linalg.inv(T) if _FROM_COLOUR.search(name) else T


def _are_alike(stated: _Stated, colour: Intrinsics) -> bool:
    depth = stated.camera
    if (depth.width, depth.height) != (colour.width, colour.height):
        scaled = colour.scaled(depth.width, depth.height)
        return (
            _are_alike(stated, scaled) if abs(scaled.fx / scaled.fy - colour.fx / colour.fy) < 0.01 else False
        )
    return (
        abs(depth.fx / colour.fx - 1) < _SAME_FOCAL
        and max(abs(depth.cx - colour.cx), abs(depth.cy - colour.cy)) < _SAME_PLACE_PX
        and bool(np.allclose(stated.T_color_depth, np.eye(4), atol=1e-3))
    )


def _agreements(
    recording: Recording, calibration: Calibration, stated: _Stated
) -> tuple[float | None, float]:
    """How well edges of depth lie on those of colour, as it is and from the camera of its own.

    The first is None where the images' shapes exclude it, or no frame has edges enough.
    """
    colour, found = calibration.intrinsics, []
    w, h = stated.camera.width, stated.camera.height
    may_be_aligned = abs(w * colour.height / (h * colour.width) - 1) < 0.01
    for i in np.unique(np.linspace(0, len(recording.entries) - 1, _SAMPLES).astype(int)):
        entry = recording.entries[int(i)]
        try:
            rgb, depth = read_colour(entry.rgb), read_depth(entry.depth, calibration.depth_scale)
        except InputError:
            continue
        if depth.shape != (h, w) or rgb.shape[:2] != (colour.height, colour.width):
            continue
        looked_up = register_colour(rgb, depth, stated.camera, colour, stated.T_color_depth)
        pair = [
            colour_at_edges(image, depth)
            for image in (cv2.resize(rgb, (w, h), interpolation=cv2.INTER_AREA), looked_up)
        ]
        if pair[0] is not None and pair[1] is not None:
            found.append((pair[0][0], pair[1][0]))
    if not found:
        return (1.0, 0.0) if may_be_aligned else (None, 0.0)
    first, second = np.mean(found, axis=0)
    return (float(first) if may_be_aligned else None), float(second)
