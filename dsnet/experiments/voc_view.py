"""A training and a validation list over PASCAL VOC (and SBD), as a folder of links that `open_set` reads."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dsmap.dsnet.datasets.base import read_list
from dsmap.dsnet.datasets.registry import open_set
from dsmap.dsnet.datasets.voc import is_sbd, is_voc, sbd_root, voc_root
from dsmap.errors import InputError
from dsmap.files import atomic_path

HELD_BACK = 5
"""Where VOC's own lists are not there (samples of it), every fifth image is held back."""


@dataclass(frozen=True)
class VocView:
    """Where to train and to validate."""

    train: tuple[Path, ...]
    val: Path
    about: dict
    """Numbers of images, and whether VOC's own validation list was there."""


def voc_view(
    sources: Sequence[Path],
    out: Path,
    images: int | None = None,
    val_images: int | None = None,
    seed: int = 0,
) -> VocView:
    """Training images of VOC 2012 and, if it is among the sources, SBD, none of which is in the validation set.

    Args:
        sources: VOC first, then SBD or nothing. A VOC with `SegmentationClassAug` has SBD's masks already.
        out: gets the folders `voc` and `sbd` of links and lists.
        images, val_images: at most so many, chosen by `seed`; None: all.

    Raises:
        InputError: no VOC, other data, or `out` has links to other data.
    """
    if not sources or not is_voc(sources[0]):
        raise InputError(
            f"{', '.join(map(str, sources)) or 'no data'}: expected PASCAL VOC 2012 first, then SBD"
        )
    for source in sources[1:]:
        if not is_sbd(source):
            raise InputError(f"{source}: expected SBD (img/ and cls/) beside PASCAL VOC")
    root = (voc_root(sources[0]) or sources[0]).resolve()
    list_file = root / "ImageSets" / "Segmentation" / "val.txt"
    if list_file.exists():
        val = read_list(list_file, "a list of images")
        voc = [Path(item.name).stem for item in open_set(root).items]
    else:
        stems = [Path(item.name).stem for item in open_set(root).items]
        val = stems[HELD_BACK - 1 :: HELD_BACK]
        voc = [stem for stem in stems if stem not in set(val)]
    sbd_from = (sbd_root(sources[1]) or sources[1]).resolve() if len(sources) > 1 else None
    known = {*val, *voc}
    sbd = [] if sbd_from is None else [Path(item.name).stem for item in open_set(sbd_from).items]
    sbd = [stem for stem in sbd if stem not in known]
    rng = np.random.default_rng(seed)
    chosen = set(_some([*voc, *sbd], images, rng))
    val = _some(val, val_images, rng)
    train = [_write(out / "voc", root, ("JPEGImages", "SegmentationClassAug", "SegmentationClass"))]
    lists = out / "voc" / "ImageSets" / "Segmentation"
    _write_list(lists / "train.txt", [stem for stem in voc if stem in chosen])
    _write_list(lists / "val.txt", val)
    if sbd_from is not None and chosen.intersection(sbd):
        train.append(_write(out / "sbd", sbd_from, ("img", "cls")))
        _write_list(out / "sbd" / "train.txt", [stem for stem in sbd if stem in chosen])
    about = {"train_images": len(chosen), "val_images": len(val), "official_val": list_file.exists()}
    return VocView(tuple(Path(f"{folder}@train") for folder in train), Path(f"{out / 'voc'}@val"), about)


def _some(stems: Sequence[str], count: int | None, rng: np.random.Generator) -> list[str]:
    if count is None or count >= len(stems):
        return list(stems)
    return [stems[int(i)] for i in sorted(rng.permutation(len(stems))[:count])]


def _write(folder: Path, root: Path, names: Sequence[str]) -> Path:
    """Links to those sub-folders of `root` that are there."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        link, target = folder / name, root / name
        if link.is_symlink() and link.readlink() != target:
            raise InputError(f"{link}: leads to {link.readlink()}, expected {target} as now or a new --out")
        if target.is_dir() and not link.is_symlink():
            link.symlink_to(target)
    return folder


def _write_list(path: Path, stems: Sequence[str]) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text("".join(f"{stem}\n" for stem in stems), encoding="utf-8")
