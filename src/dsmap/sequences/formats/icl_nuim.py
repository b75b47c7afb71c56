"""ICL-NUIM: the TUM-compatible folders with `*.gt.freiburg`, and the original `scene_00_0000.{png,depth,txt}`.

Its camera has a negative fy: the data set's axes are mirrored. Here they are turned to x right, y down, z forward.
"""

import re
from functools import partial
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sequences.associate import pose_matrix
from dsmap.sequences.base import Recording
from dsmap.sequences.calibration import Calibration
from dsmap.sequences.formats.parts import numbered, recording_by_number
from dsmap.sequences.formats.protocol import Options, Reader
from dsmap.sequences.images import Packed, Source, image_size
from dsmap.sequences.text import read_text

_CAMERA = Intrinsics(640, 480, 481.2, 480.0, 319.5, 239.5)
_SOURCE = "known default of ICL-NUIM"
_MIRROR = np.diag([1.0, -1.0, 1.0, 1.0])
_TUM_SCALE = 5000.0
_NAME = re.compile(r"(living_?room|office|lr|of)_?(traj|kt)_?\d", re.IGNORECASE)
"""Of the folders that the data set's archives make."""
_CENTIMETRES = 20.0
"""Rooms are smaller than this [m]: a median depth above it is in centimetres."""


def _detect(path: Path) -> bool:
    if not path.is_dir():
        return False
    known = _truth(path) is not None or (_NAME.search(path.name) and (path / "associations.txt").is_file())
    compatible = bool(known) and (path / "rgb").is_dir() and (path / "depth").is_dir()
    return compatible or any(path.glob("scene_*_*.depth"))


def _truth(path: Path) -> Path | None:
    return next(iter(sorted(path.glob("*.gt.freiburg"))), None)


def _read(path: Path, _options: Options) -> Recording:
    if (path / "rgb").is_dir():
        return _compatible(path)
    colour = numbered(path, r"scene_\d+_(\d+)\.png")
    files = numbered(path, r"scene_\d+_(\d+)\.depth")
    size = _first_size(path, colour)
    camera = _CAMERA.scaled(*size)
    first = _planar(next(iter(files.values())), camera, 1.0)
    metres = 0.01 if np.median(first) > _CENTIMETRES else 1.0
    notes = ["assumed: depth in centimetres"] if metres != 1.0 else []
    depth: dict[int, Source] = {
        n: Packed(path, file.name, partial(_planar, file, camera, metres)) for n, file in files.items()
    }
    poses = {n: _pov_pose(file, metres) for n, file in numbered(path, r"scene_\d+_(\d+)\.txt").items()}
    return recording_by_number(
        "icl-nuim", path, colour, depth, Calibration(camera, 1.0, _SOURCE), poses=poses, notes=notes,
        expected="scene_00_0000.png beside scene_00_0000.depth",
    )  # fmt: skip


READER = Reader("icl-nuim", _detect, _read)


def _compatible(path: Path) -> Recording:
    colour, depth = (numbered(path / name, r"(\d+)\.(?:png|jpg)") for name in ("rgb", "depth"))
    poses: dict[int, np.ndarray | None] = {}
    if (truth := _truth(path)) is not None:
        for line in read_text(truth).splitlines():
            words = line.split()
            if len(words) >= 8 and not words[0].startswith("#"):
                try:
                    poses[int(float(words[0]))] = (
                        _MIRROR @ pose_matrix(np.array(words[1:8], np.float64)) @ _MIRROR
                    )
                except ValueError as error:
                    raise InputError(
                        f"{truth}: {error}, expected lines of number x y z qx qy qz qw"
                    ) from error
    calibration = Calibration(_CAMERA.scaled(*_first_size(path, colour)), _TUM_SCALE, _SOURCE)
    return recording_by_number(
        "icl-nuim", path, colour, depth, calibration, expected="rgb/0.png beside depth/0.png", poses=poses
    )


def _first_size(path: Path, colour: dict[int, Path]) -> tuple[int, int]:
    size = image_size(next(iter(colour.values()))) if colour else None
    if size is None:
        raise InputError(f"{path}: found no colour image that can be decoded, expected some")
    return size


def _planar(file: Path, camera: Intrinsics, metres: float) -> np.ndarray:
    """Planar depth [m] of a text file of distances from the camera's centre, row by row."""
    try:
        distance = np.array(read_text(file).split(), np.float64).reshape(camera.height, camera.width)
    except ValueError as error:
        raise InputError(f"{file}: {error}, expected {camera.width}x{camera.height} numbers") from error
    x = (np.arange(camera.width) - camera.cx) / camera.fx
    y = (np.arange(camera.height)[:, None] - camera.cy) / camera.fy
    return (distance * metres / np.sqrt(x**2 + y**2 + 1)).astype(np.float32)


def _pov_pose(file: Path, metres: float) -> np.ndarray | None:
    """T_world_camera of POV-Ray's cam_pos, cam_dir and cam_up."""
    values = dict(re.findall(r"(cam_\w+)\s*=\s*\[([^\]]*)\]", read_text(file)))
    try:
        position, z, up = (
            np.array(re.split(r"[,\s]+", values[key].strip()), np.float64)
            for key in ("cam_pos", "cam_dir", "cam_up")
        )
    except (KeyError, ValueError):
        return None
    z = z / np.linalg.norm(z)
    x = np.cross(up, z)
    x = x / np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    T[:3, 3] = position * metres
    return _MIRROR @ T @ _MIRROR
