"""Asking a segmenter for the class probabilities of a frame, with what the map knows about it."""

import warnings

import numpy as np

from dsmap.errors import InputWarning
from dsmap.frame import Frame, Intrinsics
from dsmap.fusion.config import MapConfig
from dsmap.fusion.labels.gravity import MapGravity
from dsmap.fusion.labels.upright import segment_upright
from dsmap.fusion.segmenter import Segmenter, wants_geometry
from dsmap.kernels.camera import make_camera
from dsmap.kernels.preprocess import depth_in_range, preprocess
from dsmap.kernels.runtime import chosen_device
from dsmap.kernels.types import FrameMaps


def segment(
    segmenter: Segmenter,
    frame: Frame,
    maps: FrameMaps,
    T_world_camera: np.ndarray,
    gravity: MapGravity,
) -> np.ndarray | None:
    """Class probabilities of a frame in a map, shape (h, w, 14), or None.

    Args:
        maps: the frame's finest.
        T_world_camera: its pose in the map, shape (4, 4).
        gravity: the map's.
    """
    if not wants_geometry(segmenter):
        return _sound(segmenter(frame))
    geometry, up = gravity.of_frame(T_world_camera, maps), gravity.in_camera(T_world_camera)
    return _sound(segment_upright(segmenter, frame, geometry, up))


def _sound(probabilities: np.ndarray | None) -> np.ndarray | None:
    """The probabilities; None, and a warning, where some are no numbers: a frame of those labels nothing."""
    if probabilities is None or np.isfinite(probabilities).all():
        return probabilities
    text = "the segmenter answers with numbers that are none (NaN): such frames are not labelled"
    warnings.warn(InputWarning(text), stacklevel=2)
    return None


def segment_later(
    segmenter: Segmenter,
    frame: Frame,
    T_world_camera: np.ndarray,
    gravity: MapGravity,
    intrinsics: Intrinsics,
    config: MapConfig,
) -> np.ndarray | None:
    """`segment` for a frame of a finished map, whose maps are gone; intrinsics are those of the frame."""
    if not wants_geometry(segmenter):
        return _sound(segmenter(frame))
    depth = depth_in_range(frame.depth, *config.depth_range)
    maps = preprocess(frame.rgb, depth, [make_camera(intrinsics)], chosen_device("cpu"))[0]
    return segment(segmenter, frame, maps, T_world_camera, gravity)
