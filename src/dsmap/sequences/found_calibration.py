"""The camera of a recording in the files that recorders leave beside the images.

Read are Open3D's `camera_intrinsic.json` and other JSON, ETH3D's `calibration.txt`, `intrinsics.txt` and other
matrices, `intrinsic/*.txt`, `info.txt`, ORB-SLAM's and ROS's YAML, `transforms.json`.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.plain import parse_json, parse_yaml
from dsmap.sequences.calibration import FILE, Calibration
from dsmap.sequences.formats.bundlefusion import read_info
from dsmap.sequences.formats.parts import two_cameras
from dsmap.sequences.text import numbers_of, read_text

_SCALES = {"tum": 5000.0}
"""Units per metre that are usual in a layout; 1000 in the others."""
_JSON = ("camera_intrinsic.json", "camera_intrinsics.json", "intrinsic.json", "intrinsics.json", "camera.json",
         "calibration.json", "transforms.json", "cam_params.json", "camera_info.json", "config.json")  # fmt: skip
_TEXT = ("calibration.txt", "intrinsics.txt", "intrinsic.txt", "camera-intrinsics.txt", "camera_intrinsics.txt",
         "camera_matrix.txt", "camera_matrix.csv", "camera.txt", "calib.txt", "K.txt", "cam_K.txt",
         "intrinsics_color.txt", "intrinsic_color.txt", "intrinsics_depth.txt")  # fmt: skip
_INFO = ("info.txt", "_info.txt")
_FOLDERS = ("intrinsic", "intrinsics")
_KEYS = (
    ("fx", "fy", "cx", "cy"), ("fl_x", "fl_y", "cx", "cy"), ("fx", "fy", "ppx", "ppy"),
    ("focal_x", "focal_y", "principal_x", "principal_y"), ("f_x", "f_y", "c_x", "c_y"),
)  # fmt: skip
_MATRICES = ("intrinsic_matrix", "camera_matrix", "K", "k", "intrinsics", "intrinsic")
_DISTORTION = ("k1", "k2", "p1", "p2", "k3")
_SCALE_KEYS = (
    "DepthMapFactor", "depth_scale", "depth_factor", "integer_depth_scale", "depth_unit_scale_factor", "scale",
)  # fmt: skip
_SAME_ASPECT = 0.01


@dataclass(frozen=True)
class _Camera:
    """What a file says, before it is held against the images."""

    values: tuple[float, float, float, float]
    """fx, fy, cx, cy [px]."""
    size: tuple[int, int] | None = None
    distortion: tuple[float, ...] = ()
    """k1 k2 p1 p2 [k3]."""
    depth_scale: float | None = None


def find_calibration(
    folder: Path, layout: str, size: tuple[int, int], depth_size: tuple[int, int] | None, notes: list[str]
) -> Calibration | None:
    """The camera that a file beside the images states, or None where there is no such file.

    Args:
        size, depth_size: (width, height) of the colour and the depth images.

    Raises:
        InputError: a file states a camera of another shape than the images.
    """
    if not folder.is_dir():
        return None
    for name in _INFO:
        if (folder / name).is_file() and "m_calibration" in read_text(folder / name):
            return read_info(folder / name)
    for file in _candidates(folder):
        found = _camera(file)
        if found is None:
            continue
        source = str(file.relative_to(folder))
        camera = _at_size(folder / source, found, size, notes)
        scale = found.depth_scale
        if scale is None:
            scale = _SCALES.get(layout, 1000.0)
            notes.append(
                f"assumed: {scale:g} depth units per metre; {source} does not say, --depth-scale does"
            )
        return _with_depth(folder, camera, size, depth_size, scale, source)
    return None


def _with_depth(
    folder: Path,
    camera: Intrinsics,
    size: tuple[int, int],
    depth_size: tuple[int, int] | None,
    scale: float,
    source: str,
) -> Calibration:
    """Depth of another size has its own file, or sees what colour sees."""
    if depth_size is None or depth_size == size:
        return Calibration(camera, scale, source)
    own = next((f for f in _depth_files(folder) if f.is_file()), None)
    found = _camera(own) if own else None
    if found is not None:
        return two_cameras(camera, _plain(found, depth_size), np.eye(4), scale, source)
    if abs(depth_size[0] * size[1] / (depth_size[1] * size[0]) - 1) > _SAME_ASPECT:
        return Calibration(camera, scale, source)
    return two_cameras(camera, replace(camera, distortion=None).scaled(*depth_size), np.eye(4), scale, source)


def _depth_files(folder: Path) -> list[Path]:
    places = (folder, *(folder / name for name in _FOLDERS))
    return [place / name for place in places for name in ("intrinsic_depth.txt", "intrinsics_depth.txt")]


def _candidates(folder: Path) -> Iterator[Path]:
    for name in (*_JSON, *_TEXT):
        if (folder / name).is_file():
            yield folder / name
    for name in _FOLDERS:
        if (folder / name).is_dir():
            yield from sorted((folder / name).glob("*.txt"), key=lambda f: ("color" not in f.name, f.name))
    for pattern in ("*.yaml", "*.yml"):
        yield from (f for f in sorted(folder.glob(pattern)) if f.name != FILE)


def _camera(file: Path) -> _Camera | None:
    """The camera of a file, or None where it states none."""
    suffix = file.suffix.lower()
    if suffix == ".json":
        try:
            return _in_content(parse_json(read_text(file), file), is_by_columns=True)
        except (ValueError, InputError):
            return None
    if suffix in (".yaml", ".yml"):
        return _in_yaml(file)
    return _in_numbers(file)


def _in_numbers(file: Path) -> _Camera | None:
    """fx fy cx cy [k1 k2 p1 p2 [k3]], `width height fx fy cx cy`, a matrix K, or lines of `fx = 525`."""
    numbers = numbers_of(file)
    if numbers is None:
        try:
            pairs = dict(re.findall(r"(?m)^\s*([A-Za-z]\w*)\s*[:=]\s*([-+0-9.eE]+)\s*$", read_text(file)))
            return _in_content({key.lower(): float(value) for key, value in pairs.items()})
        except (ValueError, InputError):
            return None
    v = [float(n) for n in numbers]
    if len(v) in (9, 12, 16) and v[1] == v[3 if len(v) == 9 else 4] == 0:
        fx, fy, cx, cy = (v[0], v[4], v[2], v[5]) if len(v) == 9 else (v[0], v[5], v[2], v[6])
        return _checked(fx, fy, cx, cy)
    if len(v) in (4, 8, 9):
        return _checked(*v[:4], distortion=tuple(v[4:]))
    if len(v) == 6 and v[0] == int(v[0]) and v[1] == int(v[1]):
        return _checked(*v[2:], size=(int(v[0]), int(v[1])))
    return None


def _in_yaml(file: Path) -> _Camera | None:
    """ORB-SLAM's (`Camera.fx`), ROS's camera_info or OpenCV's."""
    try:
        text = read_text(file)
    except InputError:
        return None
    lines = [
        line for line in text.replace("!!opencv-matrix", "").splitlines() if not line.startswith(("%", "---"))
    ]
    try:
        content = parse_yaml("\n".join(lines), file)
    except InputError:
        return None
    if not isinstance(content, dict):
        return None
    orb = {re.sub(r"^(?:Camera1?|RGBD)\.", "", str(key)): value for key, value in content.items()}
    return _in_content(orb if orb.keys() != content.keys() else content)


