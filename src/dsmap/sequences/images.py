"""Reading and resizing the images of a sequence. Every function here keeps integer pixel centres."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.lens import undistort_maps
from dsmap.limits import MAX_IMAGE_BYTES
from dsmap.reading import read_bytes, reading
from dsmap.sequences.arrays import is_array, read_array
from dsmap.sequences.image_headers import check_image_file

IMAGE_SUFFIXES = (
    ".png",
    ".jpg",
    ".jpeg",
    ".tif",
    ".tiff",
    ".bmp",
    ".ppm",
    ".pgm",
    ".webp",
    ".exr",
    ".npy",
    ".npz",
)
"""Of image files, in lower case."""
SATURATED = 65535
"""A stored 16-bit depth of this value is no measurement (7-Scenes says so; elsewhere it is clipped)."""


@dataclass(frozen=True)
class Packed:
    """An image inside a larger file (a bag, a film, an archive), read only when a frame asks for it."""

    container: Path
    name: str
    """Which image of the container, for people."""
    load: Callable[[], bytes | np.ndarray] = field(repr=False, compare=False)
    """Gives an image file's bytes, or decoded pixels: colour RGB uint8, shape (H, W, 3); depth uint16 or float32,
    shape (H, W), in the calibration's units. May be called from several threads. Raises InputError if damaged."""

    def __str__(self) -> str:
        return f"{self.container}, {self.name}"


Source = Path | Packed
"""Where an image is."""


