"""Pixels of sensor_msgs/Image and CompressedImage."""

import struct
from typing import Any

import cv2
import numpy as np

from dsmap.errors import InputError
from dsmap.sequences.formats.rvl import rvl_decoded

DEPTH_ENCODINGS = {"16UC1": np.uint16, "mono16": np.uint16, "z16": np.uint16, "32FC1": np.float32}
_COLOUR_CODES = {
    "yuv422": cv2.COLOR_YUV2RGB_UYVY,
    "uyvy": cv2.COLOR_YUV2RGB_UYVY,
    "yuv422_yuy2": cv2.COLOR_YUV2RGB_YUY2,
    "yuyv": cv2.COLOR_YUV2RGB_YUY2,
    "yuy2": cv2.COLOR_YUV2RGB_YUY2,
    "bayer_rggb8": cv2.COLOR_BayerBG2RGB,  # OpenCV names the second row's pattern
    "bayer_bggr8": cv2.COLOR_BayerRG2RGB,
    "bayer_gbrg8": cv2.COLOR_BayerGR2RGB,
    "bayer_grbg8": cv2.COLOR_BayerGB2RGB,
}
_ORDERS = {
    "rgb8": [0, 1, 2],
    "bgr8": [2, 1, 0],
    "rgba8": [0, 1, 2],
    "bgra8": [2, 1, 0],
    "8UC3": [2, 1, 0],
    "8UC4": [2, 1, 0],
    "mono8": [0, 0, 0],
    "8UC1": [0, 0, 0],
}
_CHANNELS = {"rgb8": 3, "bgr8": 3, "8UC3": 3, "rgba8": 4, "bgra8": 4, "8UC4": 4, "mono8": 1, "8UC1": 1}


def is_compressed(message: Any) -> bool:
    return hasattr(message, "format")


def kind(message: Any) -> str | None:
    """`depth`, `colour`, `grey`, or None for an image that is neither."""
    if not is_compressed(message):
        encoding = message.encoding
        if encoding in DEPTH_ENCODINGS or encoding.lower() == "z16":
            return "depth"
        if encoding in ("mono8", "8UC1"):
            return "grey"
        return "colour" if encoding in _ORDERS or encoding.lower() in _COLOUR_CODES else None
    format = message.format
    if "compressedDepth" in format or format.startswith(("16UC1", "32FC1", "mono16")):
        return "depth"
    return "grey" if format.startswith(("mono8", "8UC1")) else "colour"


def depth_units(message: Any) -> float:
    """Stored units per metre of a depth image: 16-bit depth is in millimetres (REP 118)."""
    named = message.format if is_compressed(message) else message.encoding
    return 1.0 if named.startswith("32FC1") else 1000.0


def pixels(message: Any, where: str) -> bytes | np.ndarray:
    """An image message as an image file's bytes or as pixels: RGB uint8, depth uint16 or float32.

    Raises:
        InputError: the encoding is not known, or there are fewer bytes than its size needs.
    """
    if is_compressed(message):
        return _compressed(message, where)
    encoding = message.encoding
    if encoding in DEPTH_ENCODINGS or encoding.lower() == "z16":
        rows = _rows(message, DEPTH_ENCODINGS.get(encoding, np.uint16), 1, where)
        return np.ascontiguousarray(rows[..., 0])
    if encoding in _ORDERS:
        rows = _rows(message, np.uint8, _CHANNELS[encoding], where)
        return np.ascontiguousarray(rows[..., _ORDERS[encoding]])
    code = _COLOUR_CODES.get(encoding.lower())
    if code is None:
        raise InputError(f"{where}: found the encoding {encoding!r}, expected colour, 16UC1 or 32FC1")
    rows = _rows(message, np.uint8, 1 if encoding.startswith("bayer") else 2, where)
    return cv2.cvtColor(np.ascontiguousarray(rows if rows.shape[2] == 2 else rows[..., 0]), code)


def _rows(message: Any, dtype: type, channels: int, where: str) -> np.ndarray:
    """Pixels of an uncompressed image without the padding of its rows, shape (H, W, channels)."""
    height, width = message.height, message.width
    stored = np.dtype(dtype).newbyteorder(">" if message.is_bigendian else "<")
    needed = width * channels * stored.itemsize
    data = np.frombuffer(message.data, np.uint8)
    step = max(int(message.step), needed)
    if len(data) < step * height or not height * width:
        raise InputError(
            f"{where}: found {len(data)} bytes, expected {step * height} for {width}x{height} {message.encoding}"
        )
    rows = np.ascontiguousarray(data[: step * height].reshape(height, step)[:, :needed])
    return rows.view(stored).astype(dtype, copy=False).reshape(height, width, channels)


def _compressed(message: Any, where: str) -> bytes | np.ndarray:
    data, format = bytes(message.data), message.format
    if "compressedDepth" not in format:
        return data
    # compressed_depth_image_transport: a header of 12 bytes (format, quantisation A, B), then a PNG.
    _, a, b = struct.unpack_from("<iff", data.ljust(12, b"\0"))
    if "rvl" in format.lower():
        quantised = rvl_decoded(data[12:], where)
    elif not format.startswith("32FC1"):
        return data[12:]
    else:
        quantised = (
            cv2.imdecode(np.frombuffer(data[12:], np.uint8), cv2.IMREAD_UNCHANGED) if data[12:] else None
        )
    if quantised is None:
        raise InputError(f"{where}: found {len(data)} bytes that do not decode, expected compressed depth")
    if not format.startswith("32FC1"):
        return quantised
    depth = np.zeros(quantised.shape, np.float32)
    valid = quantised > 0
    depth[valid] = np.float32(a) / (quantised[valid].astype(np.float32) - np.float32(b))
    return depth
