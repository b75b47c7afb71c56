"""PASCAL VOC 2012 masks, and those of SBD (Hariharan et al. 2011), which add training images to them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dsmap.dsnet.datasets.base import (
    VOC_CLASS_NAMES,
    Example,
    FileItem,
    Item,
    LabelledSet,
    guarded,
    read_list,
    require,
    to_classes,
    voc_table,
)
from dsmap.dsnet.datasets.nyuv2 import read_mat
from dsmap.errors import InputError
from dsmap.sequences.images import read_colour

_MASKS = ("SegmentationClassAug", "SegmentationClass")
_VOC_PAGE = "VOCtrainval_11-May-2012.tar of the PASCAL VOC 2012 page"


def voc_root(path: Path) -> Path | None:
    """The folder with JPEGImages in it: `path`, `path/VOC2012` or `path/VOCdevkit/VOC2012`."""
    folders = (path, path / "VOC2012", path / "VOCdevkit" / "VOC2012")
    return next((f for f in folders if (f / "JPEGImages").is_dir()), None)


def sbd_root(path: Path) -> Path | None:
    """The folder with SBD's cls/ in it."""
    folders = (path, path / "dataset", path / "benchmark_RELEASE" / "dataset", path / "SBD")
    return next((f for f in folders if (f / "cls").is_dir() and (f / "img").is_dir()), None)


def is_voc(path: Path) -> bool:
    return voc_root(path) is not None


def is_sbd(path: Path) -> bool:
    return sbd_root(path) is not None


def load_voc(path: Path, split: str | None) -> LabelledSet:
    """Masks of VOC 2012, `SegmentationClassAug` (VOC + SBD as indices) before `SegmentationClass`.

    Args:
        split: a list of ImageSets/Segmentation (`train`, `val`, `trainval`, `trainaug`); None: every mask
            but, if its list is there, those of `val`.

    Raises:
        InputError: what is missing and where it comes from.
    """
    root = voc_root(path) or path
    masks = next((root / name for name in _MASKS if (root / name).is_dir()), None)
    if masks is None:
        raise InputError(f"{root}: no SegmentationClass, expected {_VOC_PAGE}, unpacked")
    lists = root / "ImageSets" / "Segmentation"
    if split is not None:
        stems = read_list(lists / f"{split}.txt", f"a list of images, of {_VOC_PAGE}")
    else:
        held_back = lists / "val.txt"
        validation = set(read_list(held_back, "a list of images") if held_back.exists() else ())
        stems = [mask.stem for mask in sorted(masks.glob("*.png")) if mask.stem not in validation]
    if not stems:
        raise InputError(f"{masks}: no mask, expected PNG images of {_VOC_PAGE}")
    table = voc_table()
    items: list[Item] = []
    for stem in stems:
        rgb = require(
            root / "JPEGImages" / f"{stem}.jpg", f"the image of {masks.name}/{stem}.png, of {_VOC_PAGE}"
        )
        mask = require(masks / f"{stem}.png", f"a mask of {_VOC_PAGE}")
        items.append(FileItem(rgb, mask, table=table, num_classes=len(VOC_CLASS_NAMES)))
    return LabelledSet(items, VOC_CLASS_NAMES)


@dataclass(frozen=True, eq=False)
class SbdItem:
    """One image of SBD, its mask in a MATLAB file."""

    rgb: Path
    mask: Path

    @property
    def name(self) -> str:
        return str(self.mask)

    @guarded
    def read(self, with_geometry: bool = True) -> Example:
        rgb = read_colour(self.rgb)
        record = read_mat(self.mask, "GTcls").ravel()[0]
        stored = np.asarray(getattr(record, "Segmentation", None))
        if stored.shape != rgb.shape[:2]:
            raise InputError(f"{self.mask}: GTcls.Segmentation is {stored.shape}, expected {rgb.shape[:2]}")
        return Example(rgb, to_classes(stored, voc_table(), len(VOC_CLASS_NAMES), self.name))


def load_sbd(path: Path, split: str | None) -> LabelledSet:
    """SBD's own archive: `img/*.jpg`, `cls/*.mat`, `train.txt`, `val.txt`.

    Args:
        split: `train` or `val` of SBD; None: all. (Its images overlap with VOC's validation set: the usual
            training set is SegmentationClassAug without them, which `load_voc` reads.)
    """
    root = sbd_root(path) or path
    archive = "benchmark.tgz of the Semantic Boundaries Dataset page"
    if split is None:
        stems = [mask.stem for mask in sorted((root / "cls").glob("*.mat"))]
    else:
        stems = read_list(root / f"{split}.txt", f"a list of images, of {archive}")
    if not stems:
        raise InputError(f"{root / 'cls'}: no mask, expected .mat files of {archive}")
    items: list[Item] = []
    for stem in stems:
        rgb = require(root / "img" / f"{stem}.jpg", f"the image of cls/{stem}.mat, of {archive}")
        items.append(SbdItem(rgb, require(root / "cls" / f"{stem}.mat", f"a mask of {archive}")))
    return LabelledSet(items, VOC_CLASS_NAMES)
