"""`transforms.json` with depth (nerfstudio, Polycam, Spectacular AI): frames of file_path, depth_file_path, pose."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.lens import MODELS, coefficients
from dsmap.plain import parse_json
from dsmap.sequences.base import Recording
from dsmap.sequences.calibration import Calibration
from dsmap.sequences.formats.parts import OPENGL_AXES, recording_by_number, same_size, two_cameras
from dsmap.sequences.formats.protocol import Options, Reader
from dsmap.sequences.images import image_size
from dsmap.sequences.text import read_text

_FILE = "transforms.json"
_METRES_PER_UNIT = 0.001
"""nerfstudio's depth_unit_scale_factor."""
_CENTRE = 0.5
"""Where nerfstudio's cx and cy have the centre of the first pixel (its `pixel_offset`); ours is at 0."""


def _detect(path: Path) -> bool:
    file = path / _FILE
    if not file.is_file():
        return False
    with file.open("rb") as opened:
        return b"depth_file_path" in opened.read()


def _read(path: Path, _options: Options) -> Recording:
    try:
        content = parse_json(read_text(path / _FILE), path / _FILE)
        frames = [frame for frame in content["frames"] if frame.get("depth_file_path")]
        matrices = [np.array(frame["transform_matrix"], np.float64).reshape(-1, 4) for frame in frames]
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f"{path / _FILE}: {error!r}, expected frames with file_path and transform_matrix"
        ) from error
    order = sorted(range(len(frames)), key=lambda i: _natural(str(frames[i].get("file_path", ""))))
    colour, depth, poses, times = {}, {}, {}, {}
    for k, i in enumerate(order):
        frame = frames[i]
        colour[k], depth[k] = _file(path, frame, "file_path"), _file(path, frame, "depth_file_path")
        poses[k] = np.vstack([matrices[i][:3], (0, 0, 0, 1)]) @ OPENGL_AXES
        if "timestamp" in frame:
            times[k] = float(frame["timestamp"])
    notes: list[str] = []
    return recording_by_number(
        "transforms.json", path, colour, depth, _calibration(path, content, frames, colour, depth, notes),
        expected="frames with file_path and depth_file_path", times=times if len(times) == len(colour) else None,
        poses=poses, notes=notes,
    )  # fmt: skip


READER = Reader("transforms.json", _detect, _read)


def _natural(name: str) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]


def _file(path: Path, frame: dict[str, Any], key: str) -> Path:
    name = str(frame.get(key, "")).replace("\\", "/")
    if (path / name).suffix == "" and not (path / name).exists():  # older files leave the suffix out
        name = next((name + s for s in (".png", ".jpg", ".jpeg") if (path / (name + s)).exists()), name)
    return path / name


def _calibration(
    path: Path,
    content: dict,
    frames: list[dict],
    colour: dict[int, Path],
    depth: dict[int, Path],
    notes: list[str],
) -> Calibration | None:
    if not colour:
        return None
    keys = ("fl_x", "fl_y", "cx", "cy")
    tables = [[float(frame.get(key, content.get(key, np.nan))) for key in keys] for frame in frames]
    values = np.median(np.array(tables), axis=0)
    if np.isnan(values[0]) and "camera_angle_x" in content:
        raise InputError(f"{path / _FILE}: found camera_angle_x but no fl_x, expected fl_x, fl_y, cx, cy")
    values[2:] -= _CENTRE
    size, depth_size = image_size(next(iter(colour.values()))), image_size(next(iter(depth.values())))
    if not np.isfinite(values).all() or size is None or depth_size is None:
        return None
    if np.ptp(np.array(tables)[:, 0]) > 0.002 * values[0]:
        notes.append("the focal length changes from frame to frame: its median is taken")
    stated = (
        int(content.get("w", frames[0].get("w", size[0]))),
        int(content.get("h", frames[0].get("h", size[1]))),
    )
    model = "fisheye" if "FISHEYE" in str(content.get("camera_model", "")).upper() else "rational"
    found = coefficients(model, [float(content.get(key, 0.0)) for key in MODELS[model]])
    if model == "rational" and found is not None:
        found = coefficients("radtan", found)
    fx, fy, cx, cy = (float(v) for v in values)
    camera = Intrinsics(*stated, fx, fy, cx, cy, found)
    if stated != size:
        camera = camera.scaled(*size)
        notes.append(
            f"{_FILE} speaks of {stated[0]}x{stated[1]}, the images have {size[0]}x{size[1]}: scaled"
        )
    scale = 1.0 / float(content.get("depth_unit_scale_factor", _METRES_PER_UNIT))
    if "integer_depth_scale" in content:
        scale = 1.0 / float(content["integer_depth_scale"])
    frame_camera = camera if depth_size == size else camera.scaled(*depth_size)
    if same_size(camera, frame_camera):
        return Calibration(camera, round(scale, 6), _FILE)
    return two_cameras(camera, frame_camera, np.eye(4), round(scale, 6), _FILE)
