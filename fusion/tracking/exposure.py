"""How differently two images of the same surface were exposed."""

import numpy as np

from dsmap.kernels.types import Surface

_DARK, _BRIGHT = 0.02, 0.98
"""Intensities beyond these tell nothing about exposure."""
_MIN_SHARED = 0.05
"""Share of the image that exposure is measured on, at least."""
_ALIKE = 0.05
"""Images too dark or too bright to measure it are alike if their medians differ by less than this."""
_MOST_GAIN = 2.0
"""Images whose exposures differ by more than this factor are not compared: noise and saturation remain."""
_STEADY = 0.03
"""A ratio of intensities this near to 1 is what motion alone makes of it: no change of exposure."""


def exposure_gain(frame: Surface, model: Surface) -> float | None:
    """How much darker (> 1) the frame was exposed than the model: the median ratio of intensities.

    Cameras with automatic exposure change it by a tenth and more within a second, which Eq. 2 would take for
    motion. Between two frames hardly anything moves on the coarsest level, so the same pixels are compared: those
    with depth in both views, neither black nor saturated.

    Args:
        frame, model: one level of both.

    Returns:
        A factor between 0.5 and 2; 1 where too little is seen in both; None where the images cannot be compared.
    """
    light, reference = frame.intensity.numpy(), model.intensity.numpy()
    shared = (frame.vertex.numpy()[..., 2] > 0) & (model.vertex.numpy()[..., 2] > 0)
    enough = _MIN_SHARED * shared.size
    if np.count_nonzero(shared) < enough:
        return 1.0
    telling = shared & (light > _DARK) & (light < _BRIGHT) & (reference > _DARK) & (reference < _BRIGHT)
    if np.count_nonzero(telling) < enough:
        return 1.0 if abs(np.median(light[shared]) - np.median(reference[shared])) < _ALIKE else None
    # Not the ratio of means: a dark picture that leaves the image in a fast turn would pass for a change of exposure.
    gain = float(np.median(reference[telling] / light[telling]))
    if not 1 / _MOST_GAIN <= gain <= _MOST_GAIN:
        return None
    return gain if abs(gain - 1) > _STEADY else 1.0
