"""One way to every data set with labelled images: `open_set("PATH")` finds out what lies there."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from dsmap.dsnet.datasets import folders, nyuv2, scannet, sunrgbd, unlabelled, voc
from dsmap.dsnet.datasets.base import FileItem, LabelledSet
from dsmap.errors import InputError
from dsmap.reading import reading
from dsmap.sequences.label_maps import load_label_map


@dataclass(frozen=True)
class DataLayout:
    """How a data set is recognised and read."""

    matches: Callable[[Path], bool]
    load: Callable[[Path, str | None], LabelledSet]
    about: str


LAYOUTS: dict[str, DataLayout] = {
    "nyuv2": DataLayout(
        nyuv2.is_nyuv2, nyuv2.load_nyuv2, "nyu_depth_v2_labeled.mat @trainval @train @val @test"
    ),
    "sunrgbd": DataLayout(sunrgbd.is_sunrgbd, sunrgbd.load_sunrgbd, "SUN RGB-D @train @test"),
    "scannet": DataLayout(scannet.is_scannet, scannet.load_scannet, "ScanNet frames @train @val"),
    "voc": DataLayout(voc.is_voc, voc.load_voc, "PASCAL VOC 2012 masks @train @val @trainval @trainaug"),
    "sbd": DataLayout(voc.is_sbd, voc.load_sbd, "Semantic Boundaries Dataset @train @val"),
    "folders": DataLayout(
        folders.is_folders, folders.load_folders, "rgb/ + label/, recordings, folders of these"
    ),
}
"""Name to layout, in the order in which they are tried."""


def open_set(spec: Path | str, label_map: str | None = None) -> LabelledSet:
    """A data set by its place: `PATH` or `PATH@SPLIT`; nothing is decoded yet. `RECORDING@unlabelled`: its frames.

    Args:
        label_map: which of the 13 classes a stored id or colour is (see `label_maps.load_label_map`), for folders of
            images and recordings; None: as the layout says.

    Raises:
        InputError: nothing is there, parts are missing, or there is no such split.
    """
    path, split = _parse(str(spec))
    with reading(path, "a data set of labelled images"):
        if not path.exists():
            raise InputError(f"{path}: no such folder, expected one with labelled images")
        if split == unlabelled.SPLIT:
            return unlabelled.load_unlabelled(path)
        for layout in LAYOUTS.values():
            if layout.matches(path):
                return _through(label_map, path, layout.load(path, split))
    raise InputError(f"{path}: no data set, expected a folder or nyu_depth_v2_labeled.mat")


def open_sets(specs: Sequence[Path | str], label_map: str | None = None) -> LabelledSet:
    """Several data sets as one.

    Raises:
        InputError: as `open_set`; sets of different classes.
    """
    sets = [open_set(spec, label_map) for spec in specs]
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


def _through(label_map: str | None, path: Path, found: LabelledSet) -> LabelledSet:
    """The same set, its labels read through a label map."""
    if label_map is None:
        return found
    plain = [i for i in found.items if isinstance(i, FileItem) and i.table is None]
    if len(plain) < len(found.items):
        raise InputError(f"{path}: --label-map {label_map}, but this data set has a label set of its own")
    mapping = load_label_map(label_map, path)
    return replace(found, items=[replace(item, label_map=mapping) for item in plain])
