"""What an image file says of itself, checked before a decoder asks for memory or makes up what is missing."""

import struct
import zlib
from typing import Any

from dsmap.errors import InputError
from dsmap.limits import MAX_IMAGE_PIXELS

_PNG = b"\x89PNG\r\n\x1a\n"
_ANIMATION = (b"acTL", b"fcTL", b"fdAT")
_JPEG = b"\xff\xd8"
_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
"""Markers of JPEG that state the size."""


def check_image_file(where: Any, data: bytes) -> None:
    """Refuse image files that are cut off, claim a size that no camera has, or whose checksums are wrong.

    Decoders of some versions fill up what is cut off, and pass over damage in what is there. PNG carries checksums; of
    JPEG only size and end can be checked. OpenCV bounds all other formats (`MAX_IMAGE_PIXELS`, set in `dsmap`).

    Raises:
        InputError: names what is wrong.
    """
    if not data:
        raise InputError(f"{where}: found 0 bytes that end too early, expected a whole image file")
    if data.startswith(_PNG[:4]):
        _check_png(where, data)
    elif data.startswith(_JPEG):
        _check_jpeg(where, data)


def check_image_size(where: Any, width: int, height: int) -> None:
    """Refuse an image of more than `MAX_IMAGE_PIXELS`, or of none."""
    if not 0 < width * height <= MAX_IMAGE_PIXELS:
        raise InputError(
            f"{where}: found a header of {width}x{height} pixels, expected at most {MAX_IMAGE_PIXELS:,} and one or more"
        )


def _check_png(where: Any, data: bytes) -> None:
    at, name = len(_PNG), b""
    if data[: len(_PNG)] != _PNG or data[12:16] != b"IHDR" or len(data) < 33:
        raise InputError(f"{where}: found a PNG without its header, expected a whole image file")
    view = memoryview(data)
    while name != b"IEND":
        if at + 12 > len(data):
            raise InputError(
                f"{where}: found {len(data)} bytes that end too early, expected a whole image file"
            )
        size, name = struct.unpack_from(">I4s", data, at)
        if at + 12 + size > len(data):
            raise InputError(
                f"{where}: found a part {name!r} of {size} bytes in a file of {len(data)} that end too early, "
                "expected a whole image file"
            )
        (stated,) = struct.unpack_from(">I", data, at + 8 + size)
        if zlib.crc32(view[at + 4 : at + 8 + size]) != stated:
            raise InputError(
                f"{where}: found a wrong checksum in its part {name!r}, expected a whole image file"
            )
        if name in _ANIMATION:  # OpenCV puts its frames together, and shows none of a torn one
            raise InputError(f"{where}: found an animated PNG, expected a still image")
        at += 12 + size
    check_image_size(where, *struct.unpack_from(">II", data, 16))


def _check_jpeg(where: Any, data: bytes) -> None:
    if b"\xff\xd9" not in data[-1024:]:
        raise InputError(f"{where}: found {len(data)} bytes that end too early, expected a whole image file")
    at = 2
    while at + 9 < len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker == 0xFF:  # a fill byte
            at += 1
            continue
        if marker in _FRAMES:
            height, width = struct.unpack_from(">HH", data, at + 5)
            check_image_size(where, width, height)
            return
        at += 2 + struct.unpack_from(">H", data, at + 2)[0]
