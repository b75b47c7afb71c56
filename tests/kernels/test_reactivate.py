"""Reactivation against its slow twin, and what it must leave alone."""

import numpy as np
import pytest
import warp as wp

from dsmap.kernels.reactivate import reactivate
from dsmap.tools.twins import views
from dsmap.tools.twins.scene import CAMERA, SCENE_INTRINSICS, TIME, frame_arrays, pose, surfel_map

T_MIN, DISTANCE, Z2 = 20, 0.02, 0.01


@pytest.mark.parametrize("seed", [0, 1])
def test_reactivate(seed):
    T_world_camera = pose(seed)
    surfels = surfel_map(T_world_camera, seed=seed)
    before = {name: array.copy() for name, array in surfels.numpy().items()}
    inactive = frame_arrays(seed)["vertex"]
    active = inactive + np.float32([0, 0, 0.03]) * (np.arange(SCENE_INTRINSICS.width) % 3 - 1)[None, :, None]
    active[inactive[..., 2] == 0] = 0
    active[:10] = 0  # nothing is known there now
    gates = {"t_min": T_MIN, "distance": DISTANCE, "distance_z2": Z2}
    expected = views.reactivate(before, CAMERA, T_world_camera, inactive, active, **gates)
    assert 100 < expected.sum() < len(expected) / 2
    count = reactivate(
        surfels, CAMERA, T_world_camera, wp.array(inactive, dtype=wp.vec3), wp.array(active, dtype=wp.vec3),
        time=TIME, **gates,
    )  # fmt: skip
    woken = surfels.numpy()["t_updated"] != before["t_updated"]
    assert (woken != expected).sum() <= 2, "a surfel on a gate may fall either way in single precision"
    assert count == woken.sum() and (surfels.numpy()["t_updated"][woken] == TIME).all()
    for name in before.keys() - {"t_updated"}:
        np.testing.assert_array_equal(surfels.numpy()[name], before[name])
