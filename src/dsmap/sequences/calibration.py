"""Intrinsics and depth scale of a recording: from flags, `calibration.yaml` or known defaults."""

import os
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dsmap.errors import InputError
from dsmap.files import write_yaml
from dsmap.frame import Intrinsics
from dsmap.lens import LENS_NAMES, MODELS, coefficients, model_named, model_of
from dsmap.plain import brief, read_yaml
from dsmap.sequences.calibration_checks import check_camera, check_depth_scale, check_extras, check_keys

CALIBRATION_FILE = "calibration.yaml"
_CAMERA_KEYS = ("width", "height", "fx", "fy", "cx", "cy")
_KEYS = (
    *_CAMERA_KEYS, "pixel_center", "depth_scale", "distortion", "depth_time_offset_s", "readout_s",
    "T_color_depth", "color_camera", "depth_max",
    "uncertainty", "undetermined",
)  # fmt: skip

_KINECT_READOUT_S = 0.026
"""From the first row of a Kinect's image to its last. On fr1/xyz 20 and 26 ms fit best, and a 7-Scenes recording
agrees (docs/method/rolling_shutter.md)."""
_TUM = {
    "1": ((517.3, 516.5, 318.6, 255.3), (0.2624, -0.9531, -0.0054, 0.0026, 1.1633), -0.02, _KINECT_READOUT_S),
    "2": ((520.9, 521.0, 325.1, 249.7), (0.2312, -0.7849, -0.0033, -0.0001, 0.9172), 0.0, _KINECT_READOUT_S),
    "3": ((535.4, 539.2, 320.1, 247.6), None, 0.0, 0.0),
}
"""fx, fy, cx, cy and radtan k1 k2 p1 p2 k3 of the colour cameras, as TUM publishes them; offset of depth stamps [s];
time from an image's first row to its last [s]. Depth of fr1 is stamped some 20 ms too late: paired by plain stamps
colours lie 3 pixels beside their depth where the camera turns (docs/log/fr1_time_offset.md). Of fr2 and fr3 nothing is
known; fr2 is a Kinect, too, fr3 a Xtion."""
_SEVEN_SCENES_FOCAL = 526.4
"""Of the colour camera at 640x480 [px]. This and the rotation below were fitted on every 25th frame of one recording
(edges of depth against edges of colour; two disjoint sets of frames agree to 0.1 % and 0.5 mrad)."""
_SEVEN_SCENES_T_COLOR_DEPTH = np.array(
    [
        [0.999959, -0.009002, -0.000883, -0.0256],
        [0.008998, 0.999952, -0.003804, 0.0],
        [0.000917, 0.003796, 0.999992, 0.0],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
_TUM_NAME = re.compile(r"(?:fr|freiburg)([123])(?![0-9])", re.IGNORECASE)


@dataclass(frozen=True)
class Calibration:
    """The camera of a recording at the size of its images."""

    intrinsics: Intrinsics
    depth_scale: float
    """Stored depth units per metre."""
    source: str
    """Where it came from, for people."""
    pixel_center: str = "integer"
    """What the file said; `intrinsics` are always converted to integer pixel centres."""
    depth_time_offset_s: float = 0.0
    """Added to the depth stamps before pairing [s]."""
    T_color_depth: np.ndarray | None = None
    """Takes points of the depth camera into the colour camera, shape (4, 4); None: already registered."""
    color_camera: Intrinsics | None = None
    """Of colour images from a camera of its own: they are brought to the depth camera, whose `intrinsics` and
    poses are then the frame's. None: one camera, or depth is brought to the colour camera."""
    readout_s: float = 0.0
    """Rolling shutter: time from an image's first row to its last [s]; 0: all rows at once, negative: from below."""
    depth_max: float | None = None
    """Depth beyond which the sensor is not to be trusted [m]; None: not stated."""
    uncertainty: dict[str, float] | None = None
    """Standard deviations by name, as `dsmap calibrate` writes them; nothing computes with them."""
    undetermined: tuple[str, ...] = ()
    """Numbers that `dsmap calibrate` could not determine, by name."""

    @property
    def stored_colour(self) -> Intrinsics:
        """The camera of the colour images as they are stored."""
        return self.color_camera or self.intrinsics

    @property
    def T_color_frame(self) -> np.ndarray:
        """Takes points of the camera whose poses the frames carry into the colour camera, shape (4, 4)."""
        if self.color_camera is None or self.T_color_depth is None:
            return np.eye(4)  # one camera, or depth is brought to the colour camera
        return self.T_color_depth


def read_calibration(folder: Path) -> Calibration | None:
    """`calibration.yaml` of a recording, or None if there is none.

    Raises:
        InputError: the file is damaged, a key is unknown, or a value is missing, not a number or out of range.
    """
    path = folder / CALIBRATION_FILE
    if not os.path.lexists(path):
        return None
    content = read_yaml(path)
    check_keys(path, content, _KEYS)
    center = content.get("pixel_center", "integer")
    if not isinstance(center, str) or center not in ("integer", "half"):
        raise InputError(f"{path}: found pixel_center {brief(center)}, expected integer or half")
    shift = 0.5 if center == "half" else 0.0
    calibration = Calibration(
        replace(_camera(path, content, shift), distortion=_distortion(path, content.get("distortion"))),
        depth_scale=_number(path, content, "depth_scale", positive=True),
        source=CALIBRATION_FILE,
        pixel_center=center,
        depth_time_offset_s=_number(path, content, "depth_time_offset_s", default=0.0),
        T_color_depth=_transform(path, content.get("T_color_depth")),
        color_camera=_color_camera(path, content.get("color_camera"), shift),
        readout_s=_number(path, content, "readout_s", default=0.0),
        depth_max=_number(path, content, "depth_max", positive=True) if "depth_max" in content else None,
        uncertainty=_uncertainty(path, content.get("uncertainty")),
        undetermined=_names(path, content.get("undetermined", [])),
    )
    check_calibration(path, calibration)
    return calibration


def check_calibration(where: Any, calibration: Calibration) -> None:
    """Refuse a camera that there cannot be, whatever file it came from. Raises InputError."""
    check_camera(where, calibration.intrinsics)
    if calibration.color_camera is not None:
        check_camera(f"{where}, color_camera", calibration.color_camera)
    check_depth_scale(where, calibration.depth_scale)
    check_extras(
        where, calibration.depth_time_offset_s, calibration.readout_s, calibration.depth_max, calibration.T_color_depth
    )  # fmt: skip


def write_calibration(folder: Path, calibration: Calibration) -> None:
    """Write `calibration.yaml` (integer pixel centres) into a folder."""
    write_calibration_file(folder / CALIBRATION_FILE, calibration)


def write_calibration_file(path: Path, calibration: Calibration) -> None:
    """Write what `read_calibration` reads, under any name."""
    camera = calibration.intrinsics
    content: dict[str, Any] = {
        "width": camera.width,
        "height": camera.height,
        **{key: float(getattr(camera, key)) for key in ("fx", "fy", "cx", "cy")},
        "pixel_center": "integer",
        "depth_scale": float(calibration.depth_scale),
    }
    if camera.distortion is not None:
        values = [float(v) for v in camera.distortion]
        model = model_of(camera.distortion)
        content["distortion"] = {"model": model, **dict(zip(MODELS[model], values, strict=True))}
    if calibration.depth_time_offset_s:
        content["depth_time_offset_s"] = float(calibration.depth_time_offset_s)
    if calibration.readout_s:
        content["readout_s"] = float(calibration.readout_s)
    if calibration.T_color_depth is not None:
        content["T_color_depth"] = [[float(v) for v in row] for row in calibration.T_color_depth]
    if (other := calibration.color_camera) is not None:
        content["color_camera"] = {
            **{key: int(getattr(other, key)) for key in ("width", "height")},
            **{key: float(getattr(other, key)) for key in ("fx", "fy", "cx", "cy")},
        }
    if calibration.depth_max is not None:
        content["depth_max"] = float(calibration.depth_max)
    if calibration.uncertainty is not None:
        content["uncertainty"] = {name: float(value) for name, value in calibration.uncertainty.items()}
        content["undetermined"] = list(calibration.undetermined)
    write_yaml(path, content)


def known_default(layout: str, path: Path, width: int, height: int) -> Calibration | None:
    """Published calibration of a public data set at the size of its images, or None."""
    if layout == "7-scenes":
        s = width / 640  # 585 px and the image's centre at 640x480
        camera = Intrinsics(width, height, 585.0 * s, 585.0 * s, 320.0 * s, 320.0 * s * height / width)
        color = replace(camera, fx=_SEVEN_SCENES_FOCAL * s, fy=_SEVEN_SCENES_FOCAL * s)
        T = _SEVEN_SCENES_T_COLOR_DEPTH
        return Calibration(
            camera, 1000.0, "known default of 7-Scenes", T_color_depth=T, color_camera=color,
            readout_s=_KINECT_READOUT_S,
        )  # fmt: skip
    if layout == "redwood":
        camera = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5).scaled(width, height)
        return Calibration(camera, 1000.0, "known default of Redwood")
    match = _TUM_NAME.search(path.resolve().name)
    if match is None:
        return None
    values, distortion, offset, readout = _TUM[match[1]]
    camera = Intrinsics(640, 480, *values, distortion=distortion).scaled(width, height)
    source = f"known default of TUM fr{match[1]}"
    return Calibration(camera, 5000.0, source, depth_time_offset_s=offset, readout_s=readout)


def resolve(
    layout: str,
    path: Path,
    image_size: tuple[int, int],
    stored: Calibration | None,
    intrinsics: tuple[float, float, float, float] | None,
    depth_scale: float | None,
) -> Calibration:
    """The calibration that holds: flags before `calibration.yaml` before known defaults.

    Args:
        image_size: (width, height) of the recording's images.
        stored: what `calibration.yaml` says.
        intrinsics: fx, fy, cx, cy of the recording's images from flags [px].
        depth_scale: stored units per metre from flags.

    Raises:
        InputError: something is missing or not positive.
    """
    base = stored or known_default(layout, path, *image_size)
    if base is None and (intrinsics is None or depth_scale is None):
        missing = [
            flag
            for flag, value in (("--intrinsics fx,fy,cx,cy", intrinsics), ("--depth-scale", depth_scale))
            if value is None
        ]
        file = (path if path.is_dir() else path.parent) / CALIBRATION_FILE
        raise InputError(
            f"{path}: no camera calibration; write {file} (width, height, fx, fy, cx, cy, "
            f"depth_scale) or give {' and '.join(missing)}"
        )
    if base is None:
        base = Calibration(Intrinsics(*image_size, 1.0, 1.0, 0.0, 0.0), 1.0, "")
    sources = {"intrinsics": base.source, "depth scale": base.source}
    if intrinsics is not None:
        fx, fy, cx, cy = (float(v) for v in intrinsics)
        if not (np.isfinite([fx, fy, cx, cy]).all() and fx > 0 and fy > 0):
            raise InputError(
                f"--intrinsics: found {intrinsics}, expected fx,fy,cx,cy in pixels with fx and fy > 0"
            )
        camera = replace(
            base.intrinsics, width=image_size[0], height=image_size[1], fx=fx, fy=fy, cx=cx, cy=cy
        )
        check_camera("--intrinsics", camera)
        base = replace(base, intrinsics=camera)
        sources["intrinsics"] = "--intrinsics"
    if depth_scale is not None:
        if not (np.isfinite(depth_scale) and depth_scale > 0):
            raise InputError(f"--depth-scale: found {depth_scale}, expected stored units per metre, above 0")
        check_depth_scale("--depth-scale", depth_scale)
        base = replace(base, depth_scale=float(depth_scale))
        sources["depth scale"] = "--depth-scale"
    if len(set(sources.values())) == 1:
        return replace(base, source=sources["intrinsics"])
    return replace(base, source=", ".join(f"{what}: {source}" for what, source in sources.items()))


def _number(
    path: Path, content: dict, key: str, *, positive: bool = False, default: float | None = None
) -> float:
    value = content.get(key, default)
    valid = isinstance(value, int | float) and not isinstance(value, bool) and np.isfinite(value)
    if not valid or (positive and value <= 0):
        found = "nothing" if value is None else brief(value)
        raise InputError(
            f"{path}: found {found} for {key}, expected a {'positive ' if positive else ''}number"
        )
    return float(value)


def _distortion(path: Path, content: Any) -> tuple[float, ...] | None:
    if content is None:
        return None
    name = content.get("model", "radtan") if isinstance(content, dict) else None
    if not isinstance(name, str) or name.lower() not in LENS_NAMES:
        raise InputError(
            f"{path}: found distortion {brief(content)}, expected {{model: radtan, k1, k2, p1, p2, k3}} or another "
            f"model: {', '.join(MODELS)}, pinhole"
        )
    if (model := model_named(name)) is None:
        return None
    check_keys(f"{path}, distortion", content, ("model", *MODELS[model]))
    return coefficients(model, [_number(path, content, key, default=0.0) for key in MODELS[model]])


def _color_camera(path: Path, content: Any, shift: float) -> Intrinsics | None:
    if content is None:
        return None
    if not isinstance(content, dict):
        raise InputError(
            f"{path}: found color_camera {brief(content)}, expected width, height, fx, fy, cx, cy"
        )
    check_keys(f"{path}, color_camera", content, _CAMERA_KEYS)
    return _camera(path, content, shift)


def _camera(path: Path, content: dict, shift: float) -> Intrinsics:
    width, height = (_whole(path, content, key) for key in ("width", "height"))
    fx, fy = (_number(path, content, key, positive=True) for key in ("fx", "fy"))
    cx, cy = (_number(path, content, key) - shift for key in ("cx", "cy"))
    return Intrinsics(width, height, fx, fy, cx, cy)


def _whole(path: Path, content: dict, key: str) -> int:
    value = _number(path, content, key, positive=True)
    if value != int(value):
        raise InputError(f"{path}: found {value:g} for {key}, expected a whole number of pixels")
    return int(value)


def _uncertainty(path: Path, content: Any) -> dict[str, float] | None:
    if content is None:
        return None
    if not isinstance(content, dict) or not all(isinstance(name, str) for name in content):
        raise InputError(
            f"{path}: found uncertainty {brief(content)}, expected names and standard deviations"
        )
    return {name: _number(path, content, name) for name in content}


def _names(path: Path, content: Any) -> tuple[str, ...]:
    if not isinstance(content, list) or not all(isinstance(name, str) for name in content):
        raise InputError(f"{path}: found undetermined {brief(content)}, expected a list of names")
    return tuple(content)


def _transform(path: Path, content: Any) -> np.ndarray | None:
    if content is None:
        return None
    try:
        T = np.array(content, dtype=np.float64).reshape(4, 4)
    except (TypeError, ValueError):
        T = np.zeros((4, 4))
    rotates = np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-3) and np.linalg.det(T[:3, :3]) > 0
    if not rotates or not np.allclose(T[3], (0, 0, 0, 1)):
        raise InputError(f"{path}: found T_color_depth {brief(content)}, expected a rigid 4x4 transform")
    return None if np.allclose(T, np.eye(4)) else T
