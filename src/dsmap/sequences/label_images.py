"""Label images of other people: palettes, colours, 255 for void, and which of the 13 classes their ids mean."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image, UnidentifiedImageError

from dsmap.classes import NUM_CLASSES, VOID
from dsmap.errors import InputError
from dsmap.limits import MAX_IMAGE_BYTES
from dsmap.reading import DECODER_ERRORS, read_bytes, reason
from dsmap.sequences.image_headers import check_image_file, check_image_size
from dsmap.sequences.images import Packed, Source, read_ids, resize_nearest

VOID_IDS = (255, 65535)
"""What most data sets store for "not labelled", in 8 and in 16 bits."""
_UNKNOWN = 255
_IDS = 65536
_LISTED = 8
"""Ids that a message names."""
_SAME_SHAPE = 0.01
"""By how much two aspect ratios may differ that are one camera's."""
HINT = "say which label set it is with --label-map nyu40, scannet or FILE"


def _plain_classes() -> dict[int, int]:
    return {i: i for i in range(NUM_CLASSES)}


@dataclass(frozen=True)
class LabelMap:
    """Which of the 13 classes an id or a colour of label images means; the default: they are these classes."""

    classes: Mapping[int, int] = field(default_factory=_plain_classes)
    """Stored id to class."""
    colours: Mapping[tuple[int, int, int], int] = field(default_factory=dict)
    """RGB to class, for images that are coloured by class."""
    name: str | None = None
    """What --label-map said; None: nothing."""

    def read(self, source: Source) -> np.ndarray:
        """Class ids of a label image, uint8, shape (H, W), 0 = void.

        Raises:
            InputError: missing, damaged, blurred by JPEG, or with ids or colours that are in no label map.
        """
        if isinstance(source, Packed):  # its reader knows the format's label set
            return LabelMap().of_ids(read_ids(source), str(source))
        pixels = _read_pixels(source, coloured=bool(self.colours))
        return self.of_colours(pixels, str(source)) if pixels.ndim == 3 else self.of_ids(pixels, str(source))

    def of_ids(self, ids: np.ndarray, name: str) -> np.ndarray:
        """Class ids of stored ids. Raises InputError if one is in no label map."""
        table = np.full(_IDS, _UNKNOWN, np.uint8)
        table[[0, *VOID_IDS]] = VOID
        for stored, label in self.classes.items():
            table[stored] = label
        beyond = np.unique(ids[(ids < 0) | (ids >= _IDS)])
        found = table[np.clip(ids, 0, _IDS - 1)]
        unknown = [*np.unique(ids[found == _UNKNOWN]).tolist(), *beyond.tolist()]
        if unknown:
            raise ForeignLabels(name, [str(v) for v in unknown], self._expected())
        return found

    def of_colours(self, pixels: np.ndarray, name: str) -> np.ndarray:
        """Class ids of RGB, shape (H, W, 3). Raises InputError if a colour is in no label map."""
        codes = _code(pixels.reshape(-1, 3).astype(np.int64))
        known = {_code(np.array(rgb)).item(): label for rgb, label in self.colours.items()}
        present, where = np.unique(codes, return_inverse=True)
        unknown = [f"#{code:06x}" for code in present.tolist() if code not in known]
        if unknown:
            expected = self._expected() if self.colours else "one channel of ids"
            raise ForeignLabels(name, unknown, expected, "colours")
        return np.array([known[c] for c in present.tolist()], np.uint8)[where].reshape(pixels.shape[:2])

    def _expected(self) -> str:
        if self.name is not None:
            return f"what --label-map {self.name} lists"
        return f"0..{NUM_CLASSES - 1} (255 and 65535 are void)"


class ForeignLabels(InputError):
    """A label image of another label set."""

    def __init__(self, name: str, unknown: list[str], expected: str, what: str = "ids"):
        self.unknown, self.expected, self.what = unknown, expected, what
        super().__init__(f"{name}: found the {what} {listed(unknown)}, expected {expected}; {HINT}")


def listed(values: Iterable[str]) -> str:
    """The first few values, and how many there are."""
    values = list(values)
    more = f" and {len(values) - _LISTED} more" if len(values) > _LISTED else ""
    return ", ".join(values[:_LISTED]) + more


def fit(label: np.ndarray, width: int, height: int, name: str) -> np.ndarray:
    """Labels at the size of the recording's images, if they are a smaller or larger copy of the same view.

    Raises:
        InputError: the aspect ratio says that it is another view.
    """
    stored_height, stored_width = label.shape
    if abs(stored_width * height / (stored_height * width) - 1) > _SAME_SHAPE:
        raise InputError(
            f"{name}: found labels of {stored_width}x{stored_height}, expected {width}x{height} or its aspect ratio"
        )
    return resize_nearest(label, width, height)


def _code(rgb: np.ndarray) -> np.ndarray:
    return (rgb[..., 0] << 16) | (rgb[..., 1] << 8) | rgb[..., 2]


def _loses_ids(format: str | None, data: bytes) -> str | None:
    """What an image file is that does not hold ids as they were; None where it does."""
    if format == "JPEG":
        return "a JPEG, whose ids are blurred"
    if format == "WEBP" and b"VP8 " in data[:64]:
        return "a lossy WebP, whose ids are blurred"
    return "a GIF, whose palette is put in another order" if format == "GIF" else None


def _read_pixels(path: Path, coloured: bool) -> np.ndarray:
    """Ids, int64, shape (H, W), or RGB, uint8, shape (H, W, 3); of a palette indices, or colours if asked for."""
    try:
        data = read_bytes(path, "a label image (PNG)", MAX_IMAGE_BYTES)
        check_image_file(path, data)
        with Image.open(BytesIO(data)) as image:
            check_image_size(path, *image.size)
            if (lossy := _loses_ids(image.format, data)) is not None:
                raise InputError(f"{path}: found {lossy}, expected a lossless image (PNG)")
            if image.mode == "P" and not coloured:
                return np.asarray(image).astype(np.int64)
            if image.mode in ("P", "RGB", "RGBA"):
                rgb = np.asarray(image.convert("RGB"))
                grey = (rgb == rgb[..., :1]).all() and not coloured
                return rgb[..., 0].astype(np.int64) if grey else rgb
            pixels = np.asarray(image)
    except UnidentifiedImageError as error:
        raise InputError(f"{path}: does not decode, expected a label image (PNG)") from error
    except DECODER_ERRORS as error:
        raise InputError(f"{path}: cannot be read ({reason(error)}), expected a label image (PNG)") from error
    if pixels.ndim == 3 and image.mode == "LA":
        pixels = pixels[..., 0]
    if pixels.ndim != 2 or pixels.dtype.kind not in "iub":
        raise InputError(f"{path}: found an image of mode {image.mode}, expected one channel of ids")
    return pixels.astype(np.int64)
