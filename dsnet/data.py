"""Images with class labels: folders like NYUv2-13, recordings in the TUM layout, or folders of either."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from dsmap.classes import NUM_CLASSES
from dsmap.errors import InputError
from dsmap.sequences.images import read_colour, read_ids
from dsmap.sequences.tum import is_tum, read_tum

CACHE_BYTES = 3 * 2**30
"""Decoded images are kept in memory up to this many bytes; the rest is decoded whenever it is asked for."""
_IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png")


@dataclass(frozen=True)
class Pair:
    """A colour image and its class ids."""

    rgb: Path
    label: Path


def find_pairs(path: Path | str) -> list[Pair]:
    """Labelled images of a folder, in a fixed order.

    The folder is a recording in the TUM layout with `label.txt` (frames without labels are left out), or
    has `rgb/` and `label/*.png` with equal stems, or has sub-folders of these kinds.

    Raises:
        InputError: no such folder, or no labelled image in it.
    """
    path = Path(path)
    if not path.is_dir():
        raise InputError(f"{path}: no such folder, expected one with labelled images")
    pairs = _pairs_of(path)
    if pairs is None:
        found = [_pairs_of(child) for child in sorted(path.iterdir()) if child.is_dir()]
        pairs = [pair for part in found for pair in part or ()]
    if not pairs:
        raise InputError(
            f"{path}: no labelled image; expected rgb/ and label/ with equal stems, a recording with "
            "rgb.txt and label.txt, or sub-folders of these kinds"
        )
    return pairs


def _pairs_of(folder: Path) -> list[Pair] | None:
    """Labelled images of one folder; None if it is of neither kind."""
    if is_tum(folder):
        return [Pair(entry.rgb, entry.label) for entry in read_tum(folder).entries if entry.label]
    if not ((folder / "rgb").is_dir() and (folder / "label").is_dir()):
        return None
    images = {file.stem: file for file in (folder / "rgb").iterdir() if file.suffix in _IMAGE_SUFFIXES}
    labels = sorted((folder / "label").glob("*.png"))
    for label in labels:
        if label.stem not in images:
            raise InputError(f"{label}: no image of this stem in {folder / 'rgb'}, expected a jpg or png")
    return [Pair(images[label.stem], label) for label in labels]


def read_pair(pair: Pair) -> tuple[np.ndarray, np.ndarray]:
    """RGB, uint8 (H, W, 3), and class ids, uint8 (H, W).

    Raises:
        InputError: a file is missing or damaged, the sizes differ, or an id is no class.
    """
    rgb, label = read_colour(pair.rgb), read_ids(pair.label)
    if label.shape != rgb.shape[:2]:
        raise InputError(
            f"{pair.label}: size is {label.shape[1]}x{label.shape[0]}, "
            f"expected {rgb.shape[1]}x{rgb.shape[0]} as {pair.rgb.name}"
        )
    if label.max() >= NUM_CLASSES:
        raise InputError(f"{pair.label}: class id {label.max()} found, expected 0..{NUM_CLASSES - 1}")
    return rgb, label.astype(np.uint8)


class LabelledImages:
    """A list of (RGB, class ids), decoded once and kept in memory as far as `cache_bytes` reach.

    Every file is read on construction, so that damaged data shows before training begins.
    """

    def __init__(self, pairs: Sequence[Pair], *, cache_bytes: int = CACHE_BYTES, progress: bool = True):
        self.pairs = list(pairs)
        self._cache: list[tuple[np.ndarray, np.ndarray]] = []
        pixels, images = np.zeros(NUM_CLASSES), np.zeros(NUM_CLASSES)
        cached = 0
        for pair in tqdm(self.pairs, desc="reading images", disable=not progress, leave=False):
            rgb, label = read_pair(pair)
            counts = np.bincount(label.ravel(), minlength=NUM_CLASSES)
            pixels += counts
            images += (counts > 0) * label.size
            cached += rgb.nbytes + label.nbytes
            if cached <= cache_bytes and len(self._cache) < len(self.pairs):
                self._cache.append((rgb, label))
        self.class_pixels = pixels
        """Pixels of each class, shape (14,)."""
        self.class_frequency = pixels / np.maximum(images, 1)
        """Share of each class among the pixels of the images that show it, shape (14,)."""

    def __len__(self) -> int:
        return len(self.pairs)

    def __getitem__(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        if index < len(self._cache):
            return self._cache[index]
        return read_pair(self.pairs[index])


def class_weights(data: LabelledImages, balance: str) -> np.ndarray:
    """Weight of each class in the loss, float32, shape (14,); void and classes never seen weigh 0.

    Args:
        balance: `median` (median frequency balancing, at most 10), `log` (1 / log(1.02 + share), ENet) or
            `none`.
    """
    seen = data.class_pixels > 0
    seen[0] = False
    weights = np.zeros(NUM_CLASSES, np.float32)
    if balance == "median":
        frequency = data.class_frequency[seen]
        weights[seen] = np.minimum(np.median(frequency) / frequency, 10.0)
    elif balance == "log":
        share = data.class_pixels[seen] / data.class_pixels[seen].sum()
        weights[seen] = 1 / np.log(1.02 + share)
    else:
        weights[seen] = 1
    return weights
