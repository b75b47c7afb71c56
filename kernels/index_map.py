"""Index map: which surfel every pixel of a view sees.

A dense map has about one surfel a pixel, and drawing every disc whole would touch each pixel six times. So
a disc is drawn whole only where the camera is nearer to it than the one that measured it; most others
write their centre's pixel only, and a second pass fills the pixels between them from the 3x3 neighbourhood,
with the same test: does the pixel's ray hit the disc. Of the discs on the front surface the one nearest
to the ray is taken, not the foremost, which would pull every noisy surface towards the camera.
"""

from typing import Any

import numpy as np
import warp as wp

from dsmap.kernels.camera import Camera, project, ray, rotate, to_transform, transform
from dsmap.kernels.launch import Slice, first_surfel, launch_blocks, launch_rows
from dsmap.kernels.pixel_min import (
    EMPTY,
    key_buffer,
    key_index,
    key_value,
    make_key,
    release,
    scratch,
    take_key,
)
from dsmap.kernels.prefetch import AHEAD, fetch_early
from dsmap.kernels.types import SurfelArrays, SurfelMap

WHOLE_FROM = wp.constant(2.2)
"""Discs whose shorter half-axis is at least this [px] are drawn whole: centres may be 1.5 pixels apart."""
COARSE_FROM = wp.constant(1.4)
"""... and in a map with a finest resolution this, where that is more than a pixel: centres are further apart there."""
MAX_SPLAT = wp.constant(3)
"""Half-width [px] of the largest whole disc: one seen from very near is cut to 7 x 7 pixels..."""
MAX_COARSE_SPLAT = wp.constant(16)
"""... and in a map with a finest resolution to 33 x 33: there a disc is as large as that."""
_STEPS = wp.types.vector(9, wp.int32)
_STEP_X = wp.constant(_STEPS(0, 0, -1, 1, 0, -1, 1, -1, 1))
_STEP_Y = wp.constant(_STEPS(0, -1, 0, 0, 1, -1, -1, 1, 1))
UNSTABLE_PENALTY = 0.05
"""An unstable surfel fills holes, but hides no stable surfel within this distance [m] behind it."""
_NOTHING = wp.constant(1.0e30)
"""Depth [m] of a pixel in which no surfel lies."""
ALWAYS = 2**31 - 1
"""Largest frame number: no upper end of a time window."""

_face = wp.types.vector(length=8, dtype=wp.float32)
"""Of the surfel whose key won a pixel, in the camera's frame, in half a cache line: centre [m], squared radius,
normal, weight."""


@wp.struct
class Winners:
    """Of every pixel the surfel whose key won it. One row: kernels index them by pixel."""

    index: wp.array(dtype=wp.int32)  # -1: none
    rank: wp.array(dtype=wp.float32)  # depth by which it was compared [m]
    face: wp.array(dtype=_face)


@wp.struct
class Visible:
    """Which surfels of a map take part in a view."""

    min_weight: wp.float32  # those with at least this confidence,
    stable_weight: wp.float32  # and those below this one stand back by
    penalty: wp.float32  # [m],
    t_min: wp.int32  # updated in frames t_min
    t_max: wp.int32  # to t_max,
    max_depth: wp.float32  # [m] up to this depth
    resolution: wp.float32  # [m] the map's finest; 0: about a surfel a pixel


@wp.func
def ray_disc_depth(centre: wp.vec3, normal: wp.vec3, view: wp.vec3) -> float:
    """Depth [m] at which a viewing ray (z = 1) crosses the plane of a disc that faces the camera."""
    return wp.dot(normal, centre) / wp.dot(normal, view)


@wp.func
def _thickness(z: float) -> float:
    """Depths that differ by less than this [m] are one surface: a few times the noise of a depth camera."""
    return 0.01 + 0.005 * z * z


@wp.func
def _rank_depth(select: Visible, z: float, weight: float) -> float:
    """The depth by which surfels are compared: unstable ones stand back behind the surface they lie on."""
    if weight < select.stable_weight:
        return z + select.penalty + _thickness(z)
    return z


