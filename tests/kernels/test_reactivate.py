"""Reactivation against its slow twin, and what it must leave alone."""

import numpy as np
import pytest
import warp as wp

from dsmap.kernels.reactivate import reactivate
from dsmap.tools.twins.scene import CAMERA, INTRINSICS, TIME, frame_arrays, pose, surfel_map

T_MIN, DISTANCE, Z2 = 20, 0.02, 0.01


def twin(surfels: dict, T_world_camera: np.ndarray, inactive: np.ndarray, active: np.ndarray) -> np.ndarray:
    """Which surfels wake up, bool, shape (N,); one surfel after the other."""
    T = np.linalg.inv(T_world_camera)
    woken = np.zeros(len(surfels["weight"]), dtype=bool)
    for i in range(len(woken)):
        p = T[:3, :3] @ surfels["position"][i] + T[:3, 3]
        if surfels["weight"][i] <= 0 or surfels["t_updated"][i] >= T_MIN or p[2] <= 0:
            continue
        x = int(np.floor(INTRINSICS.fx * p[0] / p[2] + INTRINSICS.cx + 0.5))
        y = int(np.floor(INTRINSICS.fy * p[1] / p[2] + INTRINSICS.cy + 0.5))
        if not (0 <= x < INTRINSICS.width and 0 <= y < INTRINSICS.height):
            continue
        z, front = inactive[y, x, 2], active[y, x, 2]
        gate = max(DISTANCE, Z2 * z * z)
        facing = (T[:3, :3] @ surfels["normal"][i]) @ p < 0
        hidden = front > 0 and p[2] - front > gate
        woken[i] = facing and z > 0 and abs(p[2] - z) <= gate and not hidden
    return woken


@pytest.mark.parametrize("seed", [0, 1])
def test_reactivate(seed):
    T_world_camera = pose(seed)
    surfels = surfel_map(T_world_camera, seed=seed)
    before = {name: array.copy() for name, array in surfels.numpy().items()}
    inactive = frame_arrays(seed)["vertex"]
    active = inactive + np.float32([0, 0, 0.03]) * (np.arange(INTRINSICS.width) % 3 - 1)[None, :, None]
    active[inactive[..., 2] == 0] = 0
    active[:10] = 0  # nothing is known there now
    expected = twin(before, T_world_camera, inactive, active)
    assert 100 < expected.sum() < len(expected) / 2
    count = reactivate(
        surfels, CAMERA, T_world_camera, wp.array(inactive, dtype=wp.vec3), wp.array(active, dtype=wp.vec3),
        time=TIME, t_min=T_MIN, distance=DISTANCE, distance_z2=Z2,
    )  # fmt: skip
    woken = surfels.numpy()["t_updated"] != before["t_updated"]
    assert (woken != expected).sum() <= 2, "a surfel on a gate may fall either way in single precision"
    assert count == woken.sum() and (surfels.numpy()["t_updated"][woken] == TIME).all()
    for name in before.keys() - {"t_updated"}:
        np.testing.assert_array_equal(surfels.numpy()[name], before[name])
