"""What a camera can be: misspelled keys and values of another unit or order are refused, not mapped with."""

import difflib
from collections.abc import Iterable
from typing import Any

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.lens import MODELS, model_of

_MAX_PIXELS = 20_000
_FOCAL_BY_WIDTH = (0.15, 8.0)
"""A fisheye's field of view of 147 degrees, a telephoto lens of 7."""
_SQUEEZE = 1.5
"""No camera's pixels, nor an image squeezed from 16:9 to 4:3, differ more in width and height."""
_SUSPICIOUS_SQUEEZE, _SUSPICIOUS_SHIFT = 1.2, 0.25
"""Together they mean another order of the four numbers: fx / fy, and the principal point off the centre [widths]."""
_NOT_SQUARE, _CENTRED = 0.2, 0.06
"""Principal points this near the other side's centre [its length] are exchanged, unless the image is nearly square."""
_MAX_DISTORTION = {
    "k1": 50.0, "k2": 500.0, "p1": 0.5, "p2": 0.5, "k3": 500.0, "k4": 500.0, "k5": 500.0, "k6": 500.0,
}  # fmt: skip
_MAX_BASELINE_M = 1.0
_MAX_TIME_OFFSET_S = 1.0
_MAX_READOUT_S = 0.1
"""Nobody reads an image for longer than three frames."""
_DEPTH_SCALE = (0.5, 1e6)
"""From metres as floats to micrometres."""
_DEPTH_MAX_M = (0.1, 500.0)


def check_keys(where: Any, found: Iterable[Any], known: tuple[str, ...]) -> None:
    """Refuse a key that nobody would read.

    Raises:
        InputError: names the key, and the nearest known one.
    """
    for key in found:
        if key in known:
            continue
        lower = {name.lower(): name for name in known}
        near = difflib.get_close_matches(str(key).lower(), lower, 1, 0.5)
        meant = f"{lower[near[0]]} (or another of {', '.join(known)})" if near else ", ".join(known)
        raise InputError(f"{where}: found the unknown key {str(key)!r}, expected {meant}")


def check_camera(where: Any, camera: Intrinsics) -> None:
    """Refuse intrinsics that no camera has.

    Args:
        where: file or flag, named by the error.
        camera: intrinsics at the size of the images, integer pixel centres.

    Raises:
        InputError: says which number is odd and what it probably is instead.
    """
    width, height, fx, fy, cx, cy = (
        camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy
    )  # fmt: skip
    if not np.isfinite([fx, fy, cx, cy, *(camera.distortion or ())]).all() or min(fx, fy) <= 0:
        raise InputError(
            f"{where}: found fx {fx:g}, fy {fy:g}, cx {cx:g}, cy {cy:g}, expected finite numbers, fx and fy above 0"
        )
    if not (1 <= width <= _MAX_PIXELS and 1 <= height <= _MAX_PIXELS):
        raise InputError(f"{where}: found width and height {width}x{height}, expected 1 to {_MAX_PIXELS}")
    low, high = _FOCAL_BY_WIDTH
    if not low * max(width, height) <= fx <= high * max(width, height):
        raise InputError(
            f"{where}: found fx {fx:g} for images of {width}x{height}, expected a focal length in pixels of these "
            f"images ({low * max(width, height):.0f} to {high * max(width, height):.0f})"
        )
    squeeze = max(fx / fy, fy / fx)
    shift = max(abs(cx + 0.5 - width / 2) / width, abs(cy + 0.5 - height / 2) / height)
    if squeeze > _SQUEEZE or (squeeze > _SUSPICIOUS_SQUEEZE and shift > _SUSPICIOUS_SHIFT):
        raise InputError(
            f"{where}: found fx {fx:g}, fy {fy:g}, cx {cx:g}, cy {cy:g}, expected fx and fy nearly alike and cx, cy "
            f"near the centre of {width}x{height} (the order is fx, fy, cx, cy)"
        )
    if abs(width / height - 1) > _NOT_SQUARE and all(
        abs(found + 0.5 - other / 2) < _CENTRED * other for found, other in ((cx, height), (cy, width))
    ):
        raise InputError(
            f"{where}: found cx {cx:g}, cy {cy:g}, expected values near the centre of {width}x{height}; they are "
            "probably exchanged"
        )
    if not (-0.5 <= cx <= width - 0.5 and -0.5 <= cy <= height - 0.5):
        raise InputError(
            f"{where}: found cx {cx:g}, cy {cy:g}, expected a point inside the image of {width}x{height}"
        )
    if camera.distortion is not None:
        for name, value in zip(MODELS[model_of(camera.distortion)], camera.distortion, strict=True):
            if abs(value) > (limit := _MAX_DISTORTION[name]):
                raise InputError(
                    f"{where}: found {value:g} for distortion {name}, expected at most {limit:g} in size"
                )


def check_depth_scale(where: Any, value: float) -> None:
    """Refuse a scale that is the inverse of what is asked for, or none.

    Raises:
        InputError: names what was probably meant.
    """
    low, high = _DEPTH_SCALE
    if low <= value <= high:
        return
    inverse = 1 / value if value else 0.0
    hint = f"; metres per unit? then write {inverse:g}" if low <= inverse <= high else ""
    raise InputError(
        f"{where}: found depth scale {value:g}, expected stored units per metre, {low:g} to {high:g} "
        f"(1000 for millimetres){hint}"
    )


def check_extras(
    where: Any, offset_s: float, readout_s: float, depth_max: float | None, T_color_depth: np.ndarray | None
) -> None:
    """Refuse times in milliseconds, depth and baselines in millimetres.

    Raises:
        InputError: names the value and its unit.
    """
    for name, value, limit in (
        ("depth_time_offset_s", offset_s, _MAX_TIME_OFFSET_S),
        ("readout_s", readout_s, _MAX_READOUT_S),
    ):
        if not abs(value) <= limit:
            raise InputError(
                f"{where}: found {value:g} for {name}, expected seconds, at most {limit:g} in size"
            )
    if depth_max is not None and not _DEPTH_MAX_M[0] <= depth_max <= _DEPTH_MAX_M[1]:
        low, high = _DEPTH_MAX_M
        raise InputError(f"{where}: found {depth_max:g} for depth_max, expected metres, {low:g} to {high:g}")
    if T_color_depth is None:
        return
    distance = float(np.linalg.norm(T_color_depth[:3, 3]))
    if not distance <= _MAX_BASELINE_M:
        raise InputError(
            f"{where}: found a T_color_depth whose cameras are {distance:g} m apart, expected a translation in metres, "
            f"at most {_MAX_BASELINE_M:g} (millimetres are divided by 1000)"
        )
