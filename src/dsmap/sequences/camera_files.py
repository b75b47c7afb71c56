"""The camera that one file states, however a program wrote it: JSON, YAML, XML, INI, arrays, matrices, numbers."""

import math
import re
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from dsmap.errors import InputError
from dsmap.lens import LENS_NAMES
from dsmap.plain import parse_json, parse_yaml
from dsmap.reading import DECODER_ERRORS
from dsmap.sequences.text import COMMENTS, read_text

_MAX_BYTES = 1 << 26
"""A larger file is no camera's."""
_MAX_ARRAY_BYTES = 1 << 20
_KEYS = (
    ("fx", "fy", "cx", "cy"), ("fl_x", "fl_y", "cx", "cy"), ("fx", "fy", "ppx", "ppy"),
    ("focal_x", "focal_y", "principal_x", "principal_y"), ("f_x", "f_y", "c_x", "c_y"),
    ("fx", "fy", "u0", "v0"), ("alpha_x", "alpha_y", "u0", "v0"),
)  # fmt: skip
_PAIRS = (
    ("focal_length", "principal_point"),
    ("focal", "principal_point"),
    ("f", "c"),
    ("focal_length", "center"),
)
"""Keys of [fx, fy] (or one number) and of [cx, cy]."""
_MATRICES = (
    "intrinsic_matrix", "camera_matrix", "cameramatrix", "k", "intrinsics", "intrinsic", "matrix", "cam_k", "mtx",
    "intrinsicmatrix", "color_intrinsics", "rgb_intrinsics", "kmat",
)  # fmt: skip
_SIZES = (
    ("width", "height"), ("w", "h"), ("image_width", "image_height"), ("img_width", "img_height"), ("cols", "rows"),
)  # fmt: skip
_SIZE_LISTS = ("resolution", "image_size", "size", "img_size")
_DISTORTION = ("k1", "k2", "p1", "p2", "k3")
_DISTORTIONS = (
    "distortion_coefficients", "distcoeffs", "dist_coeffs", "d", "coeffs", "distortion", "dist", "distortions",
)  # fmt: skip
_SCALES = (
    "depthmapfactor", "depth_map_factor", "png_depth_scale", "depth_scale", "depthscale", "depth_factor", "depthfactor",
    "integer_depth_scale", "depth_unit_scale_factor", "depth_units", "depth_unit", "scale",
)  # fmt: skip
_COLOUR_FIRST = (re.compile(r"colou?r|rgb"), re.compile(r"depth|infra|(^|_)ir($|_)|tof|imu"))
"""Names of parts of a file that are the colour camera's, and those of another camera."""
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_NAMED = re.compile(rf"(?<![\w.])([A-Za-z][\w.]*)[ \t]*(?:[:=,][ \t]*|[ \t]+)({_NUMBER})(?![\w.])")
_COLMAP = re.compile(
    rf"(?m)^\s*\d+\s+(SIMPLE_PINHOLE|PINHOLE|SIMPLE_RADIAL|RADIAL|OPENCV)\s+(\d+)\s+(\d+)((?:\s+{_NUMBER})+)\s*$"
)
_OST = re.compile(
    r"(?s)width\s+(\d+)\s+height\s+(\d+).*?camera matrix\s+((?:\S+\s+){9})distortion\s+((?:[-+.\deE]+[ \t]*)+)"
)
_LABEL = re.compile(r"^\s*([A-Za-z_]\w*)\s*[:=]\s*")
_DECIMAL_COMMA = re.compile(r"[-+]?\d+(?:,\d+)?(?:[eE][-+]?\d+)?")
_SAME_ASPECT = 0.01


_MODEL = ("distortion_model", "camera_model", "cam_model", "model")
"""Keys that name the model of a distortion."""


@dataclass(frozen=True)
class FileCamera:
    """What a file says, before it is held against the images."""

    values: tuple[float, float, float, float]
    """fx, fy, cx, cy [px]."""
    size: tuple[int, int] | None = None
    distortion: tuple[float, ...] = ()
    """In the order of `dsmap.lens.MODELS`; the last ones may be left out."""
    depth_scale: float | None = None
    """Stored units per metre."""
    model: str = "radtan"
    """Of the distortion."""


