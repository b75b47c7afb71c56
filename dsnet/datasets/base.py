"""What every data set is read into: a list of items, each of which reads one labelled image."""

import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from PIL import Image, UnidentifiedImageError

from dsmap.classes import CLASS_NAMES, VOID
from dsmap.dsnet.datasets.geometry import DepthView
from dsmap.errors import InputError
from dsmap.limits import MAX_IMAGE_BYTES
from dsmap.reading import DECODER_ERRORS, read_bytes, reading, reason
from dsmap.sequences.image_headers import check_image_file, check_image_size
from dsmap.sequences.images import read_colour, read_depth, resize_colour
from dsmap.sequences.label_images import VOID_IDS, LabelMap

VOC_CLASS_NAMES: tuple[str, ...] = (
    "void", "background", "aeroplane", "bicycle", "bird", "boat", "bottle", "bus", "car", "cat", "chair",
    "cow", "dining table", "dog", "horse", "motorbike", "person", "potted plant", "sheep", "sofa", "train",
    "tv monitor",
)  # fmt: skip
"""PASCAL VOC behind the void (their 255) that is class 0 everywhere in dsmap."""


@dataclass(frozen=True)
class Example:
    """One labelled image."""

    rgb: np.ndarray
    """uint8, shape (H, W, 3)."""
    label: np.ndarray
    """Class ids, uint8, shape (H, W); 0 = void."""
    geometry: np.ndarray | None = None
    """What depth tells, float16, shape (H, W, 4) (see `kernels.geometry`); None: there is no depth."""


def guarded(read: Callable[..., Example]) -> Callable[..., Example]:
    """Decorates the `read` of an item: whatever its parsers raise means that the image is damaged."""

    @functools.wraps(read)
    def checked(self: Any, with_geometry: bool = True) -> Example:
        with reading(self.name, "a labelled image"):
            return read(self, with_geometry)

    return checked


class Item(Protocol):
    """A labelled image that is not read yet; picklable, so that loader processes can take it."""

    @property
    def name(self) -> str:
        """Names the image in messages and lists."""
        ...

    def read(self, with_geometry: bool = True) -> Example:
        """Read and check it; geometry only if there is depth and it is wanted.

        Raises:
            InputError: missing or damaged files, sizes that differ, ids of no class.
        """
        ...


@dataclass(frozen=True)
class LabelledSet:
    """A data set, nothing of which is decoded yet."""

    items: list[Item]
    class_names: tuple[str, ...] = CLASS_NAMES
    """Names of the ids that the items' labels have; `void` is 0."""
    has_depth: bool = False
    """Whether every item has geometry as well."""
    sizes: tuple[int, ...] = ()
    """Of several sets put together: how many items each has, in their order; () for one."""


@dataclass(frozen=True)
class FileItem:
    """An item of image files."""

    rgb: Path
    label: Path
    depth: Path | None = None
    depth_scale: float = 1000.0
    """Stored units per metre."""
    table: np.ndarray | None = field(default=None, compare=False)
    """Class of each stored id, uint8, shape (ids,); None: the stored ids are dsmap's classes."""
    label_map: LabelMap | None = field(default=None, compare=False)
    """How ids, names or colours of another label set become dsmap's classes; goes before `table`."""
    num_classes: int = len(CLASS_NAMES)
    same_size: bool = True
    """Whether colour must be of the label's size; otherwise it is resized to it, as depth is."""
    view: DepthView | None = None
    """How the depth image was taken; None: depth is of no use."""

    @property
    def name(self) -> str:
        return str(self.label)

    @guarded
    def read(self, with_geometry: bool = True) -> Example:
        rgb = read_colour(self.rgb)
        stored = self.label_map.read(self.label) if self.label_map else read_indices(self.label)
        if stored.shape != rgb.shape[:2]:
            if self.same_size:
                raise InputError(
                    f"{self.label}: size is {stored.shape[1]}x{stored.shape[0]}, "
                    f"expected {rgb.shape[1]}x{rgb.shape[0]} as {self.rgb.name}"
                )
            rgb = resize_colour(rgb, stored.shape[1], stored.shape[0])
        label = to_classes(stored, None if self.label_map else self.table, self.num_classes, str(self.label))
        if not with_geometry or self.depth is None or self.view is None:
            return Example(rgb, label)
        return Example(rgb, label, self.view.geometry(read_depth(self.depth, self.depth_scale), label.shape))


def to_classes(stored: np.ndarray, table: np.ndarray | None, num_classes: int, name: str) -> np.ndarray:
    """Class ids, uint8, of stored ids; `table` as in `FileItem`. Without a table 255 and 65535 are void.

    Raises:
        InputError: an id is beyond the table, or a class beyond `num_classes`.
    """
    if stored.dtype.kind not in "iub" or stored.ndim != 2:
        raise InputError(f"{name}: found labels of {stored.dtype} {stored.shape}, expected ids, (H, W)")
    if stored.size and stored.min() < 0:
        raise InputError(f"{name}: class id {stored.min()} found, expected ids from 0")
    if table is None:
        stored = np.where(np.isin(stored, VOID_IDS), VOID, stored)
    limit = num_classes if table is None else len(table)
    if stored.size and stored.max() >= limit:
        raise InputError(
            f"{name}: class id {stored.max()} found, expected 0..{limit - 1}; say which label set it is with "
            "--label-map"
        )
    return stored.astype(np.uint8) if table is None else table[stored]


def read_indices(path: Path) -> np.ndarray:
    """Ids of a label image, 8 or 16 bit, shape (H, W): palette images give their indices, not colours.

    Raises:
        InputError: missing, damaged, or a colour image.
    """
    try:
        data = read_bytes(path, "a label image (PNG)", MAX_IMAGE_BYTES)
        check_image_file(path, data)
        with Image.open(BytesIO(data)) as image:
            check_image_size(path, *image.size)
            if image.mode not in ("P", "L", "I;16", "I", "1"):
                raise InputError(f"{path}: found an image of mode {image.mode}, expected one channel of ids")
            return np.asarray(image)
    except UnidentifiedImageError as error:
        raise InputError(f"{path}: no readable image, expected a label image (PNG)") from error
    except DECODER_ERRORS as error:
        raise InputError(f"{path}: cannot be read ({reason(error)}), expected a label image (PNG)") from error


def voc_table() -> np.ndarray:
    """VOC's stored ids (0 background, 1..20, 255 void) to classes, shape (256,); other ids are void too."""
    table = np.full(256, VOID, np.uint8)
    table[:21] = np.arange(1, 22)
    return table


def require(path: Path, what: str) -> Path:
    """The path, if it exists.

    Raises:
        InputError: it does not; `what` says what it is and where it comes from.
    """
    if not path.exists():
        raise InputError(f"{path}: not there, expected {what}")
    return path


def read_list(path: Path, what: str) -> list[str]:
    """The words of a text file, one a line, empty lines left out."""
    try:
        return require(path, what).read_text(encoding="utf-8").split()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error}), expected {what}") from error
