"""Does depth belong to its colour image, or is one of the two mirrored? Told by the edges that both have."""

from collections.abc import Callable

import cv2
import numpy as np

from dsmap.errors import InputError
from dsmap.sequences import Sequence

_SAMPLES = 6
"""Frames that are compared."""
_STEP = 0.05
"""Depth that changes by this share from pixel to pixel is an edge."""
_LEAST_EDGES = 200
"""Pixels of an edge below which a frame says nothing."""
_MAX_GRADIENT = 200.0
"""Gradients of colour are cut here: a few strong edges do not decide."""
_NO_AGREEMENT, _AGREEMENT = 1.2, 1.3
"""Gradient of colour at edges of depth by that of the whole image. Of recordings it is 1.3 to 2, of images that have
nothing to do with each other 0.9 to 1.2."""
_CHANGES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "left and right": lambda image: image[:, ::-1],
    "upside down": lambda image: image[::-1],
    "turned by half a turn": lambda image: image[::-1, ::-1],
}


def mirror_warnings(sequence: Sequence) -> list[str]:
    """What is said where edges of depth lie on edges of colour only once it is mirrored or turned."""
    found = []
    for i in np.unique(np.linspace(0, len(sequence) - 1, _SAMPLES).astype(int)):
        try:
            frame = sequence.frame(int(i))
        except InputError:  # a damaged frame is left out of the map, too
            continue
        if (agreement := _agreement(frame.rgb, frame.depth)) is not None:
            found.append(agreement)
    if not found:
        return []
    as_is, *changed = np.mean(found, axis=0)
    best = int(np.argmax(changed))
    if as_is > _NO_AGREEMENT or changed[best] < _AGREEMENT:
        return []
    return [
        f"edges of depth lie on edges of colour only if one of them is mirrored ({list(_CHANGES)[best]}): depth and "
        "colour do not belong together as they are, and the map will be wrong"
    ]


def _agreement(rgb: np.ndarray, depth: np.ndarray) -> list[float] | None:
    """Gradient of colour at edges of depth as it is and under each change; None where there are few edges."""
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    gradient = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))
    gradient = np.minimum(gradient, _MAX_GRADIENT)
    kernel = np.ones((3, 3), np.uint8)
    # An edge of a hole is none.
    nearest = cv2.erode(np.where(depth > 0, depth, np.inf).astype(np.float32), kernel)
    farthest = cv2.dilate(depth.astype(np.float32), kernel)
    edges = np.isfinite(nearest) & (farthest - nearest > _STEP * nearest)
    if edges.sum() < _LEAST_EDGES or not gradient.mean() > 0:
        return None
    wide = cv2.dilate(edges.astype(np.uint8), kernel) > 0
    every = [wide, *(change(wide) for change in _CHANGES.values())]
    return [float(gradient[mask].mean() / gradient.mean()) for mask in every]
