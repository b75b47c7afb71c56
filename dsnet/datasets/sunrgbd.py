"""SUN RGB-D: the official tree with its toolbox, or the flat folders of the "sunrgbd-meta-data" collection.

The 37 classes are the first 37 of NYU40 in the same order, so both map to ours by `NYU40_TO_13`.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dsmap.classes import CLASS_NAMES, NYU40_TO_13
from dsmap.dsnet.datasets.base import Example, FileItem, Item, LabelledSet, guarded, require, to_classes
from dsmap.dsnet.datasets.nyuv2 import checked_array, dataset_of, open_hdf5, read_mat
from dsmap.errors import InputError
from dsmap.sequences.images import read_colour

SUN37_TO_13 = NYU40_TO_13[:38]
"""SUN RGB-D's 37 classes (0 = unlabelled) to ours."""
_ROOT = "/n/fs/sun3d/data/"
"""What the authors' lists of files begin with."""
_TEST_IMAGES = 5050
"""In the flat folders the 37-class labels count on from the test images to the training images."""


def is_sunrgbd(path: Path) -> bool:
    return (path / "SUNRGBDtoolbox").is_dir() or any(path.glob("SUNRGBD-*_images"))


def load_sunrgbd(path: Path, split: str | None) -> LabelledSet:
    """SUN RGB-D in either layout.

    Args:
        path: folder with SUNRGBD/ and SUNRGBDtoolbox/, or with SUNRGBD-train_images/ and train13labels/
            (or sunrgbd_train_test_labels/, 37 classes), likewise test.
        split: `train` (default) or `test`.

    Raises:
        InputError: an unknown split, or what is missing and where it comes from.
    """
    split = split or "train"
    if split not in ("train", "test"):
        raise InputError(f"{path}: split is {split!r}, expected train or test")
    if (path / "SUNRGBDtoolbox").is_dir():
        return LabelledSet(_official(path, split), CLASS_NAMES)
    return LabelledSet(_flat(path, split), CLASS_NAMES)


def _flat(path: Path, split: str) -> list[Item]:
    images = require(
        path / f"SUNRGBD-{split}_images", f"SUNRGBD-{split}_images.tgz of sunrgbd-meta-data, unpacked"
    )
    labels13, labels37 = path / f"{split}13labels", path / "sunrgbd_train_test_labels"
    if not labels13.is_dir():
        require(
            labels37, f"labels: {labels13.name}.tgz or {labels37.name}.tar.gz of sunrgbd-meta-data, unpacked"
        )
    items: list[Item] = []
    for image in sorted(images.glob("img-*.jpg")):
        number = int(image.stem.removeprefix("img-"))
        if labels13.is_dir():
            label, table = labels13 / f"img13labels-{number:06}.png", None
        else:
            offset = _TEST_IMAGES if split == "train" else 0
            label, table = labels37 / f"img-{number + offset:06}.png", SUN37_TO_13
        items.append(FileItem(image, require(label, f"the label of {image.name}"), table=table))
    if not items:
        raise InputError(f"{images}: no image, expected img-000001.jpg and so on")
    return items


@dataclass(frozen=True, eq=False)
class ToolboxItem:
    """One image of the official tree, its label in SUNRGBD2Dseg.mat."""

    rgb: Path
    labels: Path
    index: int
    """Position in SUNRGBDMeta.mat, and so in the labels; from 0."""

    @property
    def name(self) -> str:
        return f"{self.labels}:{self.index + 1}"

    @guarded
    def read(self, with_geometry: bool = True) -> Example:
        content = open_hdf5(self.labels)
        try:
            references = dataset_of(content, "SUNRGBD2Dseg/seglabel", self.labels)
            labels = checked_array(content[np.ravel(references[self.index])[0]], "seglabel", self.labels)
            stored = np.asarray(labels).T  # MATLAB's order, reversed
        except (KeyError, OSError, ValueError, IndexError, AttributeError) as error:
            raise InputError(f"{self.name}: damaged ({error!r}), expected SUNRGBD2Dseg.seglabel") from error
        rgb = read_colour(self.rgb)
        if stored.shape != rgb.shape[:2]:
            raise InputError(
                f"{self.name}: size is {stored.shape[::-1]}, expected {rgb.shape[1::-1]} as {self.rgb}"
            )
        return Example(rgb, to_classes(stored, SUN37_TO_13, len(CLASS_NAMES), self.name))


def _official(path: Path, split: str) -> list[Item]:
    toolbox = path / "SUNRGBDtoolbox"
    from_page = "of SUNRGBDtoolbox.zip of the SUN RGB-D page"
    meta = read_mat(
        require(toolbox / "Metadata" / "SUNRGBDMeta.mat", f"the list of images {from_page}"), "SUNRGBDMeta"
    )
    labels = require(toolbox / "Metadata" / "SUNRGBD2Dseg.mat", f"the labels in 37 classes {from_page}")
    listed = read_mat(
        require(toolbox / "traintestSUNRGBD" / "allsplit.mat", f"the official split {from_page}"),
        f"all{split}",
    )
    chosen = {_relative(str(name)) for name in listed.ravel()}
    require(path / "SUNRGBD", "the images: SUNRGBD.zip of the SUN RGB-D page, unpacked")
    items: list[Item] = []
    for index, record in enumerate(meta.ravel()):
        folder = _relative(_field(record, "rgbpath", toolbox)).rpartition("/image/")[0]
        if folder in chosen:
            items.append(
                ToolboxItem(path / folder / "image" / _field(record, "rgbname", toolbox), labels, index)
            )
    if not items:
        raise InputError(f"{toolbox}: no image of SUNRGBDMeta.mat is in all{split} of allsplit.mat")
    for item in items:
        if isinstance(item, ToolboxItem) and not item.rgb.exists():
            raise InputError(
                f"{item.rgb}: not there, expected all images of SUNRGBD.zip of the SUN RGB-D page"
            )
    return items


def _relative(name: str) -> str:
    """`/n/fs/sun3d/data/SUNRGBD/kv1/...` as a path below the folder of the set."""
    return os.path.normpath(name.removeprefix(_ROOT).lstrip("/"))


def _field(record: Any, name: str, toolbox: Path) -> str:
    value = getattr(record, name, None)
    if not isinstance(value, str):
        raise InputError(f"{toolbox}: SUNRGBDMeta.mat has a record without {name}")
    return value
