"""Reactivation: inactive surfels that a view of the active map agrees with become active again."""

from typing import Any

import numpy as np
import warp as wp

from dsmap.kernels.camera import Camera, pixel_at, rotate, to_transform, transform
from dsmap.kernels.launch import Slice, first_surfel, launch_blocks, num_slices
from dsmap.kernels.types import SurfelArrays, SurfelMap


@wp.struct
class AgreementGates:
    """Which inactive surfels a view may reactivate."""

    time: wp.int32  # now [frame]
    t_min: wp.int32  # surfels updated since are active already
    distance: wp.float32  # [m] along z,
    distance_z2: wp.float32  # [1/m] or this times depth squared, where that is more


@wp.kernel
def _reactivate(
    s: Slice,
    blocks: wp.array(dtype=wp.int32),
    camera: Camera,
    T_camera_world: wp.mat44,
    rules: AgreementGates,
    inactive: wp.array2d(dtype=wp.vec3),
    active: wp.array2d(dtype=wp.vec3),
    m: SurfelArrays,
    count: wp.array(dtype=wp.int32),
):
    first = first_surfel(s, blocks, wp.tid())
    woken = int(0)
    for i in range(first, wp.min(first + s.step, s.count)):
        if m.weight[i] <= 0.0 or m.t_updated[i] >= rules.t_min:
            continue
        p = transform(T_camera_world, m.position[i])
        at = pixel_at(camera, p)
        if at[0] < 0 or wp.dot(rotate(T_camera_world, m.normal[i]), p) >= 0.0:
            continue
        z = inactive[at[1], at[0]][2]
        gate = wp.max(rules.distance, rules.distance_z2 * z * z)
        if z <= 0.0 or wp.abs(p[2] - z) > gate:
            continue  # not on the surface that the inactive view shows
        front = active[at[1], at[0]][2]
        if front > 0.0 and p[2] - front > gate:
            continue  # hidden by what stands there now
        m.t_updated[i] = rules.time
        woken += 1
    if woken > 0:
        wp.atomic_add(count, s.index, woken)


def reactivate(
    surfels: SurfelMap,
    camera: Camera,
    T_world_camera: np.ndarray,
    inactive: wp.array,
    active: wp.array,
    *,
    time: int,
    t_min: int,
    distance: float = 0.05,
    distance_z2: float = 0.0,
    visible: Any = None,
) -> int:
    """Make inactive surfels in view active (t_updated = `time`); returns how many.

    A surfel last updated before frame `t_min` wakes up if it faces the camera, lies on the surface of the
    inactive view (within max(distance [m], distance_z2 [1/m] x depth^2)) and not behind the active one.
    Those in front of the active surface wake up too: only active surfels are judged by free space.

    inactive, active: vertex maps of the camera, vec3 [m], shapes (H, W); z = 0 where they see nothing.
    visible: blocks that may hold surfels in view (see `culling.Blocks`); None walks the whole map.
    """
    rules = AgreementGates()
    rules.time, rules.t_min = time, t_min
    rules.distance, rules.distance_z2 = distance, distance_z2
    m = surfels
    count = wp.zeros(num_slices(m.device), dtype=wp.int32, device=m.device)
    T_camera_world = to_transform(np.linalg.inv(T_world_camera))
    inputs = [camera, T_camera_world, rules, inactive, active, m.arrays]
    launch_blocks(_reactivate, visible, m.count, inputs, [count], m.device)
    return int(count.numpy().sum())