def camera_in(file: Path, size: tuple[int, int]) -> FileCamera | None:
    """The camera of a file, or None where it states none.

    Args:
        size: (width, height) of the images, which tells `fx fy cx cy width height` from `width height fx fy cx cy`.
    """
    suffix = file.suffix.lower()
    try:
        if not 0 < file.stat().st_size <= _MAX_BYTES:
            return None
        if suffix in (".npy", ".npz"):
            return _in_arrays(file)
        text = read_text(file)
    except (OSError, InputError):
        return None
    if text.lstrip()[:1] in ("{", "[") and (found := _in_json(text, file)) is not None:
        return found
    if suffix in (".yaml", ".yml") or text.startswith("%YAML"):
        return _in_yaml(text, file)
    if text.lstrip().startswith("<"):
        return _in_xml(text)
    return _in_text(text, size)


def _in_arrays(file: Path) -> FileCamera | None:
    """A matrix K of NumPy's .npy or .npz."""
    try:
        if zipfile.is_zipfile(file):
            with zipfile.ZipFile(file) as archive:
                if sum(member.file_size for member in archive.infolist()) > _MAX_ARRAY_BYTES:
                    return None
        elif file.stat().st_size > _MAX_ARRAY_BYTES:
            return None
        loaded = np.load(file, allow_pickle=False)
        arrays = (
            {"k": loaded} if isinstance(loaded, np.ndarray) else {name: loaded[name] for name in loaded.files}
        )
    except DECODER_ERRORS:
        return None
    return _in_content(
        {name: a.tolist() for name, a in arrays.items() if a.size <= 16 and a.dtype.kind in "iuf"}
    )


def _in_json(text: str, file: Path) -> FileCamera | None:
    try:
        return _in_content(parse_json(text, file), is_by_columns=True)
    except InputError:
        return None


def _in_yaml(text: str, file: Path) -> FileCamera | None:
    """ORB-SLAM's (`Camera.fx`), ROS's camera_info (of several messages the first) or OpenCV's."""
    text = re.sub(r"(?m)^%.*$", "", text).replace("\t", " ")
    text = re.sub(r"!!opencv[-.]matrix", "", text)
    for part in re.split(r"(?m)^---.*$", text):
        try:
            content = parse_yaml(part, file)
        except InputError:
            continue
        if isinstance(content, dict):
            # ORB-SLAM: Camera.fx, Camera1.fx, RGBD.DepthMapFactor
            plain = {re.sub(r"^(?:Camera1?|RGBD)\.", "", str(key)): value for key, value in content.items()}
            if (found := _in_content(plain)) is not None:
                return found
    return None


def _in_xml(text: str) -> FileCamera | None:
    """OpenCV's storage."""
    if "<!" in text:  # definitions of entities; a camera needs none
        return None
    try:
        root = ElementTree.fromstring(text.encode())
    except (ElementTree.ParseError, ValueError):
        return None

    def content(element: ElementTree.Element) -> Any:
        data = element.find("data")
        if data is not None:
            return (data.text or "").split()
        return (
            {child.tag: content(child) for child in element} if len(element) else (element.text or "").strip()
        )

    return _in_content(content(root))


def _in_text(text: str, size: tuple[int, int]) -> FileCamera | None:
    """COLMAP's cameras.txt, ROS's ost.txt, `fx = 525` in any order, or numbers alone."""
    if (match := _COLMAP.search(text)) is not None:
        return _of_colmap(match[1], (int(match[2]), int(match[3])), [float(v) for v in match[4].split()])
    if (match := _OST.search(text)) is not None:
        content = {"width": match[1], "height": match[2], "k": match[3].split(), "d": match[4].split()}
        return _in_content(content)
    lines = [line.strip() for line in text.splitlines()]
    lines = [line for line in lines if line and not line.startswith(COMMENTS)]
    named: dict[str, set[float]] = {}
    for key, value in _NAMED.findall("\n".join(lines)):
        named.setdefault(key.lower(), set()).add(float(value))
    # A key of several values belongs to several cameras: which one is not known.
    plain = {key: values.pop() for key, values in named.items() if len(values) == 1}
    return _in_content(plain) or _of_lines(lines, size)


def _of_lines(lines: list[str], size: tuple[int, int]) -> FileCamera | None:
    """Lines of numbers, also as Python prints arrays, with a heading, or led by a label (`K: 525 0 ...`)."""
    if not lines:
        return None
    rows = [_numbers(re.sub(r"array|[\[\]()]", " ", line)) for line in lines]
    if rows[0] is None and all(row is not None for row in rows[1:]) and len(rows) > 1:
        rows = rows[1:]  # a heading
    if all(row is not None for row in rows):
        return _of_numbers([v for row in rows for v in row or ()], size)
    labelled = [(m[1], _numbers(_LABEL.sub("", line))) for line in lines if (m := _LABEL.match(line))]
    cameras = [c for _, row in _by_camera(labelled) if row and (c := _of_numbers(row, size)) is not None]
    return cameras[0] if cameras else None


