"""Azure Kinect's `.mkv`: tracks COLOR and DEPTH, the cameras in an attached calibration.json.

Tracks and tags are those of Microsoft's "record file format"; both lenses' distortion is taken out while reading.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.plain import parse_json
from dsmap.sequences.base import Recording
from dsmap.sequences.formats.film import Film
from dsmap.sequences.formats.parts import Stamped, recording_by_stamp, two_cameras
from dsmap.sequences.formats.protocol import Options, Reader
from dsmap.sequences.images import Packed

_BEGINS = b"\x1a\x45\xdf\xa3"
"""EBML, the container of Matroska."""
_DEPTH_MODES = {
    (640, 576): (1024, 1024, 192, 180),
    (320, 288): (512, 512, 96, 90),
    (1024, 1024): (1024, 1024, 0, 0),
    (512, 512): (512, 512, 0, 0),
}
"""By size of the depth image: size of the sensor as it was binned, and where the image begins in it [px]."""


@dataclass(frozen=True)
class Lens:
    """A camera with the rational distortion of 8 coefficients (OpenCV's order), 0 where there is none."""

    pinhole: Intrinsics
    coefficients: np.ndarray
    T_camera_depth: np.ndarray

    def straightened(self, image: np.ndarray, interpolation: int) -> np.ndarray:
        """The image as the pinhole camera of the same matrix K sees it."""
        if not self.coefficients.any() or image.shape[:2] != (self.pinhole.height, self.pinhole.width):
            return image
        K, size = self.pinhole.K, (self.pinhole.width, self.pinhole.height)
        maps = cv2.initUndistortRectifyMap(K, self.coefficients, np.eye(3), K, size, cv2.CV_32FC1)
        return cv2.remap(image, *maps, interpolation=interpolation)


def _detect(path: Path) -> bool:
    if path.suffix.lower() != ".mkv" or not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(4) == _BEGINS


def _read(path: Path, _options: Options) -> Recording:
    film = Film(path)
    color, depth = _tracks(film)
    lenses = _lenses(film, color[1:], depth[1:])
    colour_of, depth_of = lenses or (None, None)
    colour_images = [
        Stamped(t, Packed(path, f"colour at {t:.6f} s", partial(_colour, film, color[0], ticks, colour_of)))
        for ticks, t in film.times(color[0])
    ]
    depth_images = [
        Stamped(t, Packed(path, f"depth at {t:.6f} s", partial(_depth, film, depth[0], ticks, depth_of)))
        for ticks, t in film.times(depth[0])
    ]
    calibration = None
    if lenses:
        T = lenses[0].T_camera_depth @ np.linalg.inv(lenses[1].T_camera_depth)
        calibration = two_cameras(
            lenses[0].pinhole, lenses[1].pinhole, T, 1000.0, "the attached calibration.json"
        )
    return recording_by_stamp("azure-kinect", path, colour_images, depth_images, calibration, [])


READER = Reader("azure-kinect", _detect, _read)


def _tracks(film: Film) -> tuple[tuple[int, int, int], tuple[int, int, int]]:
    """Index, width and height of the colour and the depth track."""
    named = {
        tags.get("title", tags.get("TITLE", "")).upper(): i for i, (_, tags, *_) in enumerate(film.streams)
    }
    grey = [i for i, s in enumerate(film.streams) if s[2].startswith("gray16")]
    others = [i for i, s in enumerate(film.streams) if not s[2].startswith("gray")]
    depth, color = (
        named.get("DEPTH", grey[0] if grey else None),
        named.get("COLOR", others[0] if others else None),
    )
    if depth is None or color is None:
        found = ", ".join(f"{s[2]} {s[3]}x{s[4]}" for s in film.streams) or "no track of images"
        raise InputError(
            f"{film.path}: found {found}, expected a colour track and one of 16-bit depth (b16g)"
        )
    (a, _, _, aw, ah), (b, _, _, bw, bh) = film.streams[color], film.streams[depth]
    return (a, aw, ah), (b, bw, bh)


def _lenses(film: Film, color: tuple[int, int], depth: tuple[int, int]) -> tuple[Lens, Lens] | None:
    """The colour and the depth camera at the sizes of their tracks; None where nothing is attached."""
    data = next((d for name, d in film.attachments.items() if name.endswith(".json")), None)
    if data is None:
        return None
    try:
        cameras = parse_json(data.rstrip(b"\0"), film.path)["CalibrationInformation"]["Cameras"]
        by_purpose = {c["Purpose"]: c for c in cameras}
        colour = _lens(by_purpose["CALIBRATION_CameraPurposePhotoVideo"], color, _color_window(*color))
        window = _DEPTH_MODES.get(depth, (*depth, 0, 0))
        return colour, _lens(by_purpose["CALIBRATION_CameraPurposeDepth"], depth, window)
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise InputError(f"{film.path}: the attached calibration.json is damaged ({error!r})") from error


def _color_window(width: int, height: int) -> tuple[int, int, int, int]:
    """The calibration speaks of the whole 4:3 sensor; 16:9 modes cut off its top and bottom."""
    whole = width * 3 // 4
    return (width, whole, 0, (whole - height) // 2) if height < whole else (width, height, 0, 0)


def _lens(camera: dict, size: tuple[int, int], window: tuple[int, int, int, int]) -> Lens:
    p = [float(v) for v in camera["Intrinsics"]["ModelParameters"]]
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, _, _, p2, p1 = p[:14]
    width, height, left, top = window
    # Parameters are shares of the sensor's size, from the corner of its first pixel.
    pinhole = Intrinsics(*size, fx * width, fy * height, cx * width - left - 0.5, cy * height - top - 0.5)
    T = np.eye(4)
    T[:3, :3] = np.array(camera["Rt"]["Rotation"], np.float64).reshape(3, 3)
    T[:3, 3] = camera["Rt"]["Translation"]
    return Lens(pinhole, np.array([k1, k2, p1, p2, k3, k4, k5, k6]), T)


def _colour(film: Film, track: int, ticks: int, lens: Lens | None) -> np.ndarray:
    rgb = film.frame(track, ticks, "rgb24")
    return lens.straightened(rgb, cv2.INTER_LINEAR) if lens else rgb


def _depth(film: Film, track: int, ticks: int, lens: Lens | None) -> np.ndarray:
    depth = film.frame(track, ticks, "gray16le").astype(np.uint16)
    return lens.straightened(depth, cv2.INTER_NEAREST) if lens else depth
