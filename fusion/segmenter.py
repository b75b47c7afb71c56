"""What the mapper needs of a network: class probabilities for a frame."""

from typing import Protocol

import numpy as np

from dsmap.frame import Frame


class Segmenter(Protocol):
    """Anything that labels a frame. `dsmap.fusion` knows no network: it takes one of these."""

    def __call__(self, frame: Frame) -> np.ndarray | None:
        """Class probabilities of a frame.

        Returns:
            float32, shape (h, w, 14), rows sum to 1, class order of `dsmap.classes`; (h, w) may be smaller
            than the frame (it is sampled bilinearly over the whole image). None: this frame has no labels.
        """
        ...
