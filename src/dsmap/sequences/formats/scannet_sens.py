"""ScanNet's `.sens`: one file of a header and compressed frames (SensorData, version 4)."""

import struct
import zlib
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sequences.base import Recording
from dsmap.sequences.calibration import Calibration
from dsmap.sequences.formats.parts import recording_by_number, two_cameras
from dsmap.sequences.formats.protocol import Options, Reader
from dsmap.sequences.image_headers import check_image_size
from dsmap.sequences.images import Packed

_VERSION = 4
_RAW, _ZLIB = 0, 1
"""How depth is stored; colour is raw (0), PNG or JPEG."""
_FRAME = struct.Struct("<16fQQQQ")
_MICROSECONDS = 1e6


@dataclass(frozen=True)
class _Header:
    color: np.ndarray
    """Intrinsics of the colour camera, (4, 4)."""
    T_color: np.ndarray
    depth: np.ndarray
    T_depth: np.ndarray
    color_compression: int
    depth_compression: int
    color_size: tuple[int, int]
    depth_size: tuple[int, int]
    depth_scale: float
    frames: int
    begin: int
    """Where the first frame is in the file."""


def _detect(path: Path) -> bool:
    return path.suffix.lower() == ".sens" and path.is_file()


def _read(path: Path, _options: Options) -> Recording:
    header = _read_header(path)
    colour, depth, poses, times = {}, {}, {}, {}
    position, size = header.begin, path.stat().st_size
    notes: list[str] = []
    with path.open("rb") as file:
        for k in range(header.frames):
            file.seek(position)
            head = file.read(_FRAME.size)
            if len(head) < _FRAME.size:
                break
            *pose, stamp, _stamp_depth, color_bytes, depth_bytes = _FRAME.unpack(head)
            first = position + _FRAME.size
            position = first + color_bytes + depth_bytes
            if position > size:
                break
            colour[k] = Packed(path, f"colour {k}", partial(_colour, path, first, color_bytes, header))
            depth[k] = Packed(
                path, f"depth {k}", partial(_depth, path, first + color_bytes, depth_bytes, header)
            )
            poses[k] = np.array(pose, np.float64).reshape(4, 4)
            times[k] = stamp / _MICROSECONDS
    if not colour:
        raise InputError(
            f"{path}: found {size} bytes that end before the first frame, expected {header.frames} frames"
        )
    if len(colour) < header.frames:
        notes.append(f"the file ends after {len(colour)} of {header.frames} frames")
    if not any(times.values()):
        times = {}  # some scanners left them 0
    return recording_by_number(
        "scannet-sens", path, colour, depth, _calibration(header), expected="frames", times=times, poses=poses,
        notes=notes,
    )  # fmt: skip


READER = Reader("scannet-sens", _detect, _read)


def _read_header(path: Path) -> _Header:
    with path.open("rb") as file:
        head = file.read(12)
        version, length = struct.unpack("<IQ", head) if len(head) == 12 else (0, 0)
        if version != _VERSION or length > 4096:
            raise InputError(f"{path}: found version {version} of a .sens file, expected {_VERSION}")
        file.seek(length, 1)
        data = file.read(4 * 64 + 4 * 6 + 4 + 8)
        if len(data) < 292:
            raise InputError(f"{path}: found a .sens file that ends in its header, expected a whole one")
        color, T_color, depth, T_depth = np.frombuffer(data[:256], "<f4").astype(np.float64).reshape(4, 4, 4)
        how_color, how_depth, cw, ch, dw, dh, scale, frames = struct.unpack("<iiIIIIfQ", data[256:])
        return _Header(
            color, T_color, depth, T_depth, how_color, how_depth, (cw, ch), (dw, dh), float(scale), frames, file.tell()
        )  # fmt: skip


def _calibration(header: _Header) -> Calibration:
    colour, depth = (
        Intrinsics(*size, K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        for size, K in ((header.color_size, header.color), (header.depth_size, header.depth))
    )
    T_color_depth = np.eye(4)
    if np.linalg.det(header.T_color) and np.linalg.det(header.T_depth):
        T_color_depth = np.linalg.inv(header.T_color) @ header.T_depth
    return two_cameras(colour, depth, T_color_depth, header.depth_scale, "the .sens header")


def _bytes(path: Path, position: int, count: int) -> bytes:
    with path.open("rb") as file:
        file.seek(position)
        return file.read(count)


def _colour(path: Path, position: int, count: int, header: _Header) -> bytes | np.ndarray:
    data = _bytes(path, position, count)
    if header.color_compression != _RAW:
        return data
    width, height = header.color_size
    if len(data) != width * height * 3:
        raise InputError(f"{path}: found {len(data)} bytes of raw colour, expected {width}x{height} in RGB")
    return np.frombuffer(data, np.uint8).reshape(height, width, 3)


def _depth(path: Path, position: int, count: int, header: _Header) -> np.ndarray:
    data, (width, height) = _bytes(path, position, count), header.depth_size
    if header.depth_compression not in (_RAW, _ZLIB):
        raise InputError(f"{path}: found depth compression {header.depth_compression}, expected raw or zlib")
    check_image_size(path, width, height)
    try:
        if header.depth_compression == _ZLIB:
            data = zlib.decompressobj().decompress(data, 2 * width * height + 1)  # no more, whatever it holds
        values = np.frombuffer(data, "<u2")
        return values.reshape(height, width).astype(np.uint16)
    except (zlib.error, ValueError) as error:
        raise InputError(
            f"{path}: depth at byte {position} is damaged ({error}), expected {width}x{height}"
        ) from error
