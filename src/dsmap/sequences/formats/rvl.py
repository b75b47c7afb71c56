"""Depth in Wilson's run-length and variable-length coding, as compressed_depth_image_transport sends it."""

import struct

import numpy as np

from dsmap.errors import InputError

_MAX_PIXELS = 1 << 26


def rvl_decoded(data: bytes, where: str) -> np.ndarray:
    """Depth of Wilson's run-length and variable-length coding ("Fast Lossless Depth Image Compression", 2017).

    Width and height (32 bits each) come first. Then, in words of 32 bits from their highest half byte on, numbers of
    three bits a half byte, lowest first, the fourth bit telling that more follow: how many zeros, how many values,
    the values' differences (0, -1, 1, -2, ... as 0, 1, 2, 3, ...), and so on.

    Returns:
        uint16, shape (H, W).

    Raises:
        InputError: the data ends before the image is full.
    """
    width, height = struct.unpack_from("<II", data.ljust(8, b"\0"))
    if not 0 < width * height < _MAX_PIXELS:
        raise InputError(f"{where}: found an RVL image of {width}x{height}, expected a depth image's size")
    words = np.frombuffer(data[8 : 8 + (len(data) - 8) // 4 * 4], "<u4")
    halves = ((words[:, None] >> np.arange(28, -4, -4, dtype=np.uint32)) & 15).ravel().astype(np.int64)
    ends = np.flatnonzero(halves < 8)
    begins = np.concatenate([[0], ends[:-1] + 1])
    place = np.arange(len(halves)) - np.repeat(begins, ends - begins + 1) if len(ends) else halves[:0]
    place = np.minimum(place, 10)
    kept = halves[: len(place)]
    numbers = np.add.reduceat((kept & 7) << (3 * place), begins) if len(ends) else kept
    image, filled, at, last = np.zeros(width * height, np.int64), 0, 0, 0
    while filled < len(image):
        if at + 1 >= len(numbers):
            raise InputError(f"{where}: found {len(data)} bytes of RVL that end too early")
        filled, count, at = filled + int(numbers[at]), int(numbers[at + 1]), at + 2
        coded = numbers[at : at + count]
        if filled + count > len(image) or len(coded) < count or (not count and filled > len(image)):
            raise InputError(f"{where}: found damaged RVL, expected {width}x{height} values")
        if count:
            image[filled : filled + count] = last + np.cumsum((coded >> 1) ^ -(coded & 1))
            last = int(image[filled + count - 1])
        filled, at = filled + count, at + count
    return image.astype(np.uint16).reshape(height, width)
