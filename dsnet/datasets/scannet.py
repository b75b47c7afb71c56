"""ScanNet: frames exported from the scans (`label-filt`), or the ready-made set `scannet_frames_25k`."""

from pathlib import Path

import numpy as np

from dsmap.classes import CLASS_NAMES, NYU40_TO_13
from dsmap.dsnet.datasets.base import FileItem, LabelledSet, read_list, require
from dsmap.dsnet.datasets.geometry import DepthView
from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sequences.label_sets import SCANNET_LABEL_MAP, scannet_table

_WIDTH, _HEIGHT = 640, 480
"""Of the depth images."""


def is_scannet(path: Path) -> bool:
    return path.is_dir() and any(path.glob("scene[0-9][0-9][0-9][0-9]_[0-9][0-9]"))


def load_scannet(path: Path, split: str | None) -> LabelledSet:
    """Frames of ScanNet scenes: `sceneNNNN_NN/{color/*.jpg, depth/*.png}` and labels, in one of two ways.

    `label-filt/*.png` holds ids of the label map (`scannetv2-labels.combined.tsv` in `path`), `label/*.png`
    NYU40 ids as in `scannet_frames_25k`. Colour and depth are resized to the label.

    Args:
        split: `train` or `val` by `scannetv2_train.txt` in `path`; None: all scenes.

    Raises:
        InputError: what is missing and where it comes from.
    """
    scenes = sorted(p for p in path.glob("scene????_??") if p.is_dir())
    if split is not None:
        names = set(
            read_list(path / f"scannetv2_{split}.txt", f"the list of {split} scenes of ScanNet's benchmark")
        )
        scenes = [scene for scene in scenes if scene.name in names]
    items: list[FileItem] = []
    table = None
    for scene in scenes:
        labels, ids = scene / "label", NYU40_TO_13
        if (scene / "label-filt").is_dir():
            labels = scene / "label-filt"
            if table is None:
                require(path / SCANNET_LABEL_MAP, f"the label map {SCANNET_LABEL_MAP} of ScanNet v2")
                table = scannet_table(path / SCANNET_LABEL_MAP)
            ids = table
        require(
            labels,
            f"the labels of {scene.name}: {scene.name}_2d-label-filt.zip, unpacked, or scannet_frames_25k",
        )
        items += [_item(scene, label, ids) for label in sorted(labels.glob("*.png"), key=_number)]
    if not items:
        raise InputError(f"{path}: no labelled frame, expected sceneNNNN_NN/label-filt/*.png or label/*.png")
    return LabelledSet(list(items), CLASS_NAMES, has_depth=all(item.view is not None for item in items))


def _item(scene: Path, label: Path, table: np.ndarray) -> FileItem:
    rgb = scene / "color" / f"{label.stem}.jpg"
    depth = scene / "depth" / f"{label.stem}.png"
    require(rgb, f"the colour image of {label} (exported from the .sens file of the scan)")
    require(depth, f"the depth image of {label} (exported from the .sens file of the scan)")
    return FileItem(
        rgb, label, depth, depth_scale=1000.0, table=table, same_size=False, view=_depth_view(scene)
    )


def _depth_view(scene: Path) -> DepthView | None:
    """The depth camera that the .sens file's exporter wrote beside the images, if it did."""
    for name in ("intrinsic/intrinsic_depth.txt", "intrinsics_depth.txt"):
        if (scene / name).is_file():
            try:
                K = np.loadtxt(scene / name)
                return DepthView(Intrinsics(_WIDTH, _HEIGHT, K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
            except (ValueError, IndexError) as error:
                raise InputError(
                    f"{scene / name}: found no matrix ({error}), expected 4x4 numbers"
                ) from error
    return None


def _number(path: Path) -> tuple[int, str]:
    return (int(path.stem) if path.stem.isdigit() else 0, path.stem)
