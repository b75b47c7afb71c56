"""What moves: points of a frame at places that an earlier frame looked through."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from dsmap.kernels.camera import Camera, pixel_at, to_transform, transform
from dsmap.kernels.launch import Slice, launch_rows


@wp.kernel
def _was_free(
    s: Slice,
    camera: Camera,
    margin: float,
    margin_z2: float,
    T_past_camera: wp.array(dtype=wp.mat44),
    past: wp.array3d(dtype=wp.float32),
    vertex: wp.array2d(dtype=wp.vec3),
    free: wp.array2d(dtype=wp.uint8),
    known: wp.array2d(dtype=wp.uint8),
):
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, camera.width, s.step):
        v = vertex[y, x]
        found = wp.uint8(0)
        first = wp.uint8(0)
        if v[2] > 0.0:
            for k in range(past.shape[0]):
                p = transform(T_past_camera[k], v)
                at = pixel_at(camera, p)
                if at[0] >= 0:
                    d = past[k, at[1], at[0]]
                    if k == 0 and d > 0.0:
                        first = wp.uint8(1)
                    if d > 0.0 and d - p[2] > wp.max(margin, margin_z2 * d * d):
                        found = wp.uint8(1)
        free[y, x] = found
        known[y, x] = first


@wp.kernel
def _carried(
    s: Slice,
    camera: Camera,
    max_step: float,
    T_last_camera: wp.mat44,
    last_depth: wp.array2d(dtype=wp.float32),
    last_things: wp.array2d(dtype=wp.uint8),
    vertex: wp.array2d(dtype=wp.vec3),
    things: wp.array2d(dtype=wp.uint8),
):
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, camera.width, s.step):
        v = vertex[y, x]
        found = wp.uint8(0)
        if v[2] > 0.0:
            p = transform(T_last_camera, v)
            at = pixel_at(camera, p)
            if at[0] >= 0 and wp.abs(last_depth[at[1], at[0]] - p[2]) < max_step:
                found = last_things[at[1], at[0]]
        things[y, x] = found


def was_free_space(
    camera: Camera,
    vertex: wp.array,
    T_past_camera: Sequence[np.ndarray],
    past: Sequence[np.ndarray],
    *,
    free: wp.array,
    known: wp.array,
    margin: float = 0.05,
    margin_z2: float = 0.0,
) -> None:
    """Mark the points of a frame that lie where an earlier frame saw nothing but a surface further away.

    vertex: vec3 [m], shape (H, W) of the camera; z = 0 where there is none.
    T_past_camera, past: for each earlier frame of the same camera the pose that takes points of this frame
    into it, shape (4, 4), and its depth [m], float32, shape (H, W), 0 where nothing is known.
    free: out, uint8, shape (H, W); 1 where for one of them the depth exceeds the point's by more than
    max(margin [m], margin_z2 [1/m] x depth^2).
    known: out, likewise; 1 where the first of them has depth at the point's place.
    """
    device = vertex.device
    poses = np.ascontiguousarray(np.stack(T_past_camera), dtype=np.float32)
    T = wp.array(poses, dtype=wp.mat44, device=device)
    depth = wp.array(np.ascontiguousarray(np.stack(past)), dtype=wp.float32, device=device)
    inputs = [camera, margin, margin_z2, T, depth, vertex]
    launch_rows(_was_free, camera.height, camera.width * len(past), inputs, [free, known], device)


def carried_over(
    camera: Camera,
    vertex: wp.array,
    T_last_camera: np.ndarray,
    last_depth: np.ndarray,
    last_things: np.ndarray,
    max_step: float,
) -> np.ndarray:
    """Which points of a frame belong to what was a thing in the last frame, uint8, shape (H, W).

    vertex: vec3 [m], shape (H, W) of the camera; z = 0 where there is none.
    T_last_camera: takes points of this frame into the last one, shape (4, 4).
    last_depth, last_things: depth [m] of the last frame, float32, and its things, uint8, shape (H, W).
    max_step: a thing is at most this much [m] nearer or further than it was.
    """
    device = vertex.device
    depth = wp.array(np.ascontiguousarray(last_depth), dtype=wp.float32, device=device)
    last = wp.array(last_things, dtype=wp.uint8, device=device)
    things = wp.empty(vertex.shape, dtype=wp.uint8, device=device)
    inputs = [camera, max_step, to_transform(T_last_camera), depth, last, vertex]
    launch_rows(_carried, camera.height, camera.width, inputs, [things], device)
    return things.numpy()