def _numbers(line: str) -> list[float] | None:
    """The numbers of a line; None where something else is in it. `525,5` is one number where blanks separate."""
    words = [word for word in re.split(r"[\s;]+", line) if word]
    if len(words) > 1 and all(_DECIMAL_COMMA.fullmatch(word) for word in words):
        words = [word.replace(",", ".") for word in words]
    try:
        return [float(word) for part in words for word in part.split(",") if word]
    except ValueError:
        return None


def _of_numbers(v: list[float], size: tuple[int, int]) -> FileCamera | None:
    """A matrix K, `fx fy cx cy [k1 k2 p1 p2 [k3]]`, and the same after or before `width height`."""
    if len(v) in (9, 12, 16) and v[1] == v[3 if len(v) == 9 else 4] == 0:
        fx, fy, cx, cy = (v[0], v[4], v[2], v[5]) if len(v) == 9 else (v[0], v[5], v[2], v[6])
        return _checked(fx, fy, cx, cy)
    if len(v) in (4, 8, 9):
        return _checked(*v[:4], distortion=tuple(v[4:]))
    if len(v) in (6, 10, 11):
        first, last = (v[0], v[1]), (v[4], v[5])
        if len(v) == 6 and _is_size(last, size) and not _is_size(first, size):
            return _checked(*v[:4], size=(int(v[4]), int(v[5])))
        if all(n == int(n) and n > 0 for n in first):
            return _checked(*v[2:6], size=(int(v[0]), int(v[1])), distortion=tuple(v[6:]))
    return None


def _is_size(v: tuple[float, float], size: tuple[int, int]) -> bool:
    whole = all(n == int(n) and n > 0 for n in v)
    return whole and abs(v[0] * size[1] / (v[1] * size[0]) - 1) <= _SAME_ASPECT


def _of_colmap(model: str, size: tuple[int, int], p: list[float]) -> FileCamera | None:
    """COLMAP's pixels have their centre at one half."""
    if len(p) < (4 if model in ("PINHOLE", "OPENCV") else 3):
        return None
    if model.startswith(("SIMPLE", "RADIAL")):
        values, distortion = (p[0], p[0], p[1], p[2]), (*p[3:5], 0.0, 0.0, 0.0)[:4]
        distortion = (distortion[0], distortion[1] if model == "RADIAL" else 0.0, 0.0, 0.0)
    else:
        values, distortion = (p[0], p[1], p[2], p[3]), tuple(p[4:12] if model == "FULL_OPENCV" else p[4:8])
    return _checked(
        values[0], values[1], values[2] - 0.5, values[3] - 0.5, size=size, distortion=distortion,
        model="fisheye" if "FISHEYE" in model else "radtan",
    )  # fmt: skip


def camera_of(content: dict[str, Any]) -> FileCamera | None:
    """The camera that a part of a JSON file states, or None."""
    return _in_content(content, is_by_columns=True)


def _in_content(content: Any, is_by_columns: bool = False, scale: float | None = None) -> FileCamera | None:
    """The first mapping in nested content that states a camera, the colour camera's before others."""
    if isinstance(content, list):
        if (K := _matrix(content, is_by_columns)) is not None and K.shape == np.shape(content):
            return _checked(K[0, 0], K[1, 1], K[0, 2], K[1, 2], scale=scale)
        return _first(content[:50], is_by_columns, scale)
    if not isinstance(content, dict):
        return None
    own = {str(key).lower(): value for key, value in content.items()}
    scale = _scale(own) or scale
    stated = next(_stated(own, is_by_columns), None)
    if stated is not None:
        model = next((str(own[k]) for k in _MODEL if str(own.get(k, "")).lower() in LENS_NAMES), "radtan")
        return _checked(*stated, size=_size(own), distortion=_distortion(own), scale=scale, model=model)
    return _first([value for _, value in _by_camera(own.items())], is_by_columns, scale)


