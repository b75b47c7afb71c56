"""A map with a finest resolution: which pixels need a surfel of their own, and which surfels are one too many.

A surfel stands for the surface within that resolution around it, and its disc is as large. So the view of the map tells
what it covers: a pixel that lies where the view shows a surface adds nothing. Of the others one in a cell as wide as
the resolution becomes a surfel; what its disc leaves open is not covered in the next view.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from dsmap.kernels.camera import Camera, pixel_at, rotate, to_transform, transform
from dsmap.kernels.launch import Slice, launch_rows
from dsmap.kernels.pixel_min import scratch
from dsmap.kernels.types import FrameImages, FrameMaps, SurfelArrays, SurfelMap

MOST_PIXELS = wp.constant(16)
"""A surfel stands for no more pixels than these, to either side: things nearer than that are rare."""
_OFF, _OFF_Z2 = (
    wp.constant(0.01),
    wp.constant(0.005),
)  # [m], [1/m]: so far off its plane it is the same surface
_SAME_NORMAL = wp.constant(0.6)
_CROWDED = wp.constant(0.5)
"""Surfels nearer to each other than this share of the resolution stand for the same."""


@dataclass
class MapView:
    """What the whole active map looks like, with all surfels there are."""

    camera: Any
    T_world_camera: np.ndarray
    """Shape (4, 4)."""
    vertex: wp.array  # vec3 [m] in its camera's frame, z = 0 where there is none
    normal: wp.array  # vec3


@wp.kernel
def _want(
    s: Slice,
    camera: Camera,
    resolution: float,
    frame: FrameImages,
    match: wp.array2d(dtype=wp.int32),
    has_view: int,
    view_camera: Camera,
    T_view_camera: wp.mat44,
    view_vertex: wp.array2d(dtype=wp.vec3),
    view_normal: wp.array2d(dtype=wp.vec3),
    wanted: wp.array2d(dtype=wp.uint8),
):
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, camera.width, s.step):
        want = int(0)
        if match[y, x] == -1 and frame.edge[y, x] == wp.uint8(0):
            v = frame.vertex[y, x]
            n = frame.normal[y, x]
            if v[2] > 0.0 and wp.dot(n, n) > 0.0:
                want += 1
                if has_view != 0:
                    p = transform(T_view_camera, v)
                    at = pixel_at(view_camera, p)
                    if at[0] < 0:
                        want = 0  # the next view will show it
                    else:
                        mn = view_normal[at[1], at[0]]
                        off = p - view_vertex[at[1], at[0]]
                        near = 2.0 * wp.max(resolution, p[2] * view_camera.inv_fx)
                        on_it = wp.abs(wp.dot(off, mn)) < _OFF + _OFF_Z2 * p[2] * p[2]
                        alike = wp.dot(rotate(T_view_camera, n), mn) > _SAME_NORMAL
                        if on_it and alike and wp.length_sq(off) < near * near:
                            want = 0
        wanted[y, x] = wp.uint8(want)


@wp.kernel
def _choose(
    s: Slice,
    camera: Camera,
    resolution: float,
    frame: FrameImages,
    wanted: wp.array2d(dtype=wp.uint8),
    is_new: wp.array2d(dtype=wp.int32),
):
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, camera.width, s.step):
        new = int(0)
        if wanted[y, x] != wp.uint8(0):
            v = frame.vertex[y, x]
            k = wp.clamp(int(resolution * camera.fx / v[2] + 0.5), 1, MOST_PIXELS)
            new += 1
            # The first of its cell that lies on this surface is the cell's surfel.
            for yy in range(y - y % k, y + 1):
                for xx in range(x - x % k, wp.min(x - x % k + k, camera.width)):
                    earlier = wanted[yy, xx] != wp.uint8(0) and (yy < y or xx < x)
                    if (
                        new > 0
                        and earlier
                        and wp.length_sq(frame.vertex[yy, xx] - v) < 4.0 * resolution * resolution
                    ):
                        new -= 1
        is_new[y, x] = new


@wp.kernel
def _crowd(
    s: Slice,
    camera: Camera,
    resolution: float,
    frame: FrameImages,
    match: wp.array2d(dtype=wp.int32),
    m: SurfelArrays,
    crowded: wp.array2d(dtype=wp.uint8),
):
    row, lane = wp.tid()
    y = s.first + s.stride * row
    near = _CROWDED * resolution
    for x in range(lane, camera.width, s.step):
        spare = int(0)
        i = match[y, x]
        if i >= 0:
            k = wp.clamp(int(near * camera.fx / frame.vertex[y, x][2] + 0.5), 0, MOST_PIXELS)
            for yy in range(wp.max(y - k, 0), wp.min(y + k + 1, camera.height)):
                for xx in range(wp.max(x - k, 0), wp.min(x + k + 1, camera.width)):
                    j = match[yy, xx]
                    if j >= 0 and j != i:
                        apart = m.position[j] - m.position[i]
                        if m.weight[j] > m.weight[i] and wp.dot(apart, apart) < near * near:
                            spare = 1
        crowded[y, x] = wp.uint8(spare)


@wp.kernel
def _remove(
    s: Slice,
    match: wp.array2d(dtype=wp.int32),
    crowded: wp.array2d(dtype=wp.uint8),
    m: SurfelArrays,
):
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, match.shape[1], s.step):
        if crowded[y, x] != wp.uint8(0):
            m.weight[match[y, x]] = 0.0


def find_uncovered(
    camera: Camera,
    T_world_camera: np.ndarray,
    frame: FrameMaps,
    match: wp.array,
    resolution: float,
    view: MapView | None,
    is_new: wp.array,
) -> None:
    """Mark the pixels that become surfels of a map with a finest resolution [m].

    match: int32, shape (H, W), from `associate_surfels`; view: of the map, None if it is empty.
    is_new: out, int32, shape (H, W), 1 where a surfel is to be.
    """
    shape, device = match.shape, match.device
    wanted = scratch("wanted", shape, wp.uint8, device)
    seen = MapView(camera, T_world_camera, frame.vertex, frame.normal) if view is None else view
    T_view_camera = to_transform(np.linalg.inv(seen.T_world_camera) @ T_world_camera)
    inputs: list[Any] = [camera, resolution, frame.images, match]
    inputs += [int(view is not None), seen.camera, T_view_camera, seen.vertex, seen.normal]
    launch_rows(_want, *shape, inputs, [wanted], device)
    launch_rows(_choose, *shape, [camera, resolution, frame.images, wanted], [is_new], device)


def thin_out(
    surfels: SurfelMap, camera: Camera, frame: FrameMaps, match: wp.array, resolution: float
) -> None:
    """Take out (weight 0) matched surfels that lie within half the resolution [m] of one with more confidence.

    frame: the maps of its level 0; match: of `associate_surfels`, int32, shape (H, W).
    """
    m, shape, device = surfels, match.shape, surfels.device
    crowded = scratch("crowded", shape, wp.uint8, device)
    launch_rows(_crowd, *shape, [camera, resolution, frame.images, match, m.arrays], [crowded], device)
    launch_rows(_remove, *shape, [match, crowded, m.arrays], [], device)
