"""`.klg` logs of Logger1 and Logger2: a count, then frames of a stamp, zlib depth [mm] and JPEG colour."""

import struct
import zlib
from functools import partial
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sequences.base import Recording
from dsmap.sequences.calibration import Calibration
from dsmap.sequences.formats.parts import recording_by_number
from dsmap.sequences.formats.protocol import Options, Reader
from dsmap.sequences.images import Packed, Source, image_size

_FRAME = struct.Struct("<qii")
_ASSUMED = Intrinsics(640, 480, 528.0, 528.0, 319.5, 239.5)
"""A log names no camera; those that write it drive PrimeSense's."""
_MICROSECONDS = 1e6


def _detect(path: Path) -> bool:
    return path.suffix.lower() == ".klg" and path.is_file()


def _read(path: Path, _options: Options) -> Recording:
    parts, notes = _index(path), list[str]()
    size = _size(path, parts)
    colour: dict[int, Source] = {}
    depth: dict[int, Source] = {}
    for k, (_, at, depth_bytes, image_bytes) in enumerate(parts):
        if not image_bytes:
            continue
        depth[k] = Packed(path, f"depth {k}", partial(_depth, path, at, depth_bytes, size))
        colour[k] = Packed(path, f"colour {k}", partial(_colour, path, at + depth_bytes, image_bytes, size))
    calibration = None
    if size[0] * 3 == size[1] * 4:
        camera = _ASSUMED.scaled(*size)
        calibration = Calibration(camera, 1000.0, "assumed: a PrimeSense camera")
        notes.append(
            f"assumed: fx = fy = {camera.fx:g}, as a .klg names no camera; --intrinsics fx,fy,cx,cy sets it"
        )
    times = {k: part[0] / _MICROSECONDS for k, part in enumerate(parts)}
    return recording_by_number(
        "klg", path, colour, depth, calibration, expected="frames with colour and depth", notes=notes,
        times=times if any(times.values()) else None,
    )  # fmt: skip


READER = Reader("klg", _detect, _read)


def _index(path: Path) -> list[tuple[int, int, int, int]]:
    """Stamp, position of the images, and bytes of depth and of colour, of each frame."""
    size, found = path.stat().st_size, []
    with path.open("rb") as file:
        head = file.read(4)
        count = struct.unpack("<i", head)[0] if len(head) == 4 else 0
        for _ in range(count):
            head = file.read(_FRAME.size)
            if len(head) < _FRAME.size:
                break
            stamp, depth_bytes, image_bytes = _FRAME.unpack(head)
            at = file.tell()
            if depth_bytes <= 0 or image_bytes < 0 or at + depth_bytes + image_bytes > size:
                break
            found.append((stamp, at, depth_bytes, image_bytes))
            file.seek(at + depth_bytes + image_bytes)
    if not found:
        raise InputError(
            f"{path}: found {size} bytes and no whole frame, expected a .klg log of {count} frames"
        )
    return found


def _size(path: Path, parts: list[tuple[int, int, int, int]]) -> tuple[int, int]:
    """(width, height): that of the first JPEG; raw colour is 640x480."""
    for _, at, depth_bytes, image_bytes in parts[:10]:
        if image_bytes:
            data = _bytes(path, at + depth_bytes, image_bytes)
            found = image_size(Packed(path, "colour", lambda data=data: data))
            if found is not None:
                return found
    return _ASSUMED.width, _ASSUMED.height


def _bytes(path: Path, position: int, count: int) -> bytes:
    with path.open("rb") as file:
        file.seek(position)
        return file.read(count)


def _colour(path: Path, position: int, count: int, size: tuple[int, int]) -> bytes | np.ndarray:
    data = _bytes(path, position, count)
    if count == size[0] * size[1] * 3 and not data.startswith(b"\xff\xd8"):
        return np.frombuffer(data, np.uint8).reshape(size[1], size[0], 3)
    return data


def _depth(path: Path, position: int, count: int, size: tuple[int, int]) -> np.ndarray:
    data, needed = _bytes(path, position, count), size[0] * size[1] * 2
    if count != needed:
        try:
            data = zlib.decompressobj().decompress(data, needed + 1)
        except zlib.error as error:
            raise InputError(f"{path}: depth at byte {position} is damaged ({error})") from error
    if len(data) != needed:
        raise InputError(f"{path}: found {len(data)} bytes of depth, expected {size[0]}x{size[1]} in 16 bits")
    return np.frombuffer(data, "<u2").reshape(size[1], size[0]).astype(np.uint16)
