"""NYUv2's raw recordings: `r-SECONDS-TICKS.ppm`, `d-SECONDS-TICKS.pgm` of the Kinect's disparities, unregistered.

Cameras, their offset and the law of disparity are those of the data set's toolbox (camera_params.m).
"""

import re
from functools import partial
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sequences.base import Recording
from dsmap.sequences.calibration import Calibration
from dsmap.sequences.formats.parts import Stamped, recording_by_stamp
from dsmap.sequences.formats.protocol import Options, Reader
from dsmap.sequences.images import Packed, Undistorter, read_colour, read_stored

_NAME = re.compile(r"([rd])-(\d+\.\d+)-\d+\.(?:ppm|pgm)")
_COLOUR = Intrinsics(
    640, 480, 518.85790117450188, 519.46961112127485, 325.58244941119034, 253.73616633400465,
    (0.20796615318809061, -0.58613825163911781, 7.2231363135888329e-4, 1.0479627195765181e-3, 0.49856986684705107),
)  # fmt: skip
_DEPTH = Intrinsics(
    640, 480, 582.62448167737955, 582.69103270988637, 313.04475870804731, 238.44389626620386,
    (-0.099897236553084481, 0.39065324602765344, 1.9290592870229277e-3, -1.9422022475975055e-3, -0.51031725053400578),
)  # fmt: skip
_T_COLOR_DEPTH = np.array(
    [
        [0.99997798940829263, -0.0050359919480810989, -0.0043196624923060242, -0.025031875059141302],
        [0.0050518419386157446, 0.99998051861143999, 0.0036662365748484798, -6.6238747008330102e-4],
        [0.0043011152014118693, -0.0036879781309514218, 0.99998394948385538, 2.9342312935846411e-4],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
_NEAR, _FAR = 351.3, 1092.5
"""Depth is 351.3 / (1092.5 - disparity) [m]."""
_MAX_DISPARITY = 2047
_MAX_DEPTH_M = 10.0
_APART_S = 0.034
"""The toolbox pairs the nearest images; both cameras run at 30 Hz or less."""


def _detect(path: Path) -> bool:
    return path.is_dir() and any(path.glob("d-*-*.pgm")) and any(path.glob("r-*-*.ppm"))


def _read(path: Path, _options: Options) -> Recording:
    straight = Undistorter(_COLOUR), Undistorter(_DEPTH)
    found: dict[str, list[Stamped]] = {"r": [], "d": []}
    for file in path.iterdir():
        if match := _NAME.fullmatch(file.name):
            load = (
                partial(_colour, file, straight[0]) if match[1] == "r" else partial(_depth, file, straight[1])
            )
            found[match[1]].append(Stamped(float(match[2]), Packed(path, file.name, load)))
    colour, depth = (sorted(images, key=lambda s: (s.time, s.image.name)) for images in found.values())
    calibration = Calibration(
        _pinhole(_DEPTH), 1.0, "NYUv2's toolbox", T_color_depth=_T_COLOR_DEPTH, color_camera=_pinhole(_COLOUR)
    )
    return recording_by_stamp("nyuv2-raw", path, colour, depth, calibration, [], _APART_S)


READER = Reader("nyuv2-raw", _detect, _read)


def _pinhole(camera: Intrinsics) -> Intrinsics:
    return Intrinsics(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)


def _colour(file: Path, straight: Undistorter) -> np.ndarray:
    rgb = read_colour(file)
    return straight.colour(rgb) if rgb.shape[:2] == (_COLOUR.height, _COLOUR.width) else rgb


def _depth(file: Path, straight: Undistorter) -> np.ndarray:
    stored = read_stored(file)
    if stored.dtype != np.uint16 or stored.ndim != 2:
        raise InputError(f"{file}: found no 16-bit PGM, expected the Kinect's disparities")
    depth = depth_of_disparity(stored)
    return straight.nearest(depth) if depth.shape == (_DEPTH.height, _DEPTH.width) else depth


def depth_of_disparity(stored: np.ndarray) -> np.ndarray:
    """Depth [m] of disparities of 11 bits, uint16, shape (H, W); 0 where there is none.

    The data set's files hold the low byte first, other than PGM says: the order that gives 11 bits is taken.
    """
    swapped = stored.byteswap()
    raw = swapped if (swapped <= _MAX_DISPARITY).sum() > (stored <= _MAX_DISPARITY).sum() else stored
    with np.errstate(divide="ignore"):
        depth = _NEAR / (_FAR - raw.astype(np.float64))
    return np.where((raw < _MAX_DISPARITY) & (depth > 0) & (depth < _MAX_DEPTH_M), depth, 0).astype(
        np.float32
    )
