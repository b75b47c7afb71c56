"""Rolling shutter: a frame whose rows were taken one after the other, as if all had been taken with the middle one.

While the rows are read the camera moves: T(t) = T exp(xi^ t), t = 0 at the middle row. A point that a row measured,
p_t, lies at exp(xi^ t) p_t in the camera of the middle row. Each pixel of the new maps takes over the measurement that
falls into it: points are moved to where they belong, nothing is interpolated.
"""

from dataclasses import replace

import numpy as np
import warp as wp

from dsmap.kernels.camera import Camera, pixel_of, project, ray
from dsmap.kernels.launch import Slice, launch_rows
from dsmap.kernels.types import FrameMaps

_UNKNOWN = 10.0
"""Depth [m] that is assumed where there is none: far, so that only the camera's turning moves it."""
_MAX_MISS = 1.5
"""A measurement that falls further than this from the pixel [px] does not belong to it: a silhouette."""


@wp.struct
class Shutter:
    """How the camera moves while it reads the rows of an image."""

    velocity: wp.vec3  # of the camera in its own frame [m / s]
    turning: wp.vec3  # likewise [rad / s]
    per_row: wp.float32  # time from a row to the next [s]; 0: all rows at once
    middle: wp.float32  # the row that has the pose of the frame


def make_shutter(camera: Camera, twist: np.ndarray | None, readout_s: float) -> Shutter:
    """The kernel struct; twist: (translation [m/s], rotation [rad/s]), shape (6,), None: at rest."""
    shutter = Shutter()
    if twist is not None:
        shutter.velocity, shutter.turning = (
            wp.vec3(*(float(x) for x in part)) for part in (twist[:3], twist[3:])
        )
        shutter.per_row = readout_s / (camera.height - 1)
    shutter.middle = 0.5 * (camera.height - 1)
    return shutter


@wp.func
def moved(shutter: Shutter, p: wp.vec3, rows: float) -> wp.vec3:
    """exp(xi^ t) p, t the time that so many rows take, to second order: 3 rad/s for 15 ms leave 0.03 mm at 2 m."""
    t = rows * shutter.per_row
    a = shutter.velocity + wp.cross(shutter.turning, p)
    return p + t * (a + 0.5 * t * wp.cross(shutter.turning, a))


@wp.kernel(enable_backward=False)
def _global_shutter(
    s: Slice, camera: Camera, shutter: Shutter,
    vertex: wp.array2d(dtype=wp.vec3), normal: wp.array2d(dtype=wp.vec3), intensity: wp.array2d(dtype=float),
    vertex_out: wp.array2d(dtype=wp.vec3), normal_out: wp.array2d(dtype=wp.vec3),
    intensity_out: wp.array2d(dtype=float), source: wp.array2d(dtype=wp.vec2i),
):  # fmt: skip
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, camera.width, s.step):
        px = x
        py = y
        # Which pixel measured what lies here? Its row tells the time, its depth the place; twice is enough.
        for _ in range(2):
            d = vertex[py, px][2]
            if d <= 0.0:
                d = _UNKNOWN
            q = moved(shutter, d * ray(camera, float(x), float(y)), shutter.middle - float(py))
            u = project(camera, q)
            px = wp.clamp(pixel_of(u[0]), 0, camera.width - 1)
            py = wp.clamp(pixel_of(u[1]), 0, camera.height - 1)
        p = vertex[py, px]
        n = normal[py, px]
        if p[2] > 0.0:
            rows = float(py) - shutter.middle
            n = moved(shutter, p + n, rows)
            p = moved(shutter, p, rows)
            n = n - p
            u = project(camera, p)
            if wp.max(wp.abs(u[0] - float(x)), wp.abs(u[1] - float(y))) > _MAX_MISS:
                p = wp.vec3(0.0, 0.0, 0.0)
                n = wp.vec3(0.0, 0.0, 0.0)
        vertex_out[y, x] = p
        normal_out[y, x] = n
        intensity_out[y, x] = intensity[py, px]
        source[y, x] = wp.vec2i(px, py)


@wp.kernel(enable_backward=False)
def _taken_over(
    s: Slice, width: int, source: wp.array2d(dtype=wp.vec2i), vertex: wp.array2d(dtype=wp.vec3),
    radius: wp.array2d(dtype=float), colour: wp.array2d(dtype=wp.vec3), edge: wp.array2d(dtype=wp.uint8),
    depth_out: wp.array2d(dtype=float), radius_out: wp.array2d(dtype=float),
    colour_out: wp.array2d(dtype=wp.vec3), edge_out: wp.array2d(dtype=wp.uint8),
):  # fmt: skip
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, width, s.step):
        at = source[y, x]
        depth_out[y, x] = vertex[y, x][2]
        radius_out[y, x] = radius[at[1], at[0]]
        colour_out[y, x] = colour[at[1], at[0]]
        edge_out[y, x] = edge[at[1], at[0]]


def global_shutter(camera: Camera, maps: FrameMaps, twist: np.ndarray, readout_s: float) -> FrameMaps:
    """The maps as a camera would have seen them that reads all rows at the time of the middle one.

    Args:
        camera: of the maps.
        maps: of one pyramid level; the finest has colour, radius and edges, too.
        twist: velocity of the camera in its own frame (translation [m/s], rotation [rad/s]), shape (6,).
        readout_s: time from the first row to the last [s]; negative if the last comes first.

    Returns:
        New maps. Vertices are measurements, moved; they lie up to 1.5 pixels off their pixel's ray. Where nothing
        was measured, or something else, there are holes; intensities and colours have none.
    """
    device, shape = maps.vertex.device, maps.vertex.shape
    out = [wp.empty(shape, dtype=dtype, device=device) for dtype in (wp.vec3, wp.vec3, float, wp.vec2i)]
    inputs = [camera, make_shutter(camera, twist, readout_s), maps.vertex, maps.normal, maps.intensity]
    launch_rows(_global_shutter, camera.height, 2 * camera.width, inputs, out, device)
    vertex, normal, intensity, source = out
    new = replace(maps, vertex=vertex, normal=normal, intensity=intensity)
    if maps.colour is None:
        return new
    out = [wp.empty(shape, dtype=dtype, device=device) for dtype in (float, float, wp.vec3, wp.uint8)]
    inputs = [camera.width, source, vertex, maps.radius, maps.colour, maps.edge]
    launch_rows(_taken_over, camera.height, camera.width, inputs, out, device)
    return replace(new, depth=out[0], radius=out[1], colour=out[2], edge=out[3])
