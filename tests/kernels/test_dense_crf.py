"""Mean field over a map: against its twin that sums all pairs, and on maps with nothing to refine."""

import numpy as np
import pytest
from synthetic_map import room_arrays

from dsmap.fusion.config import CrfConfig
from dsmap.fusion.objects.crf import gaussian_kernels, refine_by_crf
from dsmap.kernels.dense_crf import find_neighbours, mean_field
from dsmap.tools.twins import dense_crf as reference_crf


def small_map(count: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points on two walls that meet, half of each painted; noisy probabilities."""
    rng = np.random.default_rng(4)
    u, v, side = rng.random(count) * 0.4, rng.random(count) * 0.4, rng.random(count) < 0.5
    position = np.where(side[:, None], np.stack([u, v, 0 * u], 1), np.stack([0 * u, v, u], 1))
    normal = np.where(side[:, None], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]) + rng.normal(0, 0.03, (count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    colour = np.where(v[:, None] < 0.2, 0.3, 0.7) + rng.normal(0, 0.02, (count, 3))
    mass = rng.integers(1, 9, count)
    p = rng.dirichlet(np.full(13, 0.4), count) + 0.5 * np.eye(13)[np.where(side, 2, 7)]
    return position, colour, normal, mass, np.log(p / p.sum(1, keepdims=True))


@pytest.mark.parametrize("weights", [(10.0, 3.0), (2.0, 0.0), (0.0, 2.0)])
def test_mean_field_equals_the_sum_over_all_pairs(weights):
    position, colour, normal, mass, log_p = small_map()
    config = CrfConfig(weight_colour=weights[0], weight_normal=weights[1])
    found, _ = mean_field(
        find_neighbours(gaussian_kernels(config), position, colour, normal, mass, "cpu"), log_p, 10
    )
    expected = reference_crf.mean_field(position, colour, normal, mass, log_p, config)
    assert np.abs(found - expected).max() < 1e-3
    assert np.abs(found - np.exp(log_p)).max() > 0.2, "it does something"


def test_speckles_go_and_rows_stay_distributions():
    arrays = room_arrays(0.04)
    count = len(arrays["weight"])
    arrays["observations"] = np.ones(count, np.float32)
    arrays["observations"][17] = 0
    truth = arrays["label"].astype(int) - 1
    rng = np.random.default_rng(0)
    shown = np.where(rng.random(count) < 0.15, 6, truth)
    p = (0.02 + 0.74 * np.eye(13)[shown]).astype(np.float32)
    p[5] = np.nan
    refined, there = refine_by_crf(arrays, p, CrfConfig())
    np.testing.assert_allclose(refined.sum(axis=1), 1, atol=1e-5)
    assert there.all(), "what was never labelled, or is NaN, hears its neighbours"
    assert (shown == truth).mean() < 0.87 and (refined.argmax(axis=1) == truth).mean() > 0.97


@pytest.mark.parametrize("what", ["empty", "one surfel", "no labels", "NaN", "dead"])
def test_maps_with_nothing_to_refine(what):
    arrays = room_arrays(0.2)
    count = {"empty": 0, "one surfel": 1}.get(what, len(arrays["weight"]))
    arrays = {name: values[:count] for name, values in arrays.items()}
    arrays["observations"] = np.full(count, 0.0 if what == "no labels" else 1.0, np.float32)
    if what == "dead":
        arrays["weight"] = np.zeros(count, np.float32)
    p = np.full((count, 13), np.nan if what == "NaN" else 1 / 13, np.float32)
    refined, there = refine_by_crf(arrays, p, CrfConfig())
    assert refined.shape == (count, 13) and np.isfinite(refined).all()
    assert there.any() == (what in ("one surfel", "dead")), "those have labels of their own"