@wp.func
def _draw_whole(
    camera: Camera,
    select: Visible,
    p: wp.vec3,
    n: wp.vec3,
    r: float,
    weight: float,
    item: int,
    index: int,
    keys: wp.array2d(dtype=wp.uint64),
):
    """Ask for every pixel whose ray hits the disc, not too far from its centre.

    In a map with a finest resolution discs overlap, and the rim of one stands back behind the middle of another.
    """
    u = project(camera, p)
    largest = float(MAX_SPLAT)
    back = float(0.0)
    if select.resolution > 0.0:
        largest = float(MAX_COARSE_SPLAT)
        back = _thickness(p[2]) / (r * r)
    dx = wp.min(camera.fx * r / p[2], largest)
    dy = wp.min(camera.fy * r / p[2], largest)
    x0 = wp.max(int(wp.ceil(u[0] - dx)), 0)
    x1 = wp.min(int(wp.floor(u[0] + dx)), camera.width - 1)
    y0 = wp.max(int(wp.ceil(u[1] - dy)), 0)
    y1 = wp.min(int(wp.floor(u[1] + dy)), camera.height - 1)
    for y in range(y0, y1 + 1):
        for x in range(x0, x1 + 1):
            view = ray(camera, float(x), float(y))
            if wp.dot(n, view) < 0.0:
                z = ray_disc_depth(p, n, view)
                off = wp.length_sq(z * view - p)
                if off <= r * r and z <= select.max_depth:
                    depth = _rank_depth(select, z, weight) + back * off
                    wp.atomic_min(keys, index, y * camera.width + x, make_key(depth, item))


@wp.kernel
def _splat(
    s: Slice,
    blocks: wp.array(dtype=wp.int32),
    camera: Camera,
    T_camera_world: wp.mat44,
    select: Visible,
    m: SurfelArrays,
    keys: wp.array2d(dtype=wp.uint64),
):
    first = first_surfel(s, blocks, wp.tid())
    border = float(MAX_SPLAT)
    if select.resolution > 0.0:
        border = float(MAX_COARSE_SPLAT)
    for i in range(first, wp.min(first + s.step, s.count)):
        w = m.weight[i]
        t = m.t_updated[i]
        if w <= 0.0 or w < select.min_weight or t < select.t_min or t > select.t_max:
            continue
        p = transform(T_camera_world, m.position[i])
        r = m.radius[i]
        if p[2] <= 2.0 * r or p[2] > select.max_depth:
            continue
        u = project(camera, p)
        if u[0] < -border or u[1] < -border:
            continue
        if u[0] > float(camera.width) + border or u[1] > float(camera.height) + border:
            continue
        n = rotate(T_camera_world, m.normal[i])
        facing = -wp.dot(n, p)
        if facing <= 0.0:
            continue
        x = int(wp.floor(u[0] + 0.5))
        y = int(wp.floor(u[1] + 0.5))
        inside = x >= 0 and y >= 0 and x < camera.width and y < camera.height
        # The shorter half-axis of the projected disc is f r cos / z, with cos = facing / |p|.
        whole_from = float(WHOLE_FROM)
        if select.resolution * camera.fx > 1.4 * p[2]:
            whole_from = float(COARSE_FROM)
        if inside and camera.fx * r * facing < whole_from * p[2] * wp.length(p):
            wp.atomic_min(keys, s.index, y * camera.width + x, make_key(_rank_depth(select, p[2], w), i))
        else:
            _draw_whole(camera, select, p, n, r, w, i, s.index, keys)


@wp.kernel
def _centres(
    s: Slice,
    camera: Camera,
    T_camera_world: wp.mat44,
    m: SurfelArrays,
    keys: wp.array2d(dtype=wp.uint64),
    winner: Winners,
):
    # The winner of every pixel, side by side: its neighbours ask for it up to nine times.
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, camera.width, s.step):
        at = y * camera.width + x
        soon = key_index(keys[0, wp.min(at + AHEAD, keys.shape[1] - 1)])  # of EMPTY: -1
        fetch_early(m.position, soon)
        fetch_early(m.normal, soon)
        fetch_early(m.weight, soon)
        fetch_early(m.radius, soon)
        best = take_key(keys, at)
        i = int(-1)
        depth = float(_NOTHING)
        if best != EMPTY:
            i = key_index(best)
            depth = key_value(best)
            r = m.radius[i]
            p = transform(T_camera_world, m.position[i])
            n = rotate(T_camera_world, m.normal[i])
            winner.face[at] = _face(p[0], p[1], p[2], r * r, n[0], n[1], n[2], m.weight[i])
        winner.index[at] = i
        winner.rank[at] = depth


