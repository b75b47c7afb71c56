"""Which way is up, and where the floor is, from the normals and the points of a view or of a map.

Rooms are mostly made of surfaces parallel and perpendicular to gravity (Gupta, Arbelaez and Malik, CVPR 2013).
"""

from dataclasses import dataclass

import numpy as np

LEVEL = (0.0, -1.0, 0.0)
"""Up in the frame of a camera that is held level: y points down."""
CAMERA_HEIGHT = 1.3
"""How high a camera is held where nothing says so [m]."""
_ANGLES_DEG = (45.0, 15.0)
"""Normals within this of up, or of the horizon, take part; the second value refines what the first one found."""
_ITERATIONS = 5
_PRIOR = 0.02
"""Weight of the start, as a share of the normals: it decides where they leave a choice (one wall fills the view)."""
_SAMPLES = 2500
_MIN_NORMALS = 50
_PARALLEL = 4.0
"""Weight of a normal parallel to up against one of a wall: there are more walls than floor, and a depth camera's far
walls lean (by 2.7 degrees against the floor in NYUv2), while heights need a floor that is level."""
FACES_UP = float(np.cos(np.deg2rad(25)))
"""Cosine to up from which a normal counts as that of a floor."""
_LEVEL_STEP = 0.05
"""Heights are counted in steps of this [m], two at a time."""
_LEVEL_SHARE = 0.01
"""A level is one from this share of the points."""
NOT_A_TABLE = 0.9
"""What lies this far below the camera [m] is a floor; nearer levels may be tables and beds."""
_CERTAIN = 0.1
"""From this share of normals that would disagree with any other up, it is the only choice."""
_BY_CHANCE = 0.3
"""Share of normals in all directions that lie within 15 degrees of any up or its horizon; twice this explains a view
well."""


@dataclass(frozen=True)
class Up:
    """An estimated direction of up."""

    direction: np.ndarray
    """Unit vector, float64, shape (3,)."""
    confidence: float
    """0: nothing but the start speaks for it; 1: most normals agree, and many would with no other direction."""


def sampled(image: np.ndarray, count: int = _SAMPLES) -> np.ndarray:
    """About `count` evenly spread vectors of a map, shape (H, W, 3) or (N, 3), that are not zero; shape (M, 3)."""
    if image.ndim == 3:
        step = max(int(np.sqrt(image.shape[0] * image.shape[1] / count)), 1)
        image = image[step // 2 :: step, step // 2 :: step]
        vectors = image.reshape(-1, 3)
    else:
        vectors = image[:: max(len(image) // count, 1)]
    return vectors[np.einsum("ij,ij->i", vectors, vectors) > 0].astype(np.float64)


def estimate_up(normals: np.ndarray, start: np.ndarray | tuple[float, float, float] = LEVEL) -> Up:
    """Up by alternation: which normals are parallel or perpendicular to it, and which direction fits them best.

    Minimises sum over perpendicular n of (n . g)^2 + sum over parallel n of 1 - (n . g)^2 (Gupta et al. 2013,
    section 3), plus a weak pull towards the start. It finds the up within about 45 degrees of the start.

    Args:
        normals: unit vectors, zero where there is none, shape (H, W, 3) or (N, 3), in any frame.
        start: where to begin, in the same frame; also the answer where there are too few normals.
    """
    start = np.asarray(start, np.float64) / np.linalg.norm(start)
    n = sampled(normals)
    if len(n) < _MIN_NORMALS:
        return Up(start, 0.0)
    up, values, across, along = start, np.zeros(3), n, n
    pull = _PRIOR * len(n) * (np.eye(3) - np.outer(start, start))
    for angle in np.deg2rad(_ANGLES_DEG):
        for _ in range(_ITERATIONS):
            cosine = np.abs(n @ up)
            across, along = n[cosine < np.sin(angle)], n[cosine > np.cos(angle)]
            values, vectors = np.linalg.eigh(across.T @ across - _PARALLEL * (along.T @ along) + pull)
            last, up = up, vectors[:, 0] * np.sign(vectors[:, 0] @ up or 1.0)
            if last @ up > 1 - 1e-10:
                break
    only_choice = ((values[1] - values[0]) / len(n) - _PRIOR) / _CERTAIN
    explained = ((len(across) + len(along)) / len(n) - _BY_CHANCE) / _BY_CHANCE
    return Up(up, float(np.clip(only_choice, 0.0, 1.0) * np.clip(explained, 0.0, 1.0)))


def estimate_floor(points: np.ndarray, normals: np.ndarray, up: np.ndarray) -> float:
    """Where the floor lies along up, seen from the camera [m]: the lowest level that enough points face up from.

    Where there is none, or it is so near the camera that it is more likely a table or a bed, the floor is taken to
    be CAMERA_HEIGHT below the camera, or at the lowest points (1 %) if those are lower.

    Args:
        points: in the camera's frame [m], zero where there is none, shape (H, W, 3).
        normals: unit vectors, zero where there is none, shape (H, W, 3).
        up: unit vector in the camera's frame, shape (3,).
    """
    step = max(int(np.sqrt(points.shape[0] * points.shape[1] / (2 * _SAMPLES))), 1)
    rows = slice(step // 2, None, step)
    points, normals = points[rows, rows].reshape(-1, 3), normals[rows, rows].reshape(-1, 3)
    there = points[:, 2] > 0
    if np.count_nonzero(there) < _MIN_NORMALS:
        return -CAMERA_HEIGHT
    heights = points[there] @ up
    level = lowest_level(heights, normals[there] @ up > FACES_UP)
    if level is not None and level < -NOT_A_TABLE:
        return level
    return min(float(np.percentile(heights, 1)), -CAMERA_HEIGHT)


def lowest_level(heights: np.ndarray, facing: np.ndarray) -> float | None:
    """The lowest height that enough of the points which face up share [m]; None where there is none.

    Args:
        heights: of all points [m], shape (N,).
        facing: which of them face up, bool, shape (N,).
    """
    bins = np.floor(heights[facing] / _LEVEL_STEP).astype(np.int64)
    first = bins.min(initial=0)
    counts = np.bincount(bins - first, minlength=2)
    enough = np.flatnonzero(counts[:-1] + counts[1:] >= max(_LEVEL_SHARE * len(heights), _MIN_NORMALS / 2))
    if len(enough) == 0:
        return None
    edge = (first + enough[0] + 1) * _LEVEL_STEP
    return float(np.median(heights[facing & (np.abs(heights - edge) < 2 * _LEVEL_STEP)]))
