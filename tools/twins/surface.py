"""Slow twin of kernels/surface.py."""

import numpy as np

from dsmap.classes import NUM_CLASSES
from dsmap.kernels.surface import AGREE, RIM, UNKNOWN


def surface_distance(
    surfels: dict[str, np.ndarray], at: np.ndarray, side: float, spread: float, reach: float
) -> np.ndarray:
    """Signed distance to the surface at points, shape (N, 3); UNKNOWN where no surfel is near."""
    out = np.full(len(at), float(UNKNOWN))
    for item, x in enumerate(at.astype(np.float64)):
        near, w = _weights(surfels, x, spread, reach)
        if near < 0:
            continue
        away = x - surfels["position"]
        off = away[near] @ surfels["normal"][near]
        along = away[near] @ away[near] - off * off
        if along <= max(float(RIM) * surfels["radius"][near], side) ** 2 and w.sum() > 0:
            out[item] = (w * (away * surfels["normal"]).sum(axis=1)).sum() / w.sum()
    return out


def paint_points(
    surfels: dict[str, np.ndarray], at: np.ndarray, spread: float, reach: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normals, colours and classes of points, shapes (N, 3), (N, 3), (N,)."""
    normal, colour, label = np.zeros((len(at), 3)), np.zeros((len(at), 3)), np.zeros(len(at), np.uint8)
    for item, x in enumerate(at.astype(np.float64)):
        near, w = _weights(surfels, x, spread, reach)
        if near < 0:
            continue
        mean = w @ surfels["normal"]
        normal[item] = mean / np.linalg.norm(mean)
        colour[item] = w @ surfels["colour"] / w.sum()
        votes = np.bincount(surfels["label"], weights=w, minlength=NUM_CLASSES)[1:]
        label[item] = votes.argmax() + 1 if votes.max() > 0 else 0
    return normal, colour, label


def _weights(
    surfels: dict[str, np.ndarray], x: np.ndarray, spread: float, reach: float
) -> tuple[int, np.ndarray]:
    """The nearest surfel within reach (-1: none), and how much each surfel counts."""
    square = ((x - surfels["position"]) ** 2).sum(axis=1)
    near = int(square.argmin())
    if square[near] >= reach * reach:
        return -1, np.zeros(len(square))
    cosine = surfels["normal"] @ surfels["normal"][near]
    counts = (square < reach * reach) & (cosine > float(AGREE))
    return near, np.where(counts, surfels["weight"] * cosine * np.exp(-square / (2 * spread**2)), 0.0)
