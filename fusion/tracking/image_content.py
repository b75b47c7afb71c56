"""What the colours of a frame are worth: do they hold anything, and is it news?

A lens that is covered, a light that goes out, a bare wall, a stream that hangs: there the depth is as good as ever,
while the image says nothing or, worse, something else. So an image has to show contrast before it is believed.
"""

import functools
from enum import Enum

import cv2
import numpy as np

FAINT = 0.006
"""Contrast below this (intensity in [0, 1]) is none: noise, compression, vignetting."""
_NOISE_LIKE = 0.15
"""Correlation of neighbouring pixels below which an image is noise."""
_DARK = 0.04
"""An image is dark if hardly any of it is brighter than this: its colours are not those of what it shows."""
_MIN_PIXELS = 50
_LOUD = 0.03
"""Noise from which an image is no picture of a bare wall [RMS, intensity in [0, 1]]."""


class Colours(Enum):
    """What the colours of a frame are good for."""

    GOOD = "good"
    PLAIN = "plain"
    """True, but without contrast: nothing can be tracked by them."""
    UNTRUE = "untrue"
    """Dark, nothing but noise, or of an earlier moment: not those of what the frame shows."""


def judged(image: np.ndarray, frozen: bool = False) -> Colours:
    """What an intensity image is good for, shape (H, W), in [0, 1]; frozen: it is an earlier frame's."""
    shown, noise = _contrast(image, None)
    if frozen or float(np.percentile(image, 95)) < _DARK or (shown == 0 and noise > _LOUD):
        return Colours.UNTRUE
    return Colours.GOOD if shown > FAINT else Colours.PLAIN


def contrast(image: np.ndarray, known: np.ndarray | None = None) -> float:
    """RMS of what an intensity image shows beyond even light and noise; 0 for nothing but noise.

    Light that falls off and a lens that darkens its corners are not contrast (a polynomial is taken off).

    Neighbouring pixels share what is in the image; their noise they have each for themselves.

    Args:
        image: intensity in [0, 1], shape (H, W).
        known: where it is valid, bool, shape (H, W); None: everywhere.
    """
    return _contrast(image, known)[0]


def _contrast(image: np.ndarray, known: np.ndarray | None) -> tuple[float, float]:
    """The contrast of an image, and the RMS of all that it shows beyond even light."""
    known = np.ones(image.shape, bool) if known is None else known
    if np.count_nonzero(known) < _MIN_PIXELS:
        return 0.0, 0.0
    smooth = _smooth_images(*image.shape)
    inside = smooth[:, known.ravel()]
    fit = np.linalg.lstsq(inside @ inside.T, inside @ image[known], rcond=None)[0]
    grain = (image - (fit @ smooth).reshape(image.shape)) * known
    power = float((grain * grain).sum() / np.count_nonzero(known))
    shared = 0.0
    for a, b in ((np.s_[:, 1:], np.s_[:, :-1]), (np.s_[1:], np.s_[:-1])):
        pairs = np.count_nonzero(known[a] & known[b])
        shared += 0.5 * float((grain[a] * grain[b]).sum()) / max(pairs, 1)
    return (float(np.sqrt(shared)) if shared > _NOISE_LIKE * power else 0.0), float(np.sqrt(power))


@functools.lru_cache(maxsize=8)
def _smooth_images(height: int, width: int) -> np.ndarray:
    """What light from one side and a lens that darkens its corners do to an image: shape (7, height * width)."""
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
    r2 = x * x + y * y
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y, r2 * r2]).reshape(7, -1).astype(np.float32)


def detail(image: np.ndarray, known: np.ndarray) -> np.ndarray:
    """An image, shape (H, W), without its local mean, which is taken where it is known; both of one shape."""
    weight = known.astype(np.float32)
    return image - cv2.boxFilter(image * weight, -1, window(known)) / share(weight)


def window(known: np.ndarray) -> tuple[int, int]:
    """Size of the neighbourhood [px] that tells what is local in an image: a tenth of its width."""
    return (2 * (known.shape[1] // 20) + 1,) * 2


def share(weight: np.ndarray) -> np.ndarray:
    """Share of what is known around every pixel, never 0."""
    return np.maximum(cv2.boxFilter(weight, -1, window(weight)), 1e-6)
