"""Plain image filters in Warp: the CUDA bodies of what OpenCV does faster on a CPU (see preprocess)."""

from typing import Any

import warp as wp

from dsmap.kernels.launch import Slice, launch_rows

BILATERAL_RADIUS = 3
"""The window is the disc of this radius [px], as in cv2.bilateralFilter with d = 7."""


@wp.kernel
def _bilateral(
    s: Slice,
    depth: wp.array2d(dtype=float),
    sigma_space: float,
    sigma_range: float,
    out: wp.array2d(dtype=float),
):
    row, lane = wp.tid()
    y = s.first + s.stride * row
    height, width = depth.shape[0], depth.shape[1]
    space = -0.5 / (sigma_space * sigma_space)
    spread = -0.5 / (sigma_range * sigma_range)
    for x in range(lane, width, s.step):
        centre = depth[y, x]
        total = float(0.0)
        norm = float(0.0)
        for dy in range(-3, 4):
            for dx in range(-3, 4):
                if dx * dx + dy * dy <= 9:
                    # cv2 reflects at the border without repeating the border pixel (BORDER_REFLECT_101)
                    yy = wp.abs(y + dy)
                    xx = wp.abs(x + dx)
                    if yy >= height:
                        yy = 2 * height - 2 - yy
                    if xx >= width:
                        xx = 2 * width - 2 - xx
                    value = depth[yy, xx]
                    gap = value - centre
                    weight = wp.exp(space * float(dx * dx + dy * dy) + spread * gap * gap)
                    total += weight * value
                    norm += weight
        out[y, x] = wp.where(centre > 0.0, total / norm, 0.0)


@wp.kernel
def _colour(s: Slice, rgb: wp.array3d(dtype=wp.uint8), out: wp.array2d(dtype=wp.vec3)):
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, rgb.shape[1], s.step):
        out[y, x] = wp.vec3(float(rgb[y, x, 0]), float(rgb[y, x, 1]), float(rgb[y, x, 2])) / 255.0


@wp.kernel
def _intensity(s: Slice, colour: wp.array2d(dtype=wp.vec3), out: wp.array2d(dtype=float)):
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, colour.shape[1], s.step):
        c = colour[y, x]
        out[y, x] = 0.299 * c[0] + 0.587 * c[1] + 0.114 * c[2]


@wp.kernel
def _half(s: Slice, image: wp.array2d(dtype=float), out: wp.array2d(dtype=float)):
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, out.shape[1], s.step):
        out[y, x] = 0.25 * (
            image[2 * y, 2 * x]
            + image[2 * y, 2 * x + 1]
            + image[2 * y + 1, 2 * x]
            + image[2 * y + 1, 2 * x + 1]
        )


def bilateral(depth: wp.array, sigma_space: float, sigma_range: float, out: wp.array) -> None:
    """Edge-preserving smoothing of depth [m], shape (H, W); 0 stays 0 and stays out by the range term."""
    height, width = depth.shape
    launch_rows(_bilateral, height, width, [depth, sigma_space, sigma_range], [out], depth.device)


def colour(rgb: wp.array, out: wp.array) -> None:
    """uint8 RGB, shape (H, W, 3), to vec3 in [0, 1], shape (H, W)."""
    launch_rows(_colour, rgb.shape[0], rgb.shape[1], [rgb], [out], rgb.device)


def intensity(colour: wp.array, out: wp.array) -> None:
    """Intensity (Rec. 601) of RGB in [0, 1], shapes (H, W)."""
    launch_rows(_intensity, *colour.shape, [colour], [out], colour.device)


def half(image: Any, out: Any) -> None:
    """Mean of each 2x2 block: the next pyramid level, whose pixel centres follow Intrinsics.scaled."""
    launch_rows(_half, out.shape[0], out.shape[1], [image], [out], image.device)
