"""Depth as small planes. In inverse depth a plane is linear in the pixel, and a Kinect's noise is alike everywhere."""

import cv2
import numpy as np

_RADIUS_BY_WIDTH = 1 / 64
"""Half the side of a patch [image widths]: 11x11 pixels at 320x240. Noise in the slopes looks like information on where
the depth camera is and is none; it falls with the square of the side."""
_ROUGH = 0.01
"""Patches whose depth is off their plane by more than this share (RMS) hold an edge, not a surface."""
_STEEP = 0.04
"""A slope of inverse depth a pixel, as a share of it, above which a surface is seen too obliquely."""

_BENT = 2.5
"""Standard deviations of its noise by which a patch may be bent."""
_MEDIAN_OF_NORMAL = 0.455
"""Median of the square of a normal variable."""


def patch_radius(width: int) -> int:
    """Half the side of a patch in images of a width [px]."""
    return max(3, round(width * _RADIUS_BY_WIDTH))


def depth_planes(depth: np.ndarray, depth_max: float | None = None) -> np.ndarray:
    """The plane around every pixel: inverse depth [1/m] and its slopes by x and y [1/m a pixel].

    Args:
        depth: planar depth [m], shape (H, W); 0 where there is none.
        depth_max: beyond it depth does not count [m].

    Returns:
        float32, shape (H, W, 3); the first is 0 where there is no whole, smooth patch.
    """
    height, width = depth.shape
    r = patch_radius(width)
    valid = depth > 0 if depth_max is None else (depth > 0) & (depth <= depth_max)
    inverse = np.where(valid, 1.0 / np.where(valid, depth, 1.0), 0.0)
    side = 2 * r + 1
    ones, ramp = np.ones(side), np.arange(-r, r + 1, dtype=np.float64)
    bow = ramp**2 - (ramp**2).mean()

    def fitted(along_x: np.ndarray, along_y: np.ndarray) -> tuple[np.ndarray, float]:
        """How much of a shape each patch holds, and the shape's sum of squares."""
        size = float((along_x**2).sum() * (along_y**2).sum())
        held = cv2.sepFilter2D(inverse, cv2.CV_64F, along_x, along_y, borderType=cv2.BORDER_CONSTANT)
        return held / size, size

    (mean, area), (slope_x, spread), (slope_y, _) = fitted(ones, ones), fitted(ramp, ones), fitted(ones, ramp)
    square = cv2.sepFilter2D(inverse**2, cv2.CV_64F, ones, ones, borderType=cv2.BORDER_CONSTANT)
    rest = np.maximum(square - mean**2 * area - (slope_x**2 + slope_y**2) * spread, 0.0)
    whole = cv2.erode(valid.astype(np.uint8), np.ones((side, side), np.uint8), borderValue=0) > 0
    whole &= (rest < area * (_ROUGH * mean) ** 2) & (np.hypot(slope_x, slope_y) < _STEEP * mean)
    flat = whole & _is_flat([fitted(bow, ones), fitted(ones, bow), fitted(ramp, ramp)], rest / area, whole)
    return np.stack([np.where(flat, mean, 0.0), slope_x, slope_y], axis=-1).astype(np.float32)


def _is_flat(bends: list[tuple[np.ndarray, float]], noise: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """Where a patch is bent by no more than its noise can be; a bend moves its mean off the surface.

    Args:
        bends: how much of each kind of bend a patch holds, and that kind's sum of squares.
        noise: mean square of what a plane leaves.
        whole: the patches that count.
    """
    flat = np.ones(noise.shape, bool)
    for bend, size in bends:
        squared = bend**2 * size / np.maximum(noise, 1e-16)
        # A sensor's noise is alike in neighbouring pixels, so that it bends patches more than it should.
        usual = float(np.median(squared[whole])) / _MEDIAN_OF_NORMAL if whole.any() else 1.0
        flat &= squared < _BENT**2 * max(usual, 1.0)
    return flat


def look_up(planes: np.ndarray, frame: np.ndarray, pixel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The planes under some pixels.

    Args:
        planes: of `depth_planes` for every frame, shape (F, H, W, 3).
        frame, pixel: which frame, (N,), and where (x, y), (N, 2).

    Returns:
        Inverse depth at the pixel and its slopes, (N, 3), and whether there is a plane, bool (N,).
    """
    height, width = planes.shape[1:3]
    inside = np.asarray(np.isfinite(pixel).all(axis=1))
    nearest = np.rint(np.where(inside[:, None], pixel, -1.0)).clip(-1, 1e6).astype(np.int64)
    x, y = nearest[:, 0], nearest[:, 1]
    inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
    found = planes[frame, np.where(inside, y, 0), np.where(inside, x, 0)].astype(np.float64)
    inside &= found[:, 0] > 0
    off = np.where(inside[:, None], pixel - nearest, 0.0)
    found[:, 0] += (found[:, 1:] * off).sum(axis=1)
    return found, inside
