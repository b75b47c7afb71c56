"""Clean-up: surfels that were never confirmed, that the camera sees through, or that are double, die."""

import numpy as np
import warp as wp

from dsmap.kernels.camera import Camera, pixel_at, to_transform, transform
from dsmap.kernels.launch import Slice, first_surfel, launch_blocks, num_slices
from dsmap.kernels.types import FrameImages, FrameMaps, SurfelArrays, SurfelMap

SAME_DEPTH = wp.constant(0.01)
SAME_DEPTH_Z2 = wp.constant(0.005)
"""Duplicates lie within SAME_DEPTH [m] + SAME_DEPTH_Z2 [1/m] x depth^2 of the measured surface."""
SAME_NORMAL = wp.constant(0.8)
"""Cosine between the normals of duplicates."""


@wp.struct
class Rules:
    """When a surfel is taken out."""

    time: wp.int32  # now [frame]
    t_min: wp.int32  # surfels last updated before are not judged by this view
    max_unseen: wp.int32  # frames that an unstable surfel may wait for its next update
    stable_weight: wp.float32
    decay: wp.float32  # weight that a stable surfel loses when seen through,
    decay_share: wp.float32  # or this share of it, if that is more
    margin: wp.float32  # [m] in front of the measured surface,
    margin_z2: wp.float32  # [1/m] or this times depth squared, where that is more
    max_depth: wp.float32  # [m] measurements beyond are no evidence


@wp.func
def _seen_through(camera: Camera, p: wp.vec3, rules: Rules, frame: FrameImages) -> bool:
    """Whether the measured surface lies clearly behind a camera-frame point."""
    at = pixel_at(camera, p)
    if at[0] < 0:
        return False
    d = frame.depth[at[1], at[0]]
    if d <= 0.0 or d > rules.max_depth or frame.edge[at[1], at[0]] != wp.uint8(0):
        return False
    return d - p[2] > wp.max(rules.margin, rules.margin_z2 * d * d)


@wp.func
def _is_duplicate(
    camera: Camera,
    p: wp.vec3,
    i: int,
    time: int,
    frame: FrameImages,
    match: wp.array2d(dtype=wp.int32),
    m: SurfelArrays,
) -> bool:
    """Whether the pixel's matched surfel, of more confidence, stands for the same bit of surface as surfel i.

    A surfel smaller than the pixel is none: a nearer camera saw more detail than this one can.
    """
    at = pixel_at(camera, p)
    if at[0] < 0:
        return False
    j = match[at[1], at[0]]
    if j < 0:
        return False
    if m.t_updated[j] != time:  # only a weight that this launch does not change can be compared with
        return False
    d = frame.depth[at[1], at[0]]
    near = wp.abs(d - p[2]) < SAME_DEPTH + SAME_DEPTH_Z2 * d * d
    return (
        near
        and m.radius[i] * camera.fx > p[2]
        and m.weight[i] < m.weight[j]
        and wp.dot(m.normal[i], m.normal[j]) > SAME_NORMAL
    )


@wp.kernel
def _judge(
    s: Slice,
    blocks: wp.array(dtype=wp.int32),
    camera: Camera,
    T_camera_world: wp.mat44,
    rules: Rules,
    frame: FrameImages,
    match: wp.array2d(dtype=wp.int32),
    m: SurfelArrays,
    dead: wp.array(dtype=wp.int32),
):
    first = first_surfel(s, blocks, wp.tid())
    gone = int(0)
    for i in range(first, wp.min(first + s.step, s.count)):
        w = m.weight[i]
        t = m.t_updated[i]
        if w > 0.0:
            if w < rules.stable_weight and rules.time - t > rules.max_unseen:
                m.weight[i] = 0.0
                gone += 1
            elif t >= rules.t_min:
                p = transform(T_camera_world, m.position[i])
                # A surfel that was fused just now (t == now) is neither: it is where the surface is.
                if t < rules.time and _is_duplicate(camera, p, i, rules.time, frame, match, m):
                    m.weight[i] = 0.0
                    gone += 1
                elif t < rules.time and _seen_through(camera, p, rules, frame):
                    left = float(0.0)
                    if w >= rules.stable_weight:
                        left = wp.max(w - wp.max(rules.decay, rules.decay_share * w), 0.0)
                    m.weight[i] = left
                    if left == 0.0:
                        gone += 1
    if gone > 0:
        wp.atomic_add(dead, s.index, gone)


def prune(
    surfels: SurfelMap,
    camera: Camera,
    T_world_camera: np.ndarray,
    frame: FrameMaps,
    match: wp.array,
    *,
    time: int,
    stable_weight: float = 10.0,
    max_unseen: int = 20,
    t_min: int = 0,
    max_depth: float = 1e9,
    margin: float = 0.05,
    margin_z2: float = 0.0,
    decay: float = 3.0,
    decay_share: float = 0.4,
    walk: wp.array | None = None,
) -> int:
    """Mark dead surfels (weight 0); returns how many died now.

    Unstable surfels (weight < stable_weight) die when not updated for more than max_unseen frames.
    A surfel updated since frame t_min that stands more than max(margin [m], margin_z2 [1/m] x depth^2) in
    front of the surface measured in its pixel is seen through: an unstable one dies at once, a stable one
    loses max(decay, decay_share x weight), so that it takes several frames, not one bad depth image, to erase it,
    and about ten times as many, not hundreds, if it has been seen for minutes.
    A surfel without a match whose pixel is matched by a surfel of more confidence, at the same depth and with
    the same normal, is a duplicate and dies, unless it is finer than the pixel.
    frame: the maps of its level 0; pixels on edges or beyond max_depth say nothing about what stands before them.
    match: of `associate_surfels`, shape (H, W).
    walk: blocks in view and those in which surfels may be overdue (see `culling.Blocks`); None: the whole map.
    """
    rules = Rules()
    rules.time, rules.t_min, rules.max_unseen = time, t_min, max_unseen
    rules.stable_weight = stable_weight
    rules.decay, rules.decay_share = decay, decay_share
    rules.margin, rules.margin_z2, rules.max_depth = margin, margin_z2, max_depth
    m = surfels
    dead = wp.zeros(num_slices(m.device), dtype=wp.int32, device=m.device)
    T_camera_world = to_transform(np.linalg.inv(T_world_camera))
    inputs = [camera, T_camera_world, rules, frame.images, match, m.arrays]
    launch_blocks(_judge, walk, m.count, inputs, [dead], m.device)
    return int(dead.numpy().sum())
