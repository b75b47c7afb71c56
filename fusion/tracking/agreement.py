"""How a frame and the model agree over the whole image: depths, colours, and textures as they are and shifted."""

from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
import warp as wp

from dsmap.fusion.config import RelocaliseConfig
from dsmap.fusion.tracking.image_content import FAINT, contrast, detail, share, window
from dsmap.kernels.types import FrameMaps

_RIVAL_WIDTH = 160
"""Shifts are tried on images this wide [px]."""
_FARTHEST = 0.4
"""Largest shift, as a share of the image's size."""
_LEAST_SHARED = 0.4
"""Shifts that leave less than this share of the common pixels are not considered."""
_WINDOW = np.ones((3, 3), np.uint8)
_GRAIN = 0.01
"""Texture weaker than this (intensity in [0, 1]) is noise."""


@dataclass
class Agreement:
    """How a frame and the model view at its pose agree, over the whole image."""

    overlap: float
    """Share of the frame's pixels with depth where the model has a surface."""
    same: float
    """Of these, the share whose depths agree."""
    seen_through: float
    """Of these, the share where the frame looks through the model's surface: that surface cannot be there."""
    ncc: float
    """Normalised cross-correlation of the intensities where depths agree, -1..1; brightness and contrast cancel."""
    texture: float
    """The same with contrast made alike everywhere: grain counts as much as outlines."""
    rival: float
    """What `texture` gains if the image is shifted by up to two fifths of its size: true poses gain nothing."""
    coloured: bool = True
    """Whether both images show anything by their colours; if not, `ncc`, `texture` and `rival` tell nothing."""


def agreement(frame: FrameMaps, vertex: wp.array, intensity: wp.array, config: RelocaliseConfig) -> Agreement:
    """Compare a frame with the model rendered from the frame's own pose, pixel by pixel.

    A depth agrees if it lies between the nearest and the farthest model depth of its 3x3 pixels, give or
    take the sensor's noise: a pixel's shift at an edge is no disagreement.

    Args:
        frame: of any pyramid level.
        vertex, intensity: of the model, at the same level.
    """
    skip = max(frame.vertex.shape[1] // 320, 1)
    z = frame.vertex.numpy()[::skip, ::skip, 2]
    model_z = np.asarray(vertex.numpy()[::skip, ::skip, 2], np.float32)
    known = model_z > 0
    farthest = cv2.dilate(model_z, _WINDOW)
    nearest = cv2.erode(np.where(known, model_z, np.float32(1e3)), _WINDOW)
    slack = config.slack + config.slack_z2 * z * z
    both = (z > 0) & known
    through = both & (z > farthest + slack)
    same = both & ~through & (z > nearest - slack)
    # Rims of things, which a sensor tears, are thin; a surface that is not there is not.
    through = cv2.morphologyEx(through.astype(np.uint8), cv2.MORPH_OPEN, _WINDOW)
    total = max(np.count_nonzero(both), 1)
    light, model_light = (image.numpy()[::skip, ::skip] for image in (frame.intensity, intensity))
    texture, rival = texture_match(light, model_light, same)
    coloured = min(contrast(light, same), contrast(model_light, same)) > FAINT
    return Agreement(
        overlap=float(np.count_nonzero(both) / max(np.count_nonzero(z > 0), 1)),
        same=float(np.count_nonzero(same) / total),
        seen_through=float(np.count_nonzero(through) / total),
        ncc=correlation(light, model_light, same),
        texture=texture,
        rival=rival,
        coloured=coloured,
    )


def reason_to_reject_pose(found: Agreement, config: RelocaliseConfig, by_colour: bool = True) -> str:
    """Why a pose is not believed, in words; empty if it is.

    by_colour: the frame's colours are to be believed. Where they, or those of the model, show nothing, depth decides.
    """
    by_colour = by_colour and found.coloured
    reasons = [
        (found.overlap < config.min_overlap, f"the model covers only {found.overlap:.0%} of the depth image"),
        (
            found.seen_through > config.max_seen_through,
            f"{found.seen_through:.0%} of the model is seen through",
        ),
        (found.same < config.min_same, f"only {found.same:.0%} of the depths agree with the model"),
        (by_colour and found.ncc < config.min_ncc, f"the colours do not correlate ({found.ncc:.2f})"),
        (
            by_colour and found.texture < config.min_texture,
            f"the texture does not correlate ({found.texture:.2f})",
        ),
        (
            by_colour and found.rival > config.max_rival,
            f"shifted, the colours correlate better (by {found.rival:.2f})",
        ),
    ]
    return next((text for bad, text in reasons if bad), "")


def correlation(a: np.ndarray, b: np.ndarray, mask: np.ndarray) -> float:
    """Correlation of two intensity images within a mask, after the local mean is taken off both.

    Without that, any bright wall over any dark floor would correlate.
    """
    a, b = (detail(image, mask)[mask] for image in (a, b))
    norm = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / norm if norm > 1e-9 else 0.0


def texture_match(a: np.ndarray, b: np.ndarray, mask: np.ndarray) -> tuple[float, float]:
    """Correlation of two images' texture as they are, and how much it grows at most if one is shifted.

    On a wall, a door or a blind with a repeated pattern registration may settle one repetition off. Contrast
    is made the same everywhere, or a door's frame would outweigh the grain of its wood.
    """
    scale = min(_RIVAL_WIDTH / a.shape[1], 1.0)
    images = [cv2.resize(i, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) for i in (a, b)]
    mask = cv2.resize(mask.astype(np.uint8), images[0].shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    (a, weight), (b, _) = (textured(image, mask) for image in images)
    reach = y, x = int(_FARTHEST * mask.shape[0]), int(_FARTHEST * mask.shape[1])
    shifted = partial(at_all_shifts, reach=reach)
    power = shifted(b * b, weight) * shifted(weight, a * a)
    enough = shifted(weight, weight) > _LEAST_SHARED * weight.sum()
    gain = np.where(enough & (power > 1e-9), shifted(b, a) / np.sqrt(np.maximum(power, 1e-9)), 0.0)
    here = float(gain[y - 1 : y + 2, x - 1 : x + 2].max())
    return here, max(float(gain.max()) - here, 0.0)


def textured(image: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """An image without its local mean, its contrast made alike everywhere, 0 where unknown; and the weights."""
    weight = known.astype(np.float32)
    grain = detail(image, known) * weight
    power = cv2.boxFilter(grain * grain, -1, window(known)) / share(weight)
    return grain / np.sqrt(power + _GRAIN**2), weight


def at_all_shifts(moving: np.ndarray, still: np.ndarray, reach: tuple[int, int]) -> np.ndarray:
    """Sum of products of two images at every shift of up to `reach` (y, x) [px]; no shift is in the middle.

    Returns:
        shape (2 y + 1, 2 x + 1).
    """
    y, x = reach
    around = cv2.copyMakeBorder(moving, y, y, x, x, cv2.BORDER_CONSTANT, value=0.0)
    return cv2.matchTemplate(around, still, cv2.TM_CCORR)
