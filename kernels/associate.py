"""Association: which surfel of the map every pixel of a frame measures again."""

import math

import numpy as np
import warp as wp

from dsmap.kernels.camera import Camera, ray, rotate, surfel_at, to_transform
from dsmap.kernels.launch import Slice, first_surfel, launch_blocks, launch_rows
from dsmap.kernels.pixel_min import key_buffer, make_key, merge_keys
from dsmap.kernels.types import FrameImages, FrameMaps, SurfelArrays, SurfelMap

_OTHER_NORMAL = wp.constant(1.0e6)
"""Added to the squared ray distance [m^2] of a surfel that only fits by position."""


@wp.struct
class AssociationGates:
    """What a surfel and a pixel may differ by."""

    along: wp.float32  # [m] along the pixel's ray,
    along_z2: wp.float32  # [1/m] or this times depth squared, where that is more
    cos_angle: wp.float32  # between the normals
    t_min: wp.int32  # frame number: older surfels are not asked


@wp.kernel
def _pack(s: Slice, frame: FrameImages, packed: wp.array2d(dtype=wp.vec4)):
    # What a surfel asks of its pixel, in one cache line; depth 0 where it may not have the pixel.
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, packed.shape[1], s.step):
        n = frame.normal[y, x]
        z = frame.vertex[y, x][2]
        packed[y, x] = wp.vec4(n[0], n[1], n[2], wp.where(frame.edge[y, x] == wp.uint8(0), z, 0.0))


@wp.kernel
def _claim(
    s: Slice,
    blocks: wp.array(dtype=wp.int32),
    camera: Camera,
    T_camera_world: wp.mat44,
    gates: AssociationGates,
    packed: wp.array2d(dtype=wp.vec4),
    m: SurfelArrays,
    keys: wp.array2d(dtype=wp.uint64),
):
    first = first_surfel(s, blocks, wp.tid())
    for i in range(first, wp.min(first + s.step, s.count)):
        p, at = surfel_at(camera, T_camera_world, i, gates.t_min, m)
        x = at[0]
        y = at[1]
        if x < 0:
            continue
        f = packed[y, x]
        d = f[3]
        if d <= 0.0:
            continue
        view = ray(camera, float(x), float(y))
        length2 = wp.length_sq(view)
        along = wp.dot(p - d * view, view)
        gate = wp.max(gates.along, gates.along_z2 * d * d)
        if along * along >= gate * gate * length2:
            continue
        cos_angle = wp.dot(wp.vec3(f[0], f[1], f[2]), rotate(T_camera_world, m.normal[i]))
        if cos_angle <= 0.0:
            continue
        # The squared distance to the ray orders surfels as the distance does.
        value = wp.length_sq(wp.cross(p, view)) / length2
        if cos_angle <= gates.cos_angle:
            value += _OTHER_NORMAL
        wp.atomic_min(keys, s.index, y * camera.width + x, make_key(value, i))


def associate_surfels(
    surfels: SurfelMap,
    camera: Camera,
    T_world_camera: np.ndarray,
    frame: FrameMaps,
    *,
    match: wp.array,
    max_ray_distance: float = 0.05,
    max_ray_distance_z2: float = 0.0,
    max_angle: float = 0.5,
    t_min: int = 0,
    visible: wp.array | None = None,
) -> None:
    """Match surfels to the pixels of a frame; every surfel and every pixel is in at most one match.

    Instead of a supersampled index map (Whelan et al. 2015 search a 4x one) each live surfel updated since
    frame t_min asks for the pixel it projects to. It may have it if it lies within
    max(max_ray_distance [m], max_ray_distance_z2 [1/m] x depth^2) of the vertex along the pixel's ray and
    the normals differ by less than max_angle [rad]; of several, the one nearest to the ray wins.
    frame: the maps of its level 0; edge pixels and pixels without a normal get none.
    match: out, int32, shape (H, W); surfel of each pixel, -1 where there is none, TAKEN (-2) where one lies
    but its normal differs (by less than 90 degrees): noise more often than another surface.
    visible: blocks that may hold surfels in view (see `culling.Blocks`); None walks the whole map.
    """
    gates = AssociationGates()
    gates.along, gates.along_z2 = max_ray_distance, max_ray_distance_z2
    gates.cos_angle, gates.t_min = math.cos(max_angle), t_min
    T_camera_world = to_transform(np.linalg.inv(T_world_camera))
    m = surfels
    keys = key_buffer(camera.height, camera.width, m.device)
    packed = wp.empty(match.shape, dtype=wp.vec4, device=m.device)
    launch_rows(_pack, *match.shape, [frame.images], [packed], m.device)
    inputs = [camera, T_camera_world, gates, packed, m.arrays]
    launch_blocks(_claim, visible, m.count, inputs, [keys], m.device)
    merge_keys(keys, match, limit=_OTHER_NORMAL)
