"""Points of interest of two images that show the same place (SIFT, compared as RootSIFT)."""

import cv2
import numpy as np

_RATIO = 0.75
"""Lowe's ratio: a match is kept if the second best is clearly worse."""


class Features:
    """SIFT keypoints and descriptors of a grey image, uint8 (H, W).

    Args:
        count: the strongest, at most.
        contrast: fainter points are left out (OpenCV's threshold).
    """

    def __init__(self, grey: np.ndarray, count: int = 500, contrast: float = 0.04):
        sift = cv2.SIFT_create(count, contrastThreshold=contrast)  # type: ignore[attr-defined]
        keypoints, descriptors = sift.detectAndCompute(grey, None)
        self.points = np.array([k.pt for k in keypoints], np.float32).reshape(-1, 2)
        """Pixels (x, y), shape (N, 2)."""
        if descriptors is None:
            descriptors = np.zeros((0, 128), np.float32)
        descriptors = descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-6)
        self.descriptors = np.sqrt(descriptors)
        """RootSIFT: of length 1, shape (N, 128)."""


def matched_points(a: Features, b: Features) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of `a` and their partners in `b`, shapes (M, 2); each point of `b` once. Some are wrong."""
    if min(len(a.points), len(b.points)) < 2:
        return a.points[:0], b.points[:0]
    similarity = a.descriptors @ b.descriptors.T  # normalised: distance^2 = 2 - 2 similarity
    best = similarity.argmax(axis=1)
    rows = np.arange(len(best))
    first = similarity[rows, best]
    similarity[rows, best] = -1
    distinct = np.sqrt(np.maximum(1 - first, 0)) < _RATIO * np.sqrt(
        np.maximum(1 - similarity.max(axis=1), 1e-9)
    )
    # Many points on one other point are a texture, not a view: keep one each.
    order = np.flatnonzero(distinct)[np.argsort(-first[distinct], kind="stable")]
    _, once = np.unique(best[order], return_index=True)
    chosen = order[once]
    return a.points[chosen], b.points[best[chosen]]
