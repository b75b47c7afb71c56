"""Frames of a camera that is held on its side, turned upright for a network, and its probabilities turned back."""

from dataclasses import replace

import cv2
import numpy as np

from dsmap.frame import Frame, FrameGeometry
from dsmap.fusion.segmenter import GeometrySegmenter

_NEGLIGIBLE_DEG = 15.0
"""A remaining roll that networks are trained to stand; more is taken out by a warp."""
_MIN_ACROSS = 0.3
"""Up is along the view, and no side of the image is up, where less of it than this lies in the image."""
_GREY = (127, 127, 127)


def segment_upright(
    segmenter: GeometrySegmenter, frame: Frame, geometry: FrameGeometry | None, up: np.ndarray
) -> np.ndarray | None:
    """Class probabilities of a frame by a network that sees it upright; in the frame's own directions, (h, w, 14).

    The image is turned by quarters, exactly, and what then remains, if more than 15 degrees, by a warp; pixels whose
    view the warp cut off are 0 in all classes, which label fusion takes for no observation.

    Args:
        geometry: of the frame; None where there is none.
        up: in the camera's frame, shape (3,).
    """
    quarters, rest = roll(up)
    if quarters == 0 and rest == 0:
        return segmenter(frame, geometry)
    frame = _turned_frame(frame, quarters, rest)
    if geometry is not None:
        channels = _turned(geometry.channels, quarters, rest, cv2.INTER_NEAREST)
        R = _rotation(90 * quarters + rest)
        geometry = replace(geometry, channels=channels, up=R @ geometry.up)
    probabilities = segmenter(frame, geometry)
    if probabilities is None:
        return None
    aspect = frame.rgb.shape[1] / frame.rgb.shape[0]
    back = _warped(probabilities, -rest, cv2.INTER_LINEAR, aspect=aspect)
    return np.ascontiguousarray(np.rot90(back, -quarters))


def roll(up: np.ndarray) -> tuple[int, float]:
    """Quarter turns and degrees, both counter-clockwise, that bring up to the top of the image; small rests are 0."""
    if np.hypot(up[0], up[1]) < _MIN_ACROSS:
        return 0, 0.0
    angle = float(np.degrees(np.arctan2(up[0], -up[1])))
    quarters = round(angle / 90)
    rest = angle - 90 * quarters
    return quarters % 4, rest if abs(rest) > _NEGLIGIBLE_DEG else 0.0


def _turned_frame(frame: Frame, quarters: int, rest: float) -> Frame:
    images = {
        name: _turned(image, quarters, rest, cv2.INTER_NEAREST)
        for name in ("depth", "label", "instance")
        if (image := getattr(frame, name)) is not None
    }
    T = frame.T_world_camera
    if T is not None:
        T_camera_turned = np.eye(4)
        T_camera_turned[:3, :3] = _rotation(90 * quarters + rest).T
        T = T @ T_camera_turned
    rgb = _turned(frame.rgb, quarters, rest, cv2.INTER_LINEAR, _GREY)
    return replace(frame, rgb=rgb, T_world_camera=T, **images)


def _turned(
    image: np.ndarray, quarters: int, rest: float, how: int, border: tuple[int, ...] = (0,)
) -> np.ndarray:
    return _warped(np.ascontiguousarray(np.rot90(image, quarters)), rest, how, border)


def _warped(
    image: np.ndarray, degrees: float, how: int, border: tuple[int, ...] = (0,), aspect: float = 0.0
) -> np.ndarray:
    """An image turned counter-clockwise about its middle, of the same size; `border` where nothing was seen.

    aspect: width to height of the view, where the image's own is another; 0: they are the same.
    """
    if degrees == 0:
        return image
    height, width = image.shape[:2]
    stretch = aspect * height / width if aspect else 1.0  # a pixel's width in heights
    centre = ((width - 1) / 2 * stretch, (height - 1) / 2)
    turn = np.vstack([cv2.getRotationMatrix2D(centre, degrees, 1.0), [0, 0, 1]])
    square = np.diag([stretch, 1.0, 1.0])
    A = np.linalg.inv(square) @ turn @ square
    return cv2.warpAffine(image, A[:2], (width, height), flags=how, borderValue=border)


def _rotation(degrees: float) -> np.ndarray:
    """R_turned_camera of an image that is turned counter-clockwise, shape (3, 3)."""
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
