"""The texture of images whose brightness and contrast may differ, and how it fits at other shifts."""

import cv2
import numpy as np

_FAINT = 0.01
"""Texture weaker than this (intensity in [0, 1]) is noise."""


def detail(image: np.ndarray, known: np.ndarray) -> np.ndarray:
    """An image, shape (H, W), without its local mean, which is taken where it is known; both of one shape."""
    weight = known.astype(np.float32)
    return image - cv2.boxFilter(image * weight, -1, _window(known)) / _share(weight)


def textured(image: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """An image without its local mean, its contrast made alike everywhere, 0 where unknown; and the weights."""
    weight = known.astype(np.float32)
    grain = detail(image, known) * weight
    power = cv2.boxFilter(grain * grain, -1, _window(known)) / _share(weight)
    return grain / np.sqrt(power + _FAINT**2), weight


def at_all_shifts(moving: np.ndarray, still: np.ndarray, reach: tuple[int, int]) -> np.ndarray:
    """Sum of products of two images at every shift of up to `reach` (y, x) [px]; no shift is in the middle.

    Returns:
        shape (2 y + 1, 2 x + 1).
    """
    y, x = reach
    around = cv2.copyMakeBorder(moving, y, y, x, x, cv2.BORDER_CONSTANT, value=0.0)
    return cv2.matchTemplate(around, still, cv2.TM_CCORR)


def _window(known: np.ndarray) -> tuple[int, int]:
    """Size of the neighbourhood [px] that tells what is local in an image: a tenth of its width."""
    return (2 * (known.shape[1] // 20) + 1,) * 2


def _share(weight: np.ndarray) -> np.ndarray:
    return np.maximum(cv2.boxFilter(weight, -1, _window(weight)), 1e-6)
