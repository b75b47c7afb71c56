"""Fusion of a frame into the map: matched surfels are averaged, unmatched pixels become new surfels."""

import functools
import math
from enum import IntEnum

import numpy as np
import warp as wp

from dsmap.kernels.camera import Camera, rotate, to_transform, transform
from dsmap.kernels.coverage import MapView, find_uncovered
from dsmap.kernels.launch import Slice, launch_rows
from dsmap.kernels.pixel_min import scratch
from dsmap.kernels.prefetch import AHEAD, fetch_early
from dsmap.kernels.types import FrameImages, FrameMaps, SurfelArrays, SurfelMap

SIGMA = 0.6
"""Width of the sample weight over the normalised distance from the image centre (Keller et al. 2013)."""
RADIUS_RATIO = 1.5
"""A sample with a radius beyond this multiple of the surfel's is too coarse to be averaged in."""
NO_COLOUR = wp.constant(wp.float32(1e-4))
"""Red, green and blue of a surfel whose colour is not known yet: black, but no value of an 8-bit image."""


class FusedColours(IntEnum):
    """Which surfels take on the colours of a frame."""

    NONE = 0
    NEW = 1
    """New ones, and those that have none yet."""
    ALL = 2


@wp.struct
class Fusion:
    """Constants of one fused frame."""

    time: wp.int32  # frame number
    max_weight: wp.float32  # surfel confidence saturates here
    colours: wp.int32  # FusedColours
    resolution: wp.float32  # [m] no surfel is smaller


@functools.lru_cache(maxsize=8)
def _sample_weights(width: int, height: int, device: str) -> tuple[wp.array, wp.array]:
    """exp(-gamma^2 / (2 0.6^2)) as a factor a column and a factor a row: shapes (W,) and (H,).

    gamma is the distance from the image centre, 1 at the corners: measurements are best in the middle.
    """
    half_diagonal = 0.5 * math.hypot(width - 1, height - 1)
    gammas = [(np.arange(n) - 0.5 * (n - 1)) / half_diagonal for n in (width, height)]
    columns, rows = (np.exp(-(gamma**2) / (2 * SIGMA**2)).astype(np.float32) for gamma in gammas)
    return wp.array(columns, device=device), wp.array(rows, device=device)


_STEPS = wp.types.vector(8, wp.int32)
_STEP_X = wp.constant(_STEPS(-1, 1, 0, 0, -1, 1, -1, 1))
_STEP_Y = wp.constant(_STEPS(0, 0, -1, 1, -1, -1, 1, 1))
"""To the neighbours of a pixel, the likeliest first: the search ends at the first that fits."""


@wp.func
def _is_represented(
    camera: Camera,
    T_camera_world: wp.mat44,
    x: int,
    y: int,
    v: wp.vec3,
    n: wp.vec3,
    match: wp.array2d(dtype=wp.int32),
    position: wp.array(dtype=wp.vec3),
) -> bool:
    """Whether the matched surfel of a neighbour lies within one pixel of an unmatched one, along the surface."""
    footprint = v[2] / camera.fx
    for k in range(8):
        yy = y + _STEP_Y[k]
        xx = x + _STEP_X[k]
        if xx >= 0 and yy >= 0 and xx < camera.width and yy < camera.height:
            i = match[yy, xx]
            if i >= 0:
                off = transform(T_camera_world, position[i]) - v
                along = wp.dot(off, n)
                if wp.dot(off, off) - along * along < footprint * footprint:
                    return True
    return False


@wp.kernel
def _find_new(
    s: Slice,
    camera: Camera,
    T_camera_world: wp.mat44,
    frame: FrameImages,
    match: wp.array2d(dtype=wp.int32),
    m: SurfelArrays,
    is_new: wp.array2d(dtype=wp.int32),
):
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, camera.width, s.step):
        new = int(0)
        if match[y, x] == -1 and frame.edge[y, x] == wp.uint8(0):
            v = frame.vertex[y, x]
            n = frame.normal[y, x]
            measured = v[2] > 0.0 and wp.dot(n, n) > 0.0
            if measured and not _is_represented(camera, T_camera_world, x, y, v, n, match, m.position):
                new = 1
        is_new[y, x] = new


@wp.kernel
def _average(
    s: Slice,
    camera: Camera,
    T_world_camera: wp.mat44,
    fusion: Fusion,
    columns: wp.array(dtype=wp.float32),
    rows: wp.array(dtype=wp.float32),
    frame: FrameImages,
    match: wp.array2d(dtype=wp.int32),
    m: SurfelArrays,
):
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, camera.width, s.step):
        soon = match[y, wp.min(x + AHEAD, camera.width - 1)]
        fetch_early(m.position, soon)
        fetch_early(m.normal, soon)
        fetch_early(m.colour, soon)
        fetch_early(m.weight, soon)
        fetch_early(m.radius, soon)
        fetch_early(m.t_updated, soon)
        i = match[y, x]
        if i >= 0:
            w = m.weight[i]
            a = columns[x] * rows[y]
            size = wp.max(frame.radius[y, x], fusion.resolution)
            if size < RADIUS_RATIO * m.radius[i]:
                share = a / (w + a)
                m.position[i] = wp.lerp(m.position[i], transform(T_world_camera, frame.vertex[y, x]), share)
                m.normal[i] = wp.normalize(
                    wp.lerp(m.normal[i], rotate(T_world_camera, frame.normal[y, x]), share)
                )
                if fusion.colours > 0:
                    if m.colour[i][0] == NO_COLOUR:
                        m.colour[i] = frame.colour[y, x]
                    elif fusion.colours == 2:
                        m.colour[i] = wp.lerp(m.colour[i], frame.colour[y, x], share)
                m.radius[i] = wp.lerp(m.radius[i], size, share)
            m.weight[i] = wp.min(w + a, fusion.max_weight)
            m.t_updated[i] = fusion.time


