"""Index map: which surfel every pixel of a view sees, by splatting surfel discs into a z-buffer."""

import numpy as np
import warp as wp

from dsmap.kernels.camera import Camera, project, rotate, to_transform, transform
from dsmap.kernels.launch import Slice, launch_items
from dsmap.kernels.pixel_min import key_buffer, make_key, merge_keys
from dsmap.kernels.types import SurfelMap

MAX_SPLAT = 3
"""Half-width [px] of the largest splat: a disc seen from very near is cut to 7 x 7 pixels."""
UNSTABLE_PENALTY = 0.05
"""Metres that an unstable surfel counts as deeper: it fills holes, but hides no stable surfel within 5 cm."""
ALWAYS = 2**31 - 1
"""Largest frame number: no upper end of a time window."""


@wp.struct
class Visible:
    """Which surfels of a map take part in a view."""

    min_weight: wp.float32  # those with at least this confidence,
    stable_weight: wp.float32  # and those below this one count as deeper by
    penalty: wp.float32  # [m],
    t_min: wp.int32  # updated in frames t_min
    t_max: wp.int32  # to t_max,
    max_depth: wp.float32  # [m] up to this depth


@wp.func
def ray_disc_depth(centre: wp.vec3, normal: wp.vec3, ray: wp.vec3) -> float:
    """Depth [m] at which a viewing ray (z = 1) crosses the plane of a disc that faces the camera."""
    return wp.dot(normal, centre) / wp.dot(normal, ray)


@wp.func
def _half_width(focal: float, slope: float, n: float, n_z: float, radius: float, z: float) -> float:
    """Half-width [px] of a projected disc: |dX - X/Z dZ| <= r |e - n (n . e)| with e = (1, 0, -X/Z)."""
    along = n - slope * n_z
    return focal * radius / (z - radius) * wp.sqrt(wp.max(1.0 + slope * slope - along * along, 0.0))


@wp.kernel(enable_backward=False)
def _splat(
    s: Slice,
    camera: Camera,
    T_camera_world: wp.mat44,
    select: Visible,
    position: wp.array(dtype=wp.vec3),
    normal: wp.array(dtype=wp.vec3),
    weight: wp.array(dtype=wp.float32),
    radius: wp.array(dtype=wp.float32),
    t_updated: wp.array(dtype=wp.int32),
    keys: wp.array2d(dtype=wp.uint64),
):
    block = s.first + wp.tid()
    for i in range(block * s.step, wp.min((block + 1) * s.step, s.count)):
        w = weight[i]
        t = t_updated[i]
        if w <= 0.0 or w < select.min_weight or t < select.t_min or t > select.t_max:
            continue
        p = transform(T_camera_world, position[i])
        r = radius[i]
        if p[2] <= 2.0 * r or p[2] - r > select.max_depth:
            continue
        u = project(camera, p)
        if (
            u[0] < -float(MAX_SPLAT)
            or u[1] < -float(MAX_SPLAT)
            or u[0] > float(camera.width + MAX_SPLAT)
            or u[1] > float(camera.height + MAX_SPLAT)
        ):
            continue
        n = rotate(T_camera_world, normal[i])
        facing = wp.dot(n, p)
        if facing >= 0.0:
            continue
        penalty = float(0.0)
        if w < select.stable_weight:
            penalty = select.penalty
        reach = float(MAX_SPLAT)
        dx = wp.min(_half_width(camera.fx, p[0] / p[2], n[0], n[2], r, p[2]), reach)
        dy = wp.min(_half_width(camera.fy, p[1] / p[2], n[1], n[2], r, p[2]), reach)
        x0 = wp.max(int(wp.ceil(u[0] - dx)), 0)
        x1 = wp.min(int(wp.floor(u[0] + dx)), camera.width - 1)
        y0 = wp.max(int(wp.ceil(u[1] - dy)), 0)
        y1 = wp.min(int(wp.floor(u[1] + dy)), camera.height - 1)
        for y in range(y0, y1 + 1):
            b = (float(y) - camera.cy) / camera.fy
            for x in range(x0, x1 + 1):
                a = (float(x) - camera.cx) / camera.fx
                towards = n[0] * a + n[1] * b + n[2]
                if towards < 0.0:
                    z = facing / towards
                    off = wp.vec3(z * a - p[0], z * b - p[1], z - p[2])
                    if wp.dot(off, off) <= r * r and z <= select.max_depth:
                        wp.atomic_min(keys, s.index, y * camera.width + x, make_key(z + penalty, i))


def render_index(
    surfels: SurfelMap,
    camera: Camera,
    T_world_camera: np.ndarray,
    *,
    max_depth: float,
    index: wp.array,
    min_weight: float = 0.0,
    stable_weight: float = 0.0,
    t_min: int = 0,
    t_max: int = ALWAYS,
    penalty: float = UNSTABLE_PENALTY,
) -> None:
    """Fill the index map of a view: the nearest surfel whose disc is hit by a pixel's ray.

    Discs that face away are not drawn. Surfels updated in frames t_min .. t_max with weight >= min_weight
    and depth <= max_depth [m] take part; those below stable_weight count as `penalty` [m] deeper.
    index: out, int32, shape (H, W) of the camera; -1 where no surfel is seen.
    """
    select = Visible()
    select.min_weight, select.stable_weight, select.penalty = min_weight, stable_weight, penalty
    select.t_min, select.t_max, select.max_depth = t_min, t_max, max_depth
    T_camera_world = to_transform(np.linalg.inv(T_world_camera))
    m = surfels
    keys = key_buffer(camera.height, camera.width, m.device)
    inputs = [camera, T_camera_world, select, m.position, m.normal, m.weight, m.radius, m.t_updated]
    launch_items(_splat, m.count, inputs, [keys], m.device)
    merge_keys(keys, index)
