"""Decoded training images in memory, and how often each class is among them."""

from collections.abc import Sequence

import numpy as np
from tqdm import tqdm

from dsmap.dsnet.datasets.base import Example, Item, LabelledSet

CACHE_BYTES = 6 * 2**30
"""Decoded images are kept in memory up to this many bytes; the rest is decoded whenever it is asked for."""


class LabelledImages:
    """The images of a data set, decoded once and kept in memory as far as `cache_bytes` reach.

    Every file is read on construction, so that damaged data shows before training begins.
    """

    def __init__(
        self,
        data: LabelledSet,
        *,
        with_geometry: bool = False,
        cache_bytes: int = CACHE_BYTES,
        progress: bool = True,
    ):
        self.items: Sequence[Item] = data.items
        self.class_names = data.class_names
        self.sizes = data.sizes or (len(data.items),)
        """Images of each of the data sets that were put together, in their order."""
        self.with_geometry = with_geometry
        self._cache: list[Example] = []
        self.fractions = np.zeros((len(data.items), len(data.class_names)), np.float32)
        """Share of each class in the pixels of each image, shape (images, classes)."""
        cached = 0
        for i, item in enumerate(tqdm(self.items, desc="reading images", disable=not progress, leave=False)):
            example = item.read(self.with_geometry)
            counts = np.bincount(example.label.ravel(), minlength=len(data.class_names))
            self.fractions[i] = counts / example.label.size
            arrays = (example.rgb, example.label, example.geometry)
            cached += sum(array.nbytes for array in arrays if array is not None)
            if cached <= cache_bytes:
                self._cache.append(example)

    def __len__(self) -> int:
        return len(self.items)

    def __getitem__(self, index: int) -> Example:
        if index < len(self._cache):
            return self._cache[index]
        return self.items[index].read(self.with_geometry)


def _chances(data: LabelledImages, shares: Sequence[float]) -> np.ndarray:
    """Chance of each image to be the one that is drawn, shape (images,); `shares` as in `drawn_shares`."""
    draws = np.array(shares if shares else data.sizes, float)
    return np.repeat(draws / draws.sum() / data.sizes, data.sizes)


def drawn_shares(data: LabelledImages, shares: Sequence[float] = ()) -> np.ndarray:
    """Share of each class in the labelled pixels that are drawn, shape (classes,); void has none.

    Args:
        shares: how often each set is drawn from; (): by its size.
    """
    # All images are resized to one size, so an image counts as one, whatever its own size.
    drawn = _chances(data, shares) @ data.fractions
    drawn[0] = 0
    return drawn / max(drawn.sum(), 1e-12)


def class_weights(
    data: LabelledImages, balance: str, shares: Sequence[float] = (), power: float = 1.0
) -> np.ndarray:
    """Weight of each class in the loss, float32, shape (classes,); void and classes never drawn weigh 0.

    Args:
        balance: `inverse` ((median share over share) ^ power, at most 10; with power 1 every class counts alike,
            as in the class average), `median` (median frequency balancing of Eigen and Fergus, at most 10:
            frequent in the images that show it), `log` (1 / log(1.02 + share), ENet) or `none`.
        shares: how often each set is drawn from; (): by its size. The weights are those of what is drawn.
    """
    drawn = drawn_shares(data, shares)
    seen = drawn > 0
    weights = np.zeros(len(seen), np.float32)
    share = drawn[seen]
    if not seen.any():  # nothing is labelled: a teacher has to know
        return weights
    if balance == "inverse":
        weights[seen] = np.minimum((np.median(share) / share) ** power, 10.0)
    elif balance == "median":
        frequency = share / (_chances(data, shares) @ (data.fractions > 0))[seen]
        weights[seen] = np.minimum(np.median(frequency) / frequency, 10.0)
    elif balance == "log":
        weights[seen] = 1 / np.log(1.02 + share)
    else:
        weights[seen] = 1
    return weights