def _in_content(content: Any, is_by_columns: bool = False) -> _Camera | None:
    """The first mapping in nested content that states a camera."""
    if isinstance(content, list):
        return next((c for item in content[:50] if (c := _in_content(item, is_by_columns)) is not None), None)
    if not isinstance(content, dict):
        return None
    size = next(
        (
            (int(content[w]), int(content[h]))
            for w, h in (("width", "height"), ("w", "h"), ("image_width", "image_height"))
            if _is_number(content.get(w)) and _is_number(content.get(h))
        ),
        None,
    )
    scale = _scale(content)
    for keys in _KEYS:
        if all(_is_number(content.get(key)) for key in keys):
            return _checked(
                *(float(content[k]) for k in keys), size=size, distortion=_distortion(content), scale=scale
            )
    for key in _MATRICES:
        if (K := _matrix(content.get(key), is_by_columns)) is not None:
            return _checked(
                K[0, 0], K[1, 1], K[0, 2], K[1, 2], size=size, distortion=_distortion(content), scale=scale
            )
    return next((c for v in content.values() if (c := _in_content(v, is_by_columns)) is not None), None)


def _matrix(value: Any, is_by_columns: bool) -> np.ndarray | None:
    if isinstance(value, dict):
        value = value.get("data")
    try:
        K = np.array(value, np.float64)
    except (TypeError, ValueError):
        return None
    if K.size != 9:
        return None
    by_columns = is_by_columns and K.ndim == 1 and not K[2] and not K[5]  # Open3D and Record3D list K so
    return K.reshape(3, 3).T if by_columns else K.reshape(3, 3)


