"""What moves: points of a frame at places that an earlier frame looked through."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from dsmap.kernels.camera import Camera, pixel_at, transform
from dsmap.kernels.launch import Slice, launch_rows


@wp.kernel(enable_backward=False)
def _was_free(
    s: Slice,
    camera: Camera,
    margin: float,
    margin_z2: float,
    T_past_camera: wp.array(dtype=wp.mat44),
    past: wp.array3d(dtype=wp.float32),
    vertex: wp.array2d(dtype=wp.vec3),
    free: wp.array2d(dtype=wp.uint8),
):
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, camera.width, s.step):
        v = vertex[y, x]
        found = wp.uint8(0)
        if v[2] > 0.0:
            for k in range(past.shape[0]):
                p = transform(T_past_camera[k], v)
                at = pixel_at(camera, p)
                if at[0] >= 0:
                    d = past[k, at[1], at[0]]
                    if d > 0.0 and d - p[2] > wp.max(margin, margin_z2 * d * d):
                        found = wp.uint8(1)
        free[y, x] = found


def was_free(
    camera: Camera,
    vertex: wp.array,
    T_past_camera: Sequence[np.ndarray],
    past: Sequence[np.ndarray],
    *,
    free: wp.array,
    margin: float = 0.05,
    margin_z2: float = 0.0,
) -> None:
    """Mark the points of a frame that lie where an earlier frame saw nothing but a surface further away.

    vertex: vec3 [m], shape (H, W) of the camera; z = 0 where there is none.
    T_past_camera, past: for each earlier frame of the same camera the pose that takes points of this frame
    into it, shape (4, 4), and its depth [m], float32, shape (H, W), 0 where nothing is known.
    free: out, uint8, shape (H, W); 1 where for one of them the depth exceeds the point's by more than
    max(margin [m], margin_z2 [1/m] x depth^2).
    """
    device = vertex.device
    poses = np.ascontiguousarray(np.stack(T_past_camera), dtype=np.float32)
    T = wp.array(poses, dtype=wp.mat44, device=device)
    depth = wp.array(np.ascontiguousarray(np.stack(past)), dtype=wp.float32, device=device)
    inputs = [camera, margin, margin_z2, T, depth, vertex]
    launch_rows(_was_free, camera.height, camera.width * len(past), inputs, [free], device)
