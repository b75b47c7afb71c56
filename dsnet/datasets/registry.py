"""One way to every data set with labelled images: `open_set("PATH")` finds out what lies there."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from dsmap.dsnet.datasets import folders, nyuv2, scannet, sunrgbd, unlabelled, voc
from dsmap.dsnet.datasets.base import LabelledSet
from dsmap.errors import InputError


@dataclass(frozen=True)
class Layout:
    """How a data set is recognised and read."""

    matches: Callable[[Path], bool]
    load: Callable[[Path, str | None], LabelledSet]
    about: str


LAYOUTS: dict[str, Layout] = {
    "nyuv2": Layout(nyuv2.is_nyuv2, nyuv2.load_nyuv2, "nyu_depth_v2_labeled.mat @trainval @train @val @test"),
    "sunrgbd": Layout(sunrgbd.is_sunrgbd, sunrgbd.load_sunrgbd, "SUN RGB-D @train @test"),
    "scannet": Layout(scannet.is_scannet, scannet.load_scannet, "ScanNet frames @train @val"),
    "voc": Layout(voc.is_voc, voc.load_voc, "PASCAL VOC 2012 masks @train @val @trainval @trainaug"),
    "sbd": Layout(voc.is_sbd, voc.load_sbd, "Semantic Boundaries Dataset @train @val"),
    "folders": Layout(
        folders.is_folders, folders.load_folders, "rgb/ + label/, recordings, folders of these"
    ),
}
"""Name to layout, in the order in which they are tried."""


def open_set(spec: Path | str) -> LabelledSet:
    """A data set by its place: `PATH` or `PATH@SPLIT`; nothing is decoded yet. `RECORDING@unlabelled`: its frames.

    Raises:
        InputError: nothing is there, parts are missing, or there is no such split.
    """
    path, split = _parse(str(spec))
    if not path.exists():
        raise InputError(f"{path}: no such folder, expected one with labelled images")
    if split == unlabelled.SPLIT:
        return unlabelled.load_unlabelled(path)
    for layout in LAYOUTS.values():
        if layout.matches(path):
            return layout.load(path, split)
    raise InputError(f"{path}: no data set, expected a folder or nyu_depth_v2_labeled.mat")


def open_sets(specs: Sequence[Path | str]) -> LabelledSet:
    """Several data sets as one.

    Raises:
        InputError: as `open_set`; sets of different classes.
    """
    sets = [open_set(spec) for spec in specs]
    for spec, part in zip(specs, sets, strict=True):
        if part.class_names != sets[0].class_names:
            raise InputError(
                f"{spec}: classes are {', '.join(part.class_names)}, expected those of {specs[0]}: "
                f"{', '.join(sets[0].class_names)}"
            )
    items = [item for part in sets for item in part.items]
    sizes = tuple(len(part.items) for part in sets)
    return LabelledSet(items, sets[0].class_names, all(part.has_depth for part in sets), sizes)


def _parse(spec: str) -> tuple[Path, str | None]:
    place, at, split = spec.rpartition("@")
    if not at or not place or not split or "/" in split or Path(spec).exists():
        return Path(spec), None
    return Path(place), split
