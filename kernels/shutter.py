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
from dsmap.kernels.pixel_min import scratch
from dsmap.kernels.types import FrameMaps

_UNKNOWN = 10.0
"""Depth [m] that is assumed where there is none: far, so that only the camera's turning moves it."""
SHARED = wp.constant(8)
"""So many pixels in a row look for their measurements at the same distance."""
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
def moved_by_rows(shutter: Shutter, p: wp.vec3, rows: float) -> wp.vec3:
    """exp(xi^ t) p, t the time that so many rows take, to second order: 3 rad/s for 15 ms leave 0.03 mm at 2 m."""
    t = rows * shutter.per_row
    a = shutter.velocity + wp.cross(shutter.turning, p)
    return p + t * (a + 0.5 * t * wp.cross(shutter.turning, a))


@wp.kernel
def _global_shutter(
    s: Slice, camera: Camera, shutter: Shutter, finest: int,
    vertex: wp.array2d(dtype=wp.vec3), normal: wp.array2d(dtype=wp.vec3), intensity: wp.array2d(dtype=float),
    radius: wp.array2d(dtype=float), colour: wp.array2d(dtype=wp.vec3), edge: wp.array2d(dtype=wp.uint8),
    vertex_out: wp.array2d(dtype=wp.vec3), normal_out: wp.array2d(dtype=wp.vec3),
    intensity_out: wp.array2d(dtype=float), depth_out: wp.array2d(dtype=float),
    radius_out: wp.array2d(dtype=float), colour_out: wp.array2d(dtype=wp.vec3),
    edge_out: wp.array2d(dtype=wp.uint8),
):  # fmt: skip
    row, lane = wp.tid()
    y = s.first + s.stride * row
    dx = int(0)
    dy = int(0)
    for x in range(lane, camera.width, s.step):
        if x % SHARED == 0 or s.step > 1:
            # Which pixel measured what lies here? Its row tells the time, its depth the place; twice is enough.
            # Neighbours share the answer, which costs more than all the rest.
            middle = wp.min(x - x % SHARED + SHARED / 2, camera.width - 1)
            direction = ray(camera, float(middle), float(y))
            px = middle
            py = y
            for _ in range(2):
                d = vertex[py, px][2]
                if d <= 0.0:
                    d = _UNKNOWN
                u = project(camera, moved_by_rows(shutter, d * direction, shutter.middle - float(py)))
                px = wp.clamp(pixel_of(u[0]), 0, camera.width - 1)
                py = wp.clamp(pixel_of(u[1]), 0, camera.height - 1)
            dx = px - middle
            dy = py - y
        px = wp.clamp(x + dx, 0, camera.width - 1)
        py = wp.clamp(y + dy, 0, camera.height - 1)
        p = vertex[py, px]
        n = normal[py, px]
        if p[2] > 0.0:
            rows = float(py) - shutter.middle
            p = moved_by_rows(shutter, p, rows)
            n += rows * shutter.per_row * wp.cross(shutter.turning, n)  # to first order: a tenth of a degree
            # How far from here it falls, times its depth.
            miss_x = camera.fx * p[0] + (camera.cx - float(x)) * p[2]
            miss_y = camera.fy * p[1] + (camera.cy - float(y)) * p[2]
            if wp.max(wp.abs(miss_x), wp.abs(miss_y)) > _MAX_MISS * p[2]:
                p = wp.vec3(0.0, 0.0, 0.0)
                n = wp.vec3(0.0, 0.0, 0.0)
        vertex_out[y, x] = p
        normal_out[y, x] = n
        intensity_out[y, x] = intensity[py, px]
        if finest != 0:
            depth_out[y, x] = p[2]
            radius_out[y, x] = radius[py, px]
            colour_out[y, x] = colour[py, px]
            edge_out[y, x] = edge[py, px]


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
    finest = maps.colour is not None
    none = [wp.empty((1, 1), dtype=dtype, device=device) for dtype in (float, wp.vec3, wp.uint8)]
    of_finest = [maps.radius, maps.colour, maps.edge] if finest else none
    shutter = make_shutter(camera, twist, readout_s)
    inputs = [camera, shutter, int(finest), maps.vertex, maps.normal, maps.intensity, *of_finest]
    # The same memory in every frame: pages that were never written cost a third of the time.
    out = [scratch(f"shutter {k}", shape, dtype, device) for k, dtype in enumerate((wp.vec3, wp.vec3, float))]
    more = [
        scratch(f"shutter finest {k}", shape if finest else (1, 1), dtype, device)
        for k, dtype in enumerate((float, float, wp.vec3, wp.uint8))
    ]
    launch_rows(_global_shutter, camera.height, camera.width, inputs, [*out, *more], device)
    new = replace(maps, vertex=out[0], normal=out[1], intensity=out[2])
    return replace(new, depth=more[0], radius=more[1], colour=more[2], edge=more[3]) if finest else new