@wp.kernel
def _insert(
    s: Slice,
    camera: Camera,
    T_world_camera: wp.mat44,
    fusion: Fusion,
    columns: wp.array(dtype=wp.float32),
    rows: wp.array(dtype=wp.float32),
    first: int,
    rank: wp.array(dtype=wp.int32),
    frame: FrameImages,
    is_new: wp.array2d(dtype=wp.int32),
    m: SurfelArrays,
):
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, camera.width, s.step):
        if is_new[y, x] == 1:
            i = first + rank[y * camera.width + x]
            m.position[i] = transform(T_world_camera, frame.vertex[y, x])
            m.normal[i] = rotate(T_world_camera, frame.normal[y, x])
            m.colour[i] = wp.vec3(NO_COLOUR, NO_COLOUR, NO_COLOUR)
            if fusion.colours > 0:
                m.colour[i] = frame.colour[y, x]
            m.weight[i] = columns[x] * rows[y]
            m.radius[i] = wp.max(frame.radius[y, x], fusion.resolution)
            m.t_created[i] = fusion.time
            m.t_updated[i] = fusion.time
            m.label[i] = wp.uint8(0)
            m.observations[i] = 0.0
            for k in range(m.evidence.shape[1]):
                m.evidence[i, k] = 0.0
            m.segment[i] = 0


def fuse_frame(
    surfels: SurfelMap,
    camera: Camera,
    T_world_camera: np.ndarray,
    frame: FrameMaps,
    match: wp.array,
    *,
    time: int,
    max_weight: float = math.inf,
    colours: FusedColours = FusedColours.ALL,
    resolution: float = 0.0,
    view: MapView | None = None,
    grows: bool = True,
) -> int:
    """Fuse a frame (its level-0 maps) into the map; returns how many surfels were inserted.

    A matched surfel becomes the weighted mean of itself and the pixel (position, normal, colour, radius),
    with the sample weight exp(-gamma^2 / (2 0.6^2)); its weight grows by that up to `max_weight` (a cap
    makes the mean follow newer frames). A sample much coarser than the surfel, seen from further away or
    at a flatter angle, only confirms it (weight and time): averaging it in would wash out detail.

    A pixel that no surfel fits (-1), with a normal and off depth edges, becomes a surfel, unless a matched
    surfel of its 3x3 neighbourhood lies within one pixel footprint d/f of it along the surface. Without
    that rule every small motion leaves pixels without a surfel of their own and the map fills with
    copies; with it there is about one surfel a pixel of the finest view. New surfels are appended in
    image order. match: int32, shape (H, W), from `associate_surfels`; time: frame number; colours: which surfels
    take on the frame's; without any, new ones are NO_COLOUR, which the next colour replaces.
    resolution [m]: no disc is smaller, and a pixel becomes a surfel only where `view`, of all surfels of the map (None:
    it is empty), shows none (see `coverage`); 0: about one surfel a pixel of the finest view. grows: whether any is
    inserted; where a view does not show the last frame's surfels, they would be inserted once more.
    """
    m, device, shape = surfels, surfels.device, match.shape
    to_world, from_world = to_transform(T_world_camera), to_transform(np.linalg.inv(T_world_camera))
    fusion = Fusion()
    fusion.time, fusion.max_weight, fusion.colours = time, max_weight, int(colours)
    fusion.resolution = resolution
    images = frame.images
    columns, rows = _sample_weights(camera.width, camera.height, str(device))
    is_new = scratch("is new", shape, wp.int32, device)
    if resolution == 0:
        inputs = [camera, from_world, images, match, m.arrays]
        launch_rows(_find_new, *shape, inputs, [is_new], device)
    inputs = [camera, to_world, fusion, columns, rows, images, match, m.arrays]
    launch_rows(_average, *shape, inputs, [], device)
    if resolution > 0 and grows:
        find_uncovered(camera, T_world_camera, frame, match, resolution, view, is_new)
    if not grows:
        return 0
    rank, inserted = _ranks(is_new)
    if inserted:
        m.reserve(m.count + inserted)
        inputs = [camera, to_world, fusion, columns, rows, m.count, rank, images, is_new, m.arrays]
        launch_rows(_insert, *shape, inputs, [], device)
        m.count += inserted
    return inserted


def _ranks(flags: wp.array) -> tuple[wp.array, int]:
    """For flags of 0 and 1, shape (H, W): how many are set before each pixel, shape (H * W), and in all."""
    flat = flags.flatten()
    rank = scratch("rank", flat.shape, wp.int32, flags.device)
    wp.utils.array_scan(flat, rank, inclusive=False)
    last = flat.shape[0] - 1
    return rank, int(rank[last:].numpy()[0] + flat[last:].numpy()[0])