def read_colour(path: Source) -> np.ndarray:
    """An image as RGB uint8, shape (H, W, 3). Raises InputError if it is missing or damaged."""
    # The pixels as stored, as depth's are: a camera's "hold me upright" (EXIF) would turn colour alone.
    image = _decode(path, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


def read_depth(path: Source, depth_scale: float) -> np.ndarray:
    """A depth image in metres, float32, shape (H, W), 0 where there is none.

    Args:
        path: single-channel image, TIFF, EXR or NumPy array of 16 bits or more, integers or floats.
        depth_scale: stored units per metre.
    """
    stored = _decode(path, cv2.IMREAD_UNCHANGED)
    if not is_depth(stored):
        channels = 1 if stored.ndim == 2 else stored.shape[2]
        raise InputError(
            f"{path}: found {channels} channel(s) of {stored.dtype}, expected a depth image of one channel, "
            "16-bit integers or 32-bit floats"
        )
    stored = stored if stored.ndim == 2 else stored[..., 0]
    depth = stored.astype(np.float32) * np.float32(1.0 / depth_scale)
    if stored.dtype == np.uint16:
        depth[stored == SATURATED] = 0.0
        return depth
    return clean_depth(depth)


def read_stored(path: Source) -> np.ndarray:
    """An image as stored. Raises InputError if it is missing or damaged."""
    return _decode(path, cv2.IMREAD_UNCHANGED)


def stored_depth(path: Source) -> np.ndarray | None:
    """A depth image as stored, or None if it cannot be decoded."""
    try:
        return read_stored(path)
    except InputError:
        return None


def is_depth(stored: np.ndarray) -> bool:
    """Whether decoded pixels may be depth: one channel (or a float one repeated) of more than 8 bits."""
    if stored.ndim == 3 and stored.dtype.kind == "f":  # some programs store three equal channels
        return bool(np.array_equal(stored, np.broadcast_to(stored[..., :1], stored.shape), equal_nan=True))
    return stored.ndim == 2 and stored.dtype.kind in "iuf" and stored.dtype.itemsize >= 2


def read_ids(path: Source) -> np.ndarray:
    """Class or instance ids as stored, uint8 or uint16, shape (H, W)."""
    ids = _decode(path, cv2.IMREAD_UNCHANGED)
    if ids.ndim != 2:
        raise InputError(f"{path}: found {ids.shape[2]} channels, expected one channel of ids")
    if ids.dtype.kind not in "iu":
        raise InputError(f"{path}: found {ids.dtype}, expected ids as whole numbers")
    return ids


def encoded(image: Packed) -> tuple[str, bytes]:
    """Suffix and bytes of an image file that holds the same pixels. Raises InputError if they cannot be read."""
    data = image.load()
    if isinstance(data, bytes):
        known = {b"\x89PNG": ".png", b"\xff\xd8": ".jpg"}
        return next((suffix for begin, suffix in known.items() if data.startswith(begin)), ".png"), data
    suffix = ".tiff" if data.dtype == np.float32 else ".png"
    pixels = np.ascontiguousarray(data[..., ::-1]) if data.ndim == 3 else data
    return suffix, cv2.imencode(suffix, pixels)[1].tobytes()


def clean_depth(depth: np.ndarray) -> np.ndarray:
    """Depth with NaN, infinite and negative values set to 0 (no measurement)."""
    return np.where(np.isfinite(depth) & (depth > 0), depth, 0).astype(np.float32)


def image_size(path: Source) -> tuple[int, int] | None:
    """(width, height) of an image file, or None if it cannot be decoded."""
    try:
        height, width = _decode(path, cv2.IMREAD_UNCHANGED).shape[:2]
    except InputError:
        return None
    return width, height


def asks_to_be_turned(path: Source) -> bool:
    """Whether a colour image's EXIF orientation asks viewers to turn it; its stored pixels are what counts."""
    try:
        turned = _decode(path, cv2.IMREAD_COLOR)
        return not np.array_equal(turned, _decode(path, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION))
    except InputError:
        return False


def check_size(path: Source, image: np.ndarray, width: int, height: int) -> None:
    """Raise InputError unless the image has the calibrated size."""
    if image.shape[:2] != (height, width):
        raise InputError(
            f"{path}: found an image of {image.shape[1]}x{image.shape[0]}, expected {width}x{height} "
            "as the recording's camera has"
        )


def resize_colour(rgb: np.ndarray, width: int, height: int) -> np.ndarray:
    """Colour at another size, averaged over the area of the new pixels."""
    if rgb.shape[:2] == (height, width):
        return rgb
    shrinks = width <= rgb.shape[1] and height <= rgb.shape[0]
    return cv2.resize(rgb, (width, height), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)


def resize_nearest(image: np.ndarray, width: int, height: int) -> np.ndarray:
    """Depth or ids at another size: the source pixel under the centre of the new one, never a mixture.

    The centre of the new pixel x lies at (x + 0.5) s - 0.5 in the source; halves round up.
    """
    if image.shape[:2] == (height, width):
        return image
    rows = _source_pixels(height, image.shape[0])
    columns = _source_pixels(width, image.shape[1])
    return np.ascontiguousarray(image[rows][:, columns])


def resize_depth(depth: np.ndarray, width: int, height: int) -> np.ndarray:
    """Depth at another size: the pixel under the centre of the new one, or the valid one nearest to it in its cell."""
    resized = resize_nearest(depth, width, height)
    if resized is depth or (width >= depth.shape[1] and height >= depth.shape[0]):
        return resized
    sources = [_source_pixels(n, of) for n, of in ((height, depth.shape[0]), (width, depth.shape[1]))]
    y, x = np.nonzero(resized == 0)
    for dy, dx in _offsets(depth.shape[0] / height, depth.shape[1] / width):
        if not len(y):
            break
        rows, columns = sources[0][y] + dy, sources[1][x] + dx
        inside = _in_cell(rows, y, height, depth.shape[0]) & _in_cell(columns, x, width, depth.shape[1])
        values = np.where(inside, depth[np.where(inside, rows, 0), np.where(inside, columns, 0)], 0)
        resized[y, x] = values
        y, x = y[values == 0], x[values == 0]
    return resized


def _offsets(sy: float, sx: float) -> list[tuple[int, int]]:
    """Steps from the pixel under the centre to the others that may lie in a cell of sy x sx pixels, nearest first.

    Halves round up, so the pixel under the centre lies half a pixel past it in cells of an even size.
    """
    ry, rx = int(np.ceil(sy / 2)), int(np.ceil(sx / 2))
    steps = [(dy, dx) for dy in range(-ry, ry + 1) for dx in range(-rx, rx + 1) if dy or dx]
    return sorted(steps, key=lambda s: ((s[0] + 0.25) ** 2 + (s[1] + 0.25) ** 2, s))


def _in_cell(index: np.ndarray, cell: np.ndarray, size: int, source_size: int) -> np.ndarray:
    """Whether source pixels lie in a cell of the new grid."""
    return (index >= 0) & (index < source_size) & ((2 * index + 1) * size // (2 * source_size) == cell)


def _source_pixels(size: int, source_size: int) -> np.ndarray:
    centres = (np.arange(size) + 0.5) * (source_size / size) - 0.5
    return np.clip(np.floor(centres + 0.5).astype(np.int64), 0, source_size - 1)


class Undistorter:
    """Remaps images of a distorted camera to the pinhole camera of the same matrix K."""

    def __init__(self, intrinsics: Intrinsics):
        """Compute the maps once. `intrinsics.distortion` must not be None."""
        self._maps = undistort_maps(intrinsics)

    def colour(self, rgb: np.ndarray) -> np.ndarray:
        """Bilinear; black where the source has no pixel."""
        return cv2.remap(rgb, *self._maps, interpolation=cv2.INTER_LINEAR)

    def nearest(self, image: np.ndarray) -> np.ndarray:
        """Depth or ids; 0 where the source has no pixel."""
        return cv2.remap(image, *self._maps, interpolation=cv2.INTER_NEAREST)


def _decode(path: Source, flags: int) -> np.ndarray:
    """Pixels in OpenCV's order: colour is BGR."""
    with reading(path, "an image"):
        data = path.load() if isinstance(path, Packed) else read_bytes(path, "an image", MAX_IMAGE_BYTES)
        if isinstance(data, np.ndarray):
            return np.ascontiguousarray(data[..., ::-1]) if data.ndim == 3 else data
        if is_array(data):
            return read_array(str(path), data)
        check_image_file(path, data)
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    if image is None:
        raise InputError(f"{path}: found {len(data)} bytes that do not decode, expected an image file")
    return image
