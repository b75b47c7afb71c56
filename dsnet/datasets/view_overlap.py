"""Which labelled images show a common view, and a validation set cut where none do.

NYUv2 has several images of most rooms under neighbouring numbers: a random validation set would be seen in
training. Two images share a view if enough SIFT matches agree with one epipolar geometry. Views of one room
from its two ends escape that, so a series is cut only where its numbers leave a gap as well: the official
split gives a room wholly to training or to test, so what lies on the two sides of test images is not one room.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from dsmap.features import Features, matched_points

WINDOW = 8
"""Images are compared with this many followers: further away, the set shows other rooms."""
MIN_INLIERS = 10
"""Matches on one epipolar geometry from which on two images share a view."""


def matches(a: Features, b: Features) -> int:
    """Number of matches between two images that agree with one epipolar geometry."""
    points_a, points_b = matched_points(a, b)
    if len(points_a) < MIN_INLIERS:
        return 0
    cv2.setRNGSeed(0)
    _, mask = cv2.findFundamentalMat(points_a, points_b, cv2.FM_RANSAC, 1.5, 0.999)
    return 0 if mask is None else int(mask.sum())


def cuts(features: Sequence[Features]) -> np.ndarray:
    """Where the series can be cut: True at i if no image before i shares a view with one from i on.

    Returns:
        bool, shape (len(features) + 1,); both ends are True.
    """
    free = np.ones(len(features) + 1, bool)
    for i, a in enumerate(features):
        for j in range(i + 1, min(i + 1 + WINDOW, len(features))):
            if free[i + 1 : j + 1].any() and matches(a, features[j]) >= MIN_INLIERS:
                free[i + 1 : j + 1] = False
    return free


def missing_before(numbers: Sequence[int]) -> np.ndarray:
    """True at i if at least two numbers are missing before image i (one may be a lost training image).

    Returns:
        bool, shape (len(numbers) + 1,); both ends are True.
    """
    free = np.ones(len(numbers) + 1, bool)
    free[1:-1] = np.diff(numbers) > 2
    return free


def choose_blocks(
    free: np.ndarray, class_pixels: np.ndarray, total: int, blocks: int, seed: int = 0, trials: int = 200_000
) -> list[tuple[int, int]]:
    """Blocks of consecutive images whose classes are mixed as those of the whole set.

    Args:
        free: where the series can be cut (see `cuts` and `missing_before`), shape (n + 1,).
        class_pixels: labelled pixels of each class in each image, shape (n, classes), without void.
        total, blocks: about how many images, in how many blocks.

    Returns:
        (first, end) of each block, in order, by the largest ratio between a class's share in the blocks and
        in the set: the best of `trials` choices, the first half random, then the best so far with one block
        drawn anew. Empty if no choice fits.
    """
    rng = np.random.default_rng(seed)
    cut = np.flatnonzero(free)
    if len(cut) <= blocks:
        return []
    summed = np.vstack([np.zeros(class_pixels.shape[1]), class_pixels.cumsum(axis=0)])
    share = np.maximum(summed[-1] / summed[-1].sum(), 1e-9)
    best, chosen = np.inf, np.zeros((0, 2), np.int64)
    for trial in range(trials):
        drawn = rng.choice(len(cut) - 1, blocks, replace=False)
        ends = np.searchsorted(cut, cut[drawn] + total / blocks * rng.uniform(0.5, 1.2, blocks))
        pairs = np.stack([drawn, np.minimum(ends, len(cut) - 1)], axis=1)
        if trial > trials // 2 and len(chosen):
            one = rng.integers(blocks)
            pairs = np.where(np.arange(blocks)[:, None] == one, pairs, chosen)
        pairs = pairs[np.argsort(pairs[:, 0])]
        first, end = cut[pairs].T
        # Blocks apart from each other (two in a row would be one), none of them most of the set.
        apart = (pairs[1:, 0] > pairs[:-1, 1]).all() and (end - first).max() <= 2.5 * total / blocks
        if not apart or abs((end - first).sum() - total) > 2:
            continue
        pixels = (summed[end] - summed[first]).sum(axis=0)
        ratio = np.abs(np.log(np.maximum(pixels / pixels.sum(), 1e-9) / share)).max()
        if ratio < best:
            best, chosen = ratio, pairs
    return [(int(cut[a]), int(cut[b])) for a, b in chosen]