@wp.func
def _best_around(
    camera: Camera,
    select: Visible,
    x: int,
    y: int,
    front: float,
    winner: Winners,
) -> int:
    """The pixel of the 3x3 neighbourhood (-1: none) whose surfel is, on the surface in front, nearest to the ray."""
    view = ray(camera, float(x), float(y))
    best = int(-1)
    best_depth = float(0.0)
    best_off = float(0.0)
    for k in range(9):
        # The pixel itself and its four neighbours first; the corners only if none of them is in front.
        # Over the border of the image lies the pixel at the border: asked twice it answers the same.
        xx = wp.clamp(x + _STEP_X[k], 0, camera.width - 1)
        yy = wp.clamp(y + _STEP_Y[k], 0, camera.height - 1)
        at = yy * camera.width + xx
        if winner.rank[at] < _NOTHING and (k < 5 or best < 0 or best_depth > front + _thickness(front)):
            f = winner.face[at]
            p = wp.vec3(f[0], f[1], f[2])
            n = wp.vec3(f[4], f[5], f[6])
            towards = wp.dot(n, view)
            z = wp.dot(n, p) / towards
            off = wp.length_sq(z * view - p)
            depth = _rank_depth(select, z, f[7])
            slack = _thickness(best_depth)
            # Without branches: noise decides each of these, which a CPU cannot foresee.
            hit = int(k == 0) | (int(off <= f[3]) & int(z <= select.max_depth))
            nearer = int(depth < best_depth + slack) & int(off < best_off)
            better = int(best < 0) | int(depth < best_depth - slack) | nearer
            if (int(towards < 0.0) & hit & better) != 0:
                best = at
                best_depth = depth
                best_off = off
    return best


@wp.kernel
def _select(
    s: Slice,
    camera: Camera,
    select: Visible,
    winner: Winners,
    index: wp.array2d(dtype=wp.int32),
    vertex: wp.array2d(dtype=wp.vec3),
    normal: wp.array2d(dtype=wp.vec3),
):
    row, lane = wp.tid()
    y = s.first + s.stride * row
    above = wp.max(y - 1, 0) * camera.width
    here = y * camera.width
    below = wp.min(y + 1, camera.height - 1) * camera.width
    rank = winner.rank
    for x in range(lane, camera.width, s.step):
        left = wp.max(x - 1, 0)
        right = wp.min(x + 1, camera.width - 1)
        front = wp.min(wp.min(rank[above + left], rank[above + x]), rank[above + right])
        front = wp.min(front, wp.min(wp.min(rank[here + left], rank[here + x]), rank[here + right]))
        front = wp.min(front, wp.min(wp.min(rank[below + left], rank[below + x]), rank[below + right]))
        seen = int(-1)
        v = wp.vec3(0.0, 0.0, 0.0)
        n = wp.vec3(0.0, 0.0, 0.0)
        if front < _NOTHING:
            at = here + x
            if rank[at] > front + _thickness(front):
                at = _best_around(camera, select, x, y, front, winner)
            if at >= 0:
                seen = winner.index[at]
                f = winner.face[at]
                r = ray(camera, float(x), float(y))
                n = wp.vec3(f[4], f[5], f[6])
                v = ray_disc_depth(wp.vec3(f[0], f[1], f[2]), n, r) * r
        index[y, x] = seen
        vertex[y, x] = v
        normal[y, x] = n


def _winners(pixels: int, device: Any) -> Winners:
    """Scratch memory for the winners of an image."""
    winner = Winners()
    for name, dtype in (("index", wp.int32), ("rank", wp.float32), ("face", _face)):
        setattr(winner, name, scratch(f"winner {name}", (pixels,), dtype, device))
    return winner


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
    visible: wp.array | None = None,
    vertex: wp.array | None = None,
    normal: wp.array | None = None,
    resolution: float = 0.0,
) -> None:
    """Fill the index map of a view: on the front surface, the surfel nearest to each pixel's ray.

    A pixel sees a surfel that projects into it or whose disc its ray hits; discs that face away are not
    drawn. Surfels updated in frames t_min .. t_max with weight >= min_weight and depth <= max_depth [m]
    take part; those below stable_weight fill holes, but hide no stable one within `penalty` [m].
    visible: blocks that may hold surfels in view (see `culling.Blocks`); None walks the whole map.
    resolution: the map's finest [m], for which its discs were made; 0: about a surfel a pixel.
    index: out, int32, shape (H, W) of the camera; -1 where no surfel is seen.
    vertex, normal: out if given, vec3 [m], shape (H, W): where the pixel's ray meets the surfel's disc and the
    disc's normal, in the camera's frame; 0 where no surfel is seen.
    """
    select = Visible()
    select.min_weight, select.stable_weight, select.penalty = min_weight, stable_weight, penalty
    select.t_min, select.t_max, select.max_depth, select.resolution = t_min, t_max, max_depth, resolution
    m, T_camera_world, shape = surfels, to_transform(np.linalg.inv(T_world_camera)), index.shape
    keys = key_buffer(*shape, m.device)
    launch_blocks(_splat, visible, m.count, [camera, T_camera_world, select, m.arrays], [keys], m.device)
    winner = _winners(shape[0] * shape[1], m.device)
    launch_rows(_centres, *shape, [camera, T_camera_world, m.arrays], [keys, winner], m.device)
    release(keys)
    if vertex is None or normal is None:
        vertex, normal = (scratch(name, shape, wp.vec3, m.device) for name in ("vertex", "normal"))
    launch_rows(_select, *shape, [camera, select, winner], [index, vertex, normal], m.device)
