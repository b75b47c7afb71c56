"""The distance to the surface of surfels, and what a point on it looks like, against their twins."""

import numpy as np
import pytest

from dsmap.kernels import launch
from dsmap.kernels.surface import UNKNOWN, paint_points, surface_distance, surfel_points
from dsmap.tools.twins import surface as twins

SIDE, SPREAD, REACH = 0.05, 0.05, 0.15


@pytest.fixture(scope="module")
def surfels() -> dict[str, np.ndarray]:
    """Two crossing sheets and loose surfels, some without a class."""
    rng = np.random.default_rng(4)
    position = rng.uniform(-0.4, 0.4, (700, 3))
    position[:300, 2], position[300:600, 0] = 0.01 * rng.normal(size=300), 0.1
    normal = rng.normal(size=(700, 3))
    normal[:300] = [0, 0, 1] + 0.1 * normal[:300]
    normal[300:600] = [-1, 0, 0]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return {
        "position": position.astype(np.float32), "normal": normal.astype(np.float32),
        "colour": rng.uniform(0, 1, (700, 3)).astype(np.float32),
        "weight": rng.uniform(1, 50, 700).astype(np.float32),
        "radius": rng.uniform(0.01, 0.06, 700).astype(np.float32),
        "label": rng.integers(0, 3, 700).astype(np.uint8) * 5,
    }  # fmt: skip


def test_distance_is_that_of_the_twin(surfels):
    first, corners = (-4, -5, -4), 9
    found = surface_distance(surfel_points(surfels, REACH), first, corners, SIDE, SPREAD)
    at = (np.stack(np.meshgrid(*[np.arange(9)] * 3, indexing="ij"), -1).reshape(-1, 3) + first) * SIDE
    expected = twins.surface_distance(surfels, at, SIDE, SPREAD, REACH).reshape(found.shape)
    known = expected < UNKNOWN
    assert 0.2 < known.mean() < 0.95 and ((found < UNKNOWN) == known).mean() > 0.995, (
        "but for ties at the rim"
    )
    both = known & (found < UNKNOWN)
    assert np.allclose(found[both], expected[both], atol=2e-5)


def test_looks_are_those_of_the_twin(surfels):
    at = np.random.default_rng(1).uniform(-0.4, 0.4, (200, 3)).astype(np.float32)
    at[:3] += 5  # far from everything
    normal, colour, label, off = paint_points(surfel_points(surfels, REACH), at, SPREAD)
    expected = twins.paint_points(surfels, at, SPREAD, REACH)
    assert np.allclose(normal, expected[0], atol=1e-4) and np.allclose(colour, expected[1], atol=1e-4)
    assert (label == expected[2]).mean() > 0.99 and (off[:3] > 1e6).all() and (off[3:] < 100).any()


def test_threads_make_no_difference(surfels, monkeypatch):
    def distances(threads: int) -> np.ndarray:
        monkeypatch.setattr(launch, "num_threads", lambda: threads)
        return surface_distance(surfel_points(surfels, REACH), (-16, -16, -16), 33, SIDE, SPREAD)

    assert np.array_equal(distances(1), distances(3))