def _stated(own: dict[str, Any], is_by_columns: bool) -> Iterator[tuple[float, float, float, float]]:
    """fx, fy, cx, cy of a mapping, in each spelling that it has."""
    for keys in _KEYS:
        values = [_number(own.get(key)) for key in keys]
        if None not in values:
            shift = 0.5 if keys[0] == "fl_x" else 0.0  # nerfstudio's pixels have their centre at one half
            fx, fy, cx, cy = (float(v) for v in values if v is not None)
            yield fx, fy, cx - shift, cy - shift
    for focal, centre in _PAIRS:
        f, c = (_number_list(own.get(key)) for key in (focal, centre))
        if f and c and len(f) <= 2 and len(c) == 2:
            yield f[0], f[-1], c[0], c[1]
    for key in _MATRICES:
        if (K := _matrix(own.get(key), is_by_columns)) is not None:
            yield float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])
        four = _number_list(own.get(key))
        if four and len(four) == 4:
            yield four[0], four[1], four[2], four[3]
    angle, size = _number(own.get("camera_angle_x")), _size(own)
    if angle and size and 0 < angle < math.pi:  # the field of view, as NeRF's programs write it
        fx = 0.5 * size[0] / math.tan(0.5 * angle)
        yield fx, fx, 0.5 * (size[0] - 1), 0.5 * (size[1] - 1)


def _by_camera(parts: Any) -> list[tuple[str, Any]]:
    """Named parts, the colour camera's first, those of other cameras last."""
    colour, other = _COLOUR_FIRST
    return sorted(
        ((str(name).lower(), value) for name, value in parts),
        key=lambda part: 0 if colour.search(part[0]) else 2 if other.search(part[0]) else 1,
    )


def _first(parts: list[Any], is_by_columns: bool, scale: float | None) -> FileCamera | None:
    return next((c for part in parts if (c := _in_content(part, is_by_columns, scale)) is not None), None)


def _size(own: dict[str, Any]) -> tuple[int, int] | None:
    for w, h in _SIZES:
        width, height = _number(own.get(w)), _number(own.get(h))
        if width and height:
            return int(width), int(height)
    for key in _SIZE_LISTS:
        values = _number_list(own.get(key))
        if values and len(values) == 2 and min(values) >= 1:
            return int(values[0]), int(values[1])
    return None


def _matrix(value: Any, is_by_columns: bool) -> np.ndarray | None:
    """K, (3, 3), of nine numbers, also with the rows and columns of a 3x4 or 4x4 matrix."""
    if isinstance(value, dict):
        value = value.get("data")
    try:
        K = np.array(value, np.float64)
    except (TypeError, ValueError):
        return None
    if K.size in (12, 16):
        K = K.reshape(-1, 4)[:3, :3]
    elif K.size != 9:
        return None
    by_columns = is_by_columns and K.ndim == 1 and not K[2] and not K[5]  # Open3D and Record3D list K so
    return K.reshape(3, 3).T if by_columns else K.reshape(3, 3)


def _distortion(own: dict[str, Any]) -> tuple[float, ...]:
    if any(_number(own.get(key)) is not None for key in _DISTORTION):
        return tuple(_number(own.get(key)) or 0.0 for key in _DISTORTION)
    for key in _DISTORTIONS:
        value = own.get(key)
        if isinstance(value, dict) and any(_number(value.get(k)) is not None for k in _DISTORTION):
            return tuple(_number(value.get(k)) or 0.0 for k in _DISTORTION)
        found = _number_list(value.get("data") if isinstance(value, dict) else value)
        if found and 4 <= len(found) <= 14:
            return tuple(found)
    return ()


def _scale(own: dict[str, Any]) -> float | None:
    """Units per metre; a number below one is metres per unit."""
    for key in _SCALES:
        number = _number(own.get(key)) or 0.0
        if number <= 0 or (key == "scale" and 0.02 < number < 100):  # anything may have a scale
            continue
        return number if number >= 1 else round(1 / number, 6)
    return None


def _number(value: Any) -> float | None:
    """A finite number, also written as text."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def _number_list(value: Any) -> list[float] | None:
    items = value if isinstance(value, list) else [value]
    while len(items) == 1 and isinstance(items[0], list):
        items = items[0]
    found = [_number(item) for item in items]
    return None if not found or None in found else [float(v) for v in found]  # type: ignore[arg-type]


def _checked(
    fx: float, fy: float, cx: float, cy: float, *, size: tuple[int, int] | None = None,
    distortion: tuple[float, ...] = (), scale: float | None = None, model: str = "radtan",
) -> FileCamera | None:  # fmt: skip
    if not (np.isfinite([fx, fy, cx, cy]).all() and fx > 1 and abs(fy) > 1 and cx > 0 and cy > 0):
        return None
    values = (float(fx), abs(float(fy)), float(cx), float(cy))
    return FileCamera(values, size, distortion if any(distortion) else (), scale, model)
