"""Frames shown to a segmenter as in a mirror: it makes other mistakes there, which label fusion then averages out."""

from dataclasses import replace

import numpy as np

from dsmap.frame import Frame, FrameGeometry
from dsmap.fusion.segmenter import Segmenter, wants_geometry


class Mirrored:
    """A segmenter that is shown every frame, and its geometry, with left and right exchanged.

    Rooms are as likely as their mirror images, so its answers are as good as the segmenter's own; they are turned back
    before they are given. A mirrored camera has no pose: `T_world_camera` of the frames is None.
    """

    def __init__(self, segmenter: Segmenter):
        self.segmenter = segmenter
        self.wants_geometry = wants_geometry(segmenter)

    def __call__(self, frame: Frame, geometry: FrameGeometry | None = None) -> np.ndarray | None:
        """As of a GeometrySegmenter, whether or not the segmenter is one."""
        images = {
            name: _mirrored(image)
            for name in ("rgb", "depth", "label", "instance")
            if (image := getattr(frame, name)) is not None
        }
        frame = replace(frame, T_world_camera=None, **images)
        if wants_geometry(self.segmenter):
            if geometry is not None:
                up = geometry.up * np.array([-1.0, 1.0, 1.0])
                geometry = replace(geometry, channels=_mirrored(geometry.channels), up=up)
            answer = self.segmenter(frame, geometry)
        else:
            answer = self.segmenter(frame)
        return None if answer is None else _mirrored(answer)


def _mirrored(image: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(image[:, ::-1])
