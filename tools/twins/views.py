"""Slow twins of kernels that compare a frame or a surfel with views: what moves, what becomes active again."""

import numpy as np

from dsmap.tools.twins import surfels


def was_free_space(camera, vertex, poses, past, margin, margin_z2) -> tuple[np.ndarray, np.ndarray]:
    """Points where an earlier frame saw further (free), and where the first one has depth (known); uint8, (H, W)."""
    free, known = (np.zeros(vertex.shape[:2], np.uint8) for _ in range(2))
    for y, x in np.ndindex(free.shape):
        for number, (T, depth) in enumerate(zip(poses, past, strict=True)):
            if vertex[y, x, 2] > 0:
                p = T[:3, :3] @ vertex[y, x] + T[:3, 3]
                at = surfels.pixel(camera, p)
                if at and depth[at] > 0:
                    known[y, x] |= number == 0
                    free[y, x] |= depth[at] - p[2] > max(margin, margin_z2 * depth[at] ** 2)
    return free, known


def carried_over(camera, vertex, T, depth, things, max_step) -> np.ndarray:
    """Points that belong to what was a thing in the last frame, uint8, shape (H, W)."""
    found = np.zeros(vertex.shape[:2], np.uint8)
    for y, x in np.ndindex(found.shape):
        p = T[:3, :3] @ vertex[y, x] + T[:3, 3]
        at = surfels.pixel(camera, p)
        if vertex[y, x, 2] > 0 and at and abs(depth[at] - p[2]) < max_step:
            found[y, x] = things[at]
    return found


def reactivate(s, camera, T_world_camera, inactive, active, *, t_min, distance, distance_z2) -> np.ndarray:
    """Which surfels become active, bool, shape (N,); one surfel after the other."""
    position, normal = surfels.into_camera(T_world_camera, s)
    woken = np.zeros(len(s["weight"]), dtype=bool)
    for i, p in enumerate(position):
        at = surfels.pixel(camera, p)
        if s["weight"][i] <= 0 or s["t_updated"][i] >= t_min or not at:
            continue
        z, front = inactive[at][2], active[at][2]
        gate = max(distance, distance_z2 * z * z)
        hidden = front > 0 and p[2] - front > gate
        woken[i] = normal[i] @ p < 0 and z > 0 and abs(p[2] - z) <= gate and not hidden
    return woken
