"""Label fusion: against its NumPy twin, and against Bayes' rule by hand."""

import numpy as np
import pytest
import warp as wp

from dsmap.errors import InputError
from dsmap.kernels.label import posterior, update_labels
from dsmap.tools.twins import scene as random_scene
from dsmap.tools.twins import surfels as reference_map

CAMERA = random_scene.CAMERA


def one_pixel(values: dict[int, float]) -> np.ndarray:
    """A constant probability image of one pixel."""
    p = np.zeros((1, 1, 14), np.float32)
    for k, v in values.items():
        p[0, 0, k] = v
    return p


def visible_map():
    """Surfels on the frame's surface without any label, and its depth and edge maps."""
    T = random_scene.pose(4)
    maps = random_scene.frame_maps(random_scene.frame_arrays(4))
    surfels = random_scene.surfel_map(T, seed=4)
    for array in (surfels.evidence, surfels.observations, surfels.label):
        array.zero_()
    return T, surfels, maps


@pytest.mark.parametrize("rule", ["bayes", "mean", "geometric"])
@pytest.mark.parametrize("size, sureness", [((48, 64), 0.0), ((14, 20), 2.0), ((60, 100), 1.5)])
def test_update_equals_its_twin(rule, size, sureness):
    T, frame = random_scene.pose(1), random_scene.frame_arrays(1)
    maps, surfels = random_scene.frame_maps(frame), random_scene.surfel_map(T, count=800, seed=1)
    p = random_scene.softmax_image(0, *size)
    options = {"rule": rule, "floor": 0.01, "sureness": sureness, "max_distance": 0.02, "t_min": 8}
    before = reference_map.arrays(surfels)
    expected = reference_map.update_labels(before, CAMERA, T, frame["depth"], frame["edge"], p, **options)
    update_labels(surfels, CAMERA, T, maps, p, **options)
    found = surfels.numpy()
    touched = expected["observations"] > before["observations"]
    assert 100 < touched.sum() < 700
    for name in ("evidence", "observations", "label"):
        np.testing.assert_allclose(found[name], expected[name], atol=2e-5, err_msg=name)


def test_two_observations_multiply_under_bayes_and_average_under_the_means():
    a, b = {1: 0.6, 2: 0.3, 3: 0.1}, {1: 0.2, 2: 0.5, 3: 0.3}
    va, vb = (np.array([v[1], v[2], v[3]]) for v in (a, b))
    answers = {"bayes": va * vb, "geometric": np.sqrt(va * vb), "mean": va + vb}
    for rule, answer in answers.items():
        T, surfels, maps = visible_map()
        for p in (a, b):
            update_labels(surfels, CAMERA, T, maps, one_pixel(p), rule=rule, floor=1e-9)
        seen = surfels.numpy()["observations"] == 2
        assert seen.sum() > 500
        found = posterior(surfels, rule)
        np.testing.assert_allclose(
            found[seen, :3], np.tile(answer / answer.sum(), (seen.sum(), 1)), atol=1e-5
        )
        np.testing.assert_allclose(found.sum(1), 1, rtol=1e-5)
        np.testing.assert_allclose(found[~seen], 1 / 13, rtol=1e-5)
        assert (surfels.numpy()["label"][seen] == answer.argmax() + 1).all()
        assert (surfels.numpy()["label"][~seen] == 0).all()


@pytest.mark.parametrize("rule", ["mean", "geometric"])
def test_a_sure_view_outweighs_several_that_guess(rule):
    T, surfels, maps = visible_map()
    guess = {k: 0.06 for k in range(1, 14)} | {3: 0.28}
    for p in [one_pixel(guess)] * 4 + [one_pixel({8: 0.96, 3: 0.04})]:
        update_labels(surfels, CAMERA, T, maps, p, rule=rule, sureness=2.0)
    s = surfels.numpy()
    seen = s["observations"] > 0
    assert (s["label"][seen] == 8).all() and (s["observations"][seen] < 1.1).all()
    np.testing.assert_allclose(posterior(surfels, rule)[seen].sum(1), 1, rtol=1e-5)


def test_void_is_left_out_and_a_void_pixel_says_nothing():
    T, surfels, maps = visible_map()
    update_labels(surfels, CAMERA, T, maps, one_pixel({0: 1.0}), rule="mean")
    assert not surfels.numpy()["observations"].any()
    update_labels(surfels, CAMERA, T, maps, one_pixel({0: 0.8, 5: 0.15, 7: 0.05}), rule="mean")
    seen = surfels.numpy()["observations"] > 0
    np.testing.assert_allclose(posterior(surfels, "mean")[seen][0, [4, 6]], [0.75, 0.25], rtol=1e-5)


def test_one_zero_does_not_kill_a_class_and_long_runs_stay_finite():
    T, surfels, maps = visible_map()
    yes, no = one_pixel({4: 1.0}), one_pixel({9: 1.0})
    for p in [no] + [yes] * 300:
        update_labels(surfels, CAMERA, T, maps, p, rule="bayes", floor=1e-3)
    s = surfels.numpy()
    seen = s["observations"] == 301
    assert seen.sum() > 500 and (s["label"][seen] == 4).all()
    assert np.isfinite(s["evidence"]).all() and (s["evidence"][seen].max(1) == 0).all()


def test_labels_are_not_written_across_depth_edges_or_onto_hidden_surfels():
    T, surfels, maps = visible_map()
    maps.edge.fill_(1)
    update_labels(surfels, CAMERA, T, maps, one_pixel({4: 1.0}))
    maps.edge.zero_()
    maps.depth.fill_(0.5)  # something near stands before everything
    update_labels(surfels, CAMERA, T, maps, one_pixel({4: 1.0}))
    assert (surfels.numpy()["observations"] > 0).mean() < 0.02


def test_temperature_flattens_and_ranges_are_slices():
    T, surfels, maps = visible_map()
    p = one_pixel({1: 0.6, 2: 0.3, 3: 0.1})
    for _ in range(10):
        update_labels(surfels, CAMERA, T, maps, p, rule="bayes", floor=1e-9)
    seen = surfels.numpy()["observations"] > 0
    np.testing.assert_allclose(
        posterior(surfels, "bayes", temperature=10.0)[seen][0, :3], [0.6, 0.3, 0.1], rtol=1e-4
    )
    whole = posterior(surfels, "bayes")
    np.testing.assert_array_equal(posterior(surfels, "bayes", first=100, last=130), whole[100:130])
    assert posterior(surfels, "mean", first=surfels.count).shape == (0, 13)


def test_warp_probabilities_and_a_wrong_shape():
    T, surfels, maps = visible_map()
    p = random_scene.softmax_image(3, 12, 16)
    update_labels(surfels, CAMERA, T, maps, p)
    by_numpy = surfels.numpy()["evidence"].copy()
    _, surfels, _ = visible_map()
    update_labels(surfels, CAMERA, T, maps, wp.array(p, dtype=wp.float32, device="cpu"))
    np.testing.assert_array_equal(surfels.numpy()["evidence"], by_numpy)
    with pytest.raises(InputError, match=r"\(12, 16, 13\)"):
        update_labels(surfels, CAMERA, T, maps, p[..., :13])
