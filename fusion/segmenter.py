"""What the mapper needs of a network: class probabilities for a frame."""

from typing import Protocol, TypeGuard

import numpy as np

from dsmap.frame import Frame, FrameGeometry


class Segmenter(Protocol):
    """Anything that labels a frame. `dsmap.fusion` knows no network: it takes one of these."""

    def __call__(self, frame: Frame) -> np.ndarray | None:
        """Class probabilities of a frame.

        Returns:
            float32, shape (h, w, 14), rows sum to 1, class order of `dsmap.classes`; (h, w) may be smaller
            than the frame (it is sampled bilinearly over the whole image). None: this frame has no labels.
        """
        ...


class GeometrySegmenter(Protocol):
    """A segmenter with the attribute `wants_geometry = True`: it is shown what the mapper knows of the frame.

    Its frames are upright: a camera that is held on its side or upside down is turned by the map's up before, and
    the probabilities are turned back (see `dsmap.fusion.labels.upright`). A frame on its side is higher than wide.
    """

    wants_geometry: bool

    def __call__(self, frame: Frame, geometry: FrameGeometry | None = None) -> np.ndarray | None:
        """As of a Segmenter.

        Args:
            geometry: of this frame, turned as it is; None where there is none that can be trusted (no depth, a
                doubtful depth scale): the colours alone have to do.
        """
        ...


def wants_geometry(segmenter: Segmenter | None) -> TypeGuard[GeometrySegmenter]:
    """Whether it is to be called with a frame and its geometry."""
    return bool(getattr(segmenter, "wants_geometry", False))
