"""The official NYU Depth v2 file, `nyu_depth_v2_labeled.mat` (HDF5), with depth; 13 classes.

Beside it must lie `splits.mat` (the official split) and the 40 classes of Gupta et al.: `classMapping40.mat`
(894 names to 40) or `labels40.mat` (the labels themselves).
"""

import functools
import math
import os
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
from scipy.io.matlab import MatReadError

from dsmap.classes import CLASS_NAMES, NYU40_TO_13
from dsmap.dsnet.datasets.base import Example, LabelledSet, guarded, require, to_classes
from dsmap.dsnet.datasets.geometry import DepthView
from dsmap.dsnet.datasets.splits import select, validation_numbers
from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.limits import MAX_MAT_BYTES, MAX_PIECE_BYTES
from dsmap.reading import DECODER_ERRORS, check_plain, reading, reason
from dsmap.sequences.images import clean_depth

MAT_NAME = "nyu_depth_v2_labeled.mat"
_MAT_PACKED = 15
"""miCOMPRESSED: a variable of a MATLAB file that is packed by zlib."""
_COLOUR_CAMERA = DepthView(Intrinsics(640, 480, 518.9, 519.5, 325.6, 253.7))
"""Of the toolbox; depth is registered to it."""
SPLITS = ("train", "val", "trainval", "test")
"""`trainval` is the official training split, `train` and `val` its parts by the list of dsmap."""


def is_nyuv2(path: Path) -> bool:
    return path.suffix == ".mat" or (path / MAT_NAME).is_file()


def load_nyuv2(path: Path, split: str | None) -> LabelledSet:
    """The official file, or the folder that holds it.

    Args:
        split: `trainval` (default), `train`, `val` or `test`.

    Raises:
        InputError: files that are missing (what to download is said) or damaged, an unknown split.
    """
    file = path / MAT_NAME if path.is_dir() else path
    split = split or "trainval"
    if split not in SPLITS:
        raise InputError(f"{file}: split is {split!r}, expected one of {', '.join(SPLITS)}")
    require(file, f"{MAT_NAME} of the NYU Depth Dataset V2 page (labeled dataset)")
    opened = open_hdf5(file)
    count = _checked(opened, file)
    official = read_mat(
        require(file.parent / "splits.mat", "the official train/test split of the NYU Depth Dataset V2 page"),
        "testNdxs" if split == "test" else "trainNdxs",
    )
    if official.dtype.kind not in "iuf" or not np.isfinite(official).all():
        raise InputError(f"{file.parent / 'splits.mat'}: found {official.dtype}, expected numbers of images")
    numbers = [int(number) for number in official.ravel()]
    if not numbers or min(numbers) < 1 or max(numbers) > count:
        raise InputError(
            f"{file.parent / 'splits.mat'}: numbers exceed 1..{count}, the images of {file.name}"
        )
    if split in ("train", "val"):
        numbers = [numbers[i] for i in select(numbers, split, validation_numbers())]
    table, labels = _classes(file.parent)
    return LabelledSet([MatItem(file, n - 1, table, labels) for n in numbers], CLASS_NAMES, has_depth=True)


@dataclass(frozen=True, eq=False)
class MatItem:
    """One image of the official file."""

    file: Path
    index: int
    """From 0; the set's own numbers count from 1."""
    table: np.ndarray
    """Stored label to our class."""
    labels40: Path | None
    """Where the stored labels are, if not in `file`."""

    @property
    def name(self) -> str:
        return f"{self.file}:{self.index + 1}"

    @guarded
    def read(self, with_geometry: bool = True) -> Example:
        content = open_hdf5(self.file)
        try:
            rgb = content["images"][self.index].transpose(2, 1, 0)  # MATLAB's order, reversed: (3, W, H)
            depth = clean_depth(content["depths"][self.index].T) if with_geometry else None
            label = content["labels"][self.index].T
        except DECODER_ERRORS as error:
            raise InputError(
                f"{self.name}: damaged ({reason(error)}), expected the whole of {MAT_NAME}"
            ) from error
        if rgb.dtype != np.uint8 or rgb.shape[2:] != (3,):
            raise InputError(f"{self.name}: images are {rgb.dtype} {rgb.shape}, expected uint8 (H, W, 3)")
        if label.shape != rgb.shape[:2]:
            raise InputError(f"{self.name}: labels are {label.shape}, expected {rgb.shape[:2]} as the image")
        if self.labels40 is not None:
            label = _labels40(self.labels40, os.getpid())[..., self.index]
        classes = to_classes(label, self.table, len(CLASS_NAMES), self.name)
        geometry = None if depth is None else _COLOUR_CAMERA.geometry(depth, classes.shape)
        return Example(np.ascontiguousarray(rgb), np.ascontiguousarray(classes), geometry)


def _checked(content: Any, file: Path) -> int:
    """Number of images, after a look at the shapes."""
    images, depths, labels = (
        dataset_of(content, name, file).shape for name in ("images", "depths", "labels")
    )
    if len(images) != 4 or (images[0], *images[2:]) != depths or depths != labels:
        raise InputError(
            f"{file}: shapes {images}, {depths}, {labels} of images, depths, labels do not agree"
        )
    return images[0]


