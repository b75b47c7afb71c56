"""Folders of images and labels, recordings in the TUM layout (rendered sets), and folders of either."""

from collections.abc import Sequence
from pathlib import Path

from dsmap.classes import CLASS_NAMES
from dsmap.dsnet.datasets.base import FileItem, Item, LabelledSet
from dsmap.dsnet.datasets.geometry import DepthView
from dsmap.dsnet.datasets.splits import select, validation_numbers
from dsmap.errors import InputError
from dsmap.sequences.calibration import read_calibration
from dsmap.sequences.images import Source
from dsmap.sequences.tum import is_tum, read_tum

_IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png")


def is_folders(path: Path) -> bool:
    """Anything that is a folder: the layout that is tried last."""
    return path.is_dir()


def load_folders(path: Path, split: str | None) -> LabelledSet:
    """Labelled images of a folder, in a fixed order.

    The folder is a recording in the TUM layout with `label.txt` (frames without labels are left out), or
    has `rgb/` and `label/*.png` with equal stems, or has sub-folders of these kinds.

    Args:
        split: a sub-folder of this name, or for numbered images of NYUv2 `train` | `val` of the list that
            comes with dsmap.

    Raises:
        InputError: no labelled image, or no such split.
    """
    if split is not None and (path / split).is_dir():
        path, split = path / split, None
    items = _items_of(path)
    if items is None:
        found = [_items_of(child) for child in sorted(path.iterdir()) if child.is_dir()]
        items = [item for part in found for item in part or ()]
    if not items:
        raise InputError(
            f"{path}: no labelled image; expected rgb/ and label/ with equal stems, a recording with "
            "rgb.txt and label.txt, sub-folders of these kinds, or one of the data sets that "
            "docs/guide/data_sets.md lists"
        )
    has_depth = all(item.view is not None for item in items)
    chosen: Sequence[Item] = items if split is None else _split(path, items, split)
    return LabelledSet(list(chosen), CLASS_NAMES, has_depth)


def is_rendered(folder: Path) -> bool:
    """Whether a recording comes from `dsmap render-scene`, whose worlds stand on z = 0, z up."""
    return (folder / "scene.json").is_file()


def _items_of(folder: Path) -> list[FileItem] | None:
    """Labelled images of one folder; None if it is of neither kind."""
    if is_tum(folder):
        return _recording(folder)
    if not ((folder / "rgb").is_dir() and (folder / "label").is_dir()):
        return None
    images = {file.stem: file for file in (folder / "rgb").iterdir() if file.suffix in _IMAGE_SUFFIXES}
    labels = sorted((folder / "label").glob("*.png"))
    for label in labels:
        if label.stem not in images:
            raise InputError(f"{label}: no image of this stem in {folder / 'rgb'}, expected a jpg or png")
    return [_item(folder, images[label.stem], label) for label in labels]


def _item(folder: Path, rgb: Path, label: Path) -> FileItem:
    """With depth, if `depth/` has an image of this stem and calibration.yaml says of which camera."""
    depth = folder / "depth" / f"{label.stem}.png"
    stored = read_calibration(folder) if depth.is_file() else None
    if stored is None or stored.color_camera is not None:
        return FileItem(rgb, label)
    return FileItem(rgb, label, depth, stored.depth_scale, view=DepthView(stored.intrinsics))


def _file(image: Source) -> Path:
    assert isinstance(image, Path), "the TUM layout has a file for every image"
    return image


def _recording(folder: Path) -> list[FileItem]:
    """Labelled frames; with depth if the recording says its unit and colour and depth are one camera's."""
    entries = [entry for entry in read_tum(folder).entries if entry.label]
    stored = read_calibration(folder)
    if stored is None or stored.color_camera is not None or stored.T_color_depth is not None:
        return [FileItem(_file(entry.rgb), _file(entry.label)) for entry in entries if entry.label]
    rendered = is_rendered(folder)
    found = []
    for entry in entries:
        if entry.label:
            view = DepthView.of_pose(stored.intrinsics, entry.T_world_camera if rendered else None)
            rgb, label, depth = _file(entry.rgb), _file(entry.label), _file(entry.depth)
            found.append(FileItem(rgb, label, depth, stored.depth_scale, view=view))
    return found


def _split(path: Path, items: list[FileItem], split: str) -> list[FileItem]:
    if not all(item.label.stem.isdigit() for item in items):
        raise InputError(f"{path}: no sub-folder {split!r}, expected one, or images named by NYUv2's numbers")
    if split not in ("train", "val"):
        raise InputError(f"{path}: split is {split!r}, expected train or val")
    numbers = [int(item.label.stem) for item in items]
    return [items[i] for i in select(numbers, split, validation_numbers())]
