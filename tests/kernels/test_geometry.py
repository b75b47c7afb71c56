"""Geometry channels against their twin."""

import numpy as np
import pytest
import warp as wp

from dsmap.frame import Intrinsics
from dsmap.kernels.camera import make_camera
from dsmap.kernels.geometry import geometry_channels
from dsmap.tools.twins import images as reference

CAMERA = make_camera(Intrinsics(48, 36, 40.0, 41.0, 23.2, 17.9))
LEVEL = np.array([0.0, -1.0, 0.0])


def surface(depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    vertex, normal, _, _ = reference.surface(CAMERA, depth)
    return vertex, normal


def channels(vertex: np.ndarray, normal: np.ndarray, up: np.ndarray, floor_height: float) -> np.ndarray:
    arrays = [wp.array(a.astype(np.float32), dtype=wp.vec3, device="cpu") for a in (vertex, normal)]
    return geometry_channels(*arrays, up, floor_height).numpy()


@pytest.mark.parametrize("threads", ["1", "3"])
@pytest.mark.parametrize("up", [(0.0, -1.0, 0.0), (0.36, -0.8, -0.48)])
def test_channels_agree_with_the_twin(threads, up, monkeypatch):
    monkeypatch.setenv("DSMAP_THREADS", threads)
    monkeypatch.setattr("dsmap.kernels.launch._SMALL", 0)
    rng = np.random.default_rng(4)
    depth = rng.uniform(0.1, 9.0, (36, 48))  # nearer than 0.3 m, and higher and lower than what is kept
    depth[rng.random(depth.shape) < 0.3] = 0
    vertex, normal = surface(depth)
    expected = reference.geometry_channels(vertex, normal, np.array(up), -1.2)
    got = channels(vertex, normal, np.array(up), -1.2)
    assert got.dtype == np.float32
    np.testing.assert_allclose(got, expected, atol=2e-5)
    assert (got[depth == 0] == 0).all()
    assert (got[0, :, 1] == 0).all() and got[0, :, 3].any(), "depth without a normal keeps its other channels"


def test_floor_wall_and_ceiling():
    """A camera 1.2 m above the floor of a room 2.5 m high, 4 m from a wall."""
    ray = reference.rays(CAMERA)
    with np.errstate(divide="ignore"):
        depth = np.minimum(4.0, np.where(ray[..., 1] > 0, 1.2 / ray[..., 1], 1.3 / -ray[..., 1]))
    got = channels(*surface(depth), LEVEL, -1.2)
    inside = got[3:-3, 3:-3]
    floor, ceiling, wall = inside[-1], inside[0], inside[len(inside) // 2]
    np.testing.assert_allclose(floor[:, 1], 1, atol=1e-3)
    np.testing.assert_allclose(floor[:, 2], (0 - 1) / 0.8, atol=1e-3)
    np.testing.assert_allclose(ceiling[:, 1], -1, atol=1e-3)
    np.testing.assert_allclose(ceiling[:, 2], (2.5 - 1) / 0.8, atol=1e-3)
    np.testing.assert_allclose(wall[:, 1], 0, atol=1e-3)
    np.testing.assert_allclose(wall[:, 0], (1 / 4 - 0.45) / 0.25, atol=1e-5)