def _classes(folder: Path) -> tuple[np.ndarray, Path | None]:
    """Table from stored labels to our classes, and the file of labels if it is another one."""
    mapping, labels = folder / "classMapping40.mat", folder / "labels40.mat"
    if not mapping.exists() and labels.exists():
        return NYU40_TO_13, labels
    require(
        mapping,
        "classMapping40.mat (or labels40.mat) of the 40-class labels of Gupta et al. for NYU Depth v2",
    )
    to_40 = read_mat(mapping, "mapClass").ravel().astype(np.int64)
    if not len(to_40) or to_40.min() < 0 or to_40.max() >= len(NYU40_TO_13):
        raise InputError(f"{mapping}: mapClass is empty or goes beyond, expected classes 1..40")
    return np.concatenate([NYU40_TO_13[:1], NYU40_TO_13[to_40]]), None


@functools.lru_cache(maxsize=2)
def _labels40(path: Path, process: int) -> np.ndarray:
    """NYU40 ids, uint8, shape (H, W, images): 445 MB for the whole set, so once a process."""
    labels = read_mat(path, "labels40")
    if labels.ndim != 3:
        raise InputError(f"{path}: labels40 has shape {labels.shape}, expected (H, W, images)")
    return labels


def open_hdf5(path: Path) -> Any:
    """A HDF5 file for reading, opened once a process: a handle must not cross a fork.

    Raises:
        InputError: it is none, or damaged.
    """
    return _opened(path, os.getpid())


@functools.lru_cache(maxsize=8)
def _opened(path: Path, process: int) -> Any:
    import h5py

    check_plain(path, "a MATLAB 7.3 file")
    try:
        return h5py.File(path, "r")
    except DECODER_ERRORS as error:
        raise InputError(
            f"{path}: not a readable HDF5 file ({reason(error)}), expected a MATLAB 7.3 file"
        ) from error


def dataset_of(content: Any, name: str, file: Path) -> Any:
    """An array of an HDF5 file by its name, which may lead through groups.

    HDF5 lets names and arrays lie in other files, whatever those are: a data set could show what is on this machine.

    Raises:
        InputError: it is not there, it lies elsewhere, or one image of it is too large.
    """
    import h5py

    for part in name.split("/"):
        link = content.get(part, getlink=True) if isinstance(content, h5py.Group) else None
        if link is None:
            raise InputError(f"{file}: no {name} in it, expected the labeled dataset of NYU Depth v2")
        if not isinstance(link, h5py.HardLink):
            raise InputError(f"{file}: {name} is a link to elsewhere, expected the data in the file itself")
        content = content[part]
    return checked_array(content, name, file)


def checked_array(array: Any, name: str, file: Path) -> Any:
    """The array, if it lies in its own file and comes in pieces of moderate size.

    Raises:
        InputError: it does not.
    """
    import h5py

    if not isinstance(array, h5py.Dataset) or array.external or array.is_virtual:
        raise InputError(f"{file}: {name} lies in another file, expected the data in the file itself")
    pieces = (array.shape[1:] if array.ndim > 2 else array.shape, array.chunks or ())
    largest = max(math.prod(shape) for shape in pieces) * array.dtype.itemsize
    if largest > MAX_PIECE_BYTES:
        raise InputError(
            f"{file}: {name} has pieces of {largest:,} bytes, expected at most {MAX_PIECE_BYTES:,} an image"
        )
    return array


def read_mat(path: Path, name: str) -> Any:
    """One variable of a MATLAB file of before version 7.3.

    Raises:
        InputError: unreadable, too large, or without this variable.
    """
    check_plain(path, "a MATLAB file")
    check_mat_size(path)
    with reading(f"{path}: not a readable MATLAB file", "one of before version 7.3", MatReadError):
        content = scipy.io.loadmat(path, variable_names=[name], squeeze_me=True, struct_as_record=False)
    if name not in content:
        raise InputError(f"{path}: no variable {name!r} in it")
    return np.atleast_1d(content[name])


def check_mat_size(path: Path) -> None:
    """Look at what the variables of a MATLAB file of version 5 promise, packed ones too, before they are read.

    Raises:
        InputError: one is larger than MAX_MAT_BYTES; the file cannot be read.
    """
    try:
        with open(path, "rb") as file:
            head = file.read(128)
            order = {b"IM": "little", b"MI": "big"}.get(head[126:128])
            while order is not None and len(tag := file.read(8)) == 8:
                kind, size = (int.from_bytes(tag[k : k + 4], order) for k in (0, 4))  # type: ignore[arg-type]
                start = file.tell()
                promised = size
                if kind == _MAT_PACKED:
                    inner = zlib.decompressobj().decompress(file.read(min(size, 1 << 12)), 8)
                    promised = int.from_bytes(inner[4:8], order)  # type: ignore[arg-type]
                if promised > MAX_MAT_BYTES:
                    raise InputError(
                        f"{path}: a variable of {promised:,} bytes, expected at most {MAX_MAT_BYTES:,}"
                    )
                file.seek(start + size)
    except (OSError, ValueError, zlib.error) as error:
        raise InputError(f"{path}: not a readable MATLAB file ({error})") from error
