"""The validation set that is cut out of NYUv2's training images, by committed ranges of numbers."""

from collections.abc import Collection, Sequence
from pathlib import Path

NYUV2_VALIDATION = Path(__file__).parents[1] / "splits" / "nyuv2_13_val.txt"
"""Ranges `first-last` of numbers in the official .mat file (from 1); made by `dsmap validation-split`."""


def validation_numbers(path: Path = NYUV2_VALIDATION) -> set[int]:
    """All numbers within the ranges: the few images that are missing between them count as validation."""
    numbers: set[int] = set()
    for line in path.read_text(encoding="ascii").splitlines():
        if line and not line.startswith("#"):
            first, last = line.split("-")
            numbers |= set(range(int(first), int(last) + 1))
    return numbers


def select(numbers: Sequence[int], split: str, validation: Collection[int]) -> list[int]:
    """Positions of the images of `train` or `val`."""
    return [i for i, number in enumerate(numbers) if (number in validation) == (split == "val")]