def _distortion(content: dict) -> tuple[float, ...]:
    if any(_is_number(content.get(key)) for key in _DISTORTION):
        return tuple(float(content.get(key, 0.0)) for key in _DISTORTION)
    for key in ("distortion_coefficients", "D", "d", "coeffs", "dist_coeffs", "distortion"):
        value = content.get(key)
        value = value.get("data") if isinstance(value, dict) else value
        if isinstance(value, list) and 4 <= len(value) <= 5 and all(map(_is_number, value)):
            return tuple(float(v) for v in value)
    return ()


def _scale(content: dict) -> float | None:
    """Units per metre; a number below one is metres per unit."""
    for key in (
        "DepthMapFactor",
        "depth_scale",
        "depth_factor",
        "integer_depth_scale",
        "depth_unit_scale_factor",
        "scale",
    ):
        value = content.get(key)
        number = float(value) if _is_number(value) else 0.0  # type: ignore[arg-type]
        if number > 0:
            return number if number >= 1 else round(1 / number, 6)
    return None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def _checked(
    fx: float, fy: float, cx: float, cy: float, *, size: tuple[int, int] | None = None,
    distortion: tuple[float, ...] = (), scale: float | None = None,
) -> _Camera | None:  # fmt: skip
    if not (np.isfinite([fx, fy, cx, cy]).all() and fx > 1 and abs(fy) > 1 and cx > 0 and cy > 0):
        return None
    values = (float(fx), abs(float(fy)), float(cx), float(cy))
    return _Camera(values, size, distortion if any(distortion) else (), scale)


def _plain(found: _Camera, size: tuple[int, int]) -> Intrinsics:
    if not found.distortion:
        return Intrinsics(*size, *found.values)
    k1, k2, p1, p2, k3 = (*found.distortion, 0.0)[:5]
    return Intrinsics(*size, *found.values, (k1, k2, p1, p2, k3))


def _at_size(file: Path, found: _Camera, size: tuple[int, int], notes: list[str]) -> Intrinsics:
    """The camera at the size of the images. Raises InputError where it cannot be theirs."""
    if found.size is not None and found.size != size:
        (w, h), (width, height) = found.size, size
        if abs(w * height / (h * width) - 1) > _SAME_ASPECT:
            raise InputError(
                f"{file}: found a camera of {w}x{h}, expected {width}x{height} as the images have"
            )
        notes.append(f"{file.name} speaks of {w}x{h}, the images have {width}x{height}: scaled")
        return _plain(found, found.size).scaled(*size)
    camera = _plain(found, size)
    if not (0.25 < camera.cx / camera.width < 0.75 and 0.25 < camera.cy / camera.height < 0.75):
        raise InputError(
            f"{file}: found cx {camera.cx:g} and cy {camera.cy:g}, expected values near the middle of the images, "
            f"which have {size[0]}x{size[1]}"
        )
    return camera


def check_assumed(layout: str, folder: Path, size: tuple[int, int], notes: list[str]) -> None:
    """Say which camera is taken where nothing states one.

    Raises:
        InputError: the images' shape says that it is another one.
    """
    names = {
        "redwood": "PrimeSense's camera (fx = fy = 525 at 640x480)",
        "7-scenes": "the Kinect of 7-Scenes",
    }
    if layout not in (*names, "tum"):
        return
    width, height = size
    if abs(width * 3 / (height * 4) - 1) > _SAME_ASPECT:
        if layout == "tum":
            return
        raise InputError(
            f"{folder}: found images of {width}x{height} and no file that states their camera, which is not "
            f"{names[layout]}; write {folder / FILE} (width, height, fx, fy, cx, cy, depth_scale) or give "
            "--intrinsics fx,fy,cx,cy and --depth-scale"
        )
    if layout in names:
        notes.append(f"assumed: {names[layout]}; no file states another, --intrinsics fx,fy,cx,cy does")
