"""`dsmap validation-split`: cut a validation set out of a series of labelled images, where views do not overlap."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import tyro
from tqdm import tqdm

from dsmap.classes import CLASS_NAMES, NUM_CLASSES
from dsmap.dsnet.datasets.registry import open_set
from dsmap.dsnet.datasets.view_overlap import choose_blocks, cuts, missing_before
from dsmap.errors import InputError
from dsmap.features import Features
from dsmap.files import atomic_path
from dsmap.ranges import Range, Seed

_SIZE = (320, 240)


@dataclass
class Args:
    data: tyro.conf.Positional[Path]
    """Folder of rgb/ and label/ whose images are named by numbers."""
    out: Path
    """Text file for the ranges of numbers, `first-last` a line."""
    images: Annotated[int, Range(1, 1_000_000)] = 92
    """About how many images to hold back."""
    blocks: Annotated[int, Range(1, 10_000)] = 8
    """In how many blocks of consecutive numbers."""
    seed: Seed = 0
    """Of the random choices of blocks that are compared."""


def main(args: Args) -> None:
    """Find the cuts, choose the blocks, write them, print how their classes are mixed."""
    numbers, free, class_pixels = survey(args.data)
    blocks = choose_blocks(free, class_pixels, args.images, args.blocks, args.seed)
    if not blocks:
        raise InputError(
            f"{args.data}: no {args.blocks} blocks of about {args.images} images, expected other numbers"
        )
    lines = [
        f"# Validation images of {args.data.name}: blocks of numbers, cut where no view is shared across.",
        f"# dsmap validation-split --images {args.images} --blocks {args.blocks} --seed {args.seed}",
        *[f"{numbers[first]}-{numbers[end - 1]}" for first, end in blocks],
    ]
    with atomic_path(args.out) as path:
        path.write_text("\n".join(lines) + "\n", encoding="ascii")
    held_back = np.zeros(len(numbers), bool)
    for first, end in blocks:
        held_back[first:end] = True
    parts = class_pixels[held_back].sum(axis=0), class_pixels[~held_back].sum(axis=0)
    print(f"{held_back.sum()} of {len(numbers)} images; {free.sum() - 1} groups without a common room")
    for name, val, train in zip(
        CLASS_NAMES[1:], *(100 * part / max(part.sum(), 1) for part in parts), strict=True
    ):
        print(f"  {name:<10} {val:5.2f} % of the validation set, {train:5.2f} % of the rest")
    print(f"written: {args.out}")


def survey(data: Path) -> tuple[list[int], np.ndarray, np.ndarray]:
    """Numbers of the images, where the series can be cut, labelled pixels of each class (images, 13).

    Raises:
        InputError: no labelled images, or names that are no numbers.
    """
    items = open_set(data).items
    stems = [Path(item.name).stem for item in items]
    if not all(stem.isdigit() for stem in stems):
        raise InputError(f"{data}: names like {stems[0]}, expected numbers")
    features, pixels = [], np.zeros((len(items), NUM_CLASSES))
    for i, item in enumerate(tqdm(items, unit="image")):
        example = item.read(with_geometry=False)
        grey = cv2.cvtColor(example.rgb, cv2.COLOR_RGB2GRAY)
        features.append(Features(cv2.resize(grey, _SIZE, interpolation=cv2.INTER_AREA)))
        pixels[i] = np.bincount(example.label.ravel(), minlength=NUM_CLASSES)
    numbers = [int(stem) for stem in stems]
    return numbers, cuts(features) & missing_before(numbers), pixels[:, 1:]
