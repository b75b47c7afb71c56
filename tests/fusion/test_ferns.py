"""The keyframe database against a slow twin: likeness, novelty, age, state, speed."""

import time

import numpy as np
import pytest

from dsmap.fusion.config import FernConfig
from dsmap.fusion.lie import exp_se3
from dsmap.fusion.places.ferns import NO_DATA, FernDatabase, SmallView, small_size, small_view
from dsmap.tools.twins.corner import INTRINSICS

SIZE = (18, 24)


def random_view(seed: int, holes: float = 0.2) -> SmallView:
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0.5, 6, SIZE).astype(np.float32)
    depth[rng.random(SIZE) < holes] = 0
    return SmallView(rng.integers(0, 256, (*SIZE, 3), dtype=np.uint8), depth)


def database(views: int = 0, **changes) -> FernDatabase:
    ferns = FernDatabase(FernConfig(**changes), SIZE, (0.3, 8.0), seed=5)
    for i in range(views):
        view = random_view(i)
        ferns.add_if_novel(ferns.encode(view), view, exp_se3(np.full(6, 0.01 * i)), 10 * i)
    return ferns


def slow_similarity(ferns: FernDatabase, a: SmallView, b: SmallView) -> float:
    """Fern by fern, question by question."""
    state = ferns.state()
    equal = both = 0
    for (y, x), colour, depth in zip(
        state["pixels"], state["colour_thresholds"], state["depth_thresholds"], strict=True
    ):
        if a.depth[y, x] <= 0 or b.depth[y, x] <= 0:
            continue
        both += 1
        answers = [[*(v.rgb[y, x] > colour), v.depth[y, x] > depth] for v in (a, b)]
        equal += answers[0] == answers[1]
    return equal / both if both >= ferns.config.min_overlap * ferns.config.count else 0.0


@pytest.mark.parametrize("count", [500, 37])
def test_similarity_is_that_of_the_slow_twin(count):
    ferns = database(8, count=count, min_overlap=0.4)
    assert len(ferns) == 8
    for query in (random_view(3), random_view(99), random_view(98, holes=0.5), random_view(97, holes=1.0)):
        slow = [slow_similarity(ferns, query, random_view(i)) for i in range(8)]
        np.testing.assert_allclose(ferns.similarities(ferns.encode(query)), slow, atol=1e-6)


def test_pixels_without_data_do_not_count():
    ferns = database(1)
    view = random_view(0, holes=0.0)
    part = SmallView(view.rgb.copy(), view.depth.copy())
    part.rgb[:, :12], part.depth[:, :12] = 0, 0  # half of the image is covered
    ferns = FernDatabase(ferns.config, SIZE, (0.3, 8.0), seed=5)
    ferns.add_if_novel(ferns.encode(view), view, np.eye(4), 0)
    code = ferns.encode(part)
    assert 0.3 < (code == NO_DATA).mean() < 0.7
    assert ferns.similarities(code)[0] == 1
    nothing = SmallView(view.rgb, np.zeros(SIZE, np.float32))
    assert ferns.similarities(ferns.encode(nothing))[0] == 0
    assert not ferns.add_if_novel(ferns.encode(nothing), nothing, np.eye(4), 1)


def test_only_novel_views_become_keyframes():
    ferns = database(1, novelty=0.3)
    view = random_view(0)
    assert not ferns.add_if_novel(ferns.encode(view), view, np.eye(4), 1)
    noisy = SmallView(view.rgb, view.depth * np.float32(1.01))
    assert not ferns.add_if_novel(ferns.encode(noisy), noisy, np.eye(4), 2)
    other = random_view(1)
    assert ferns.add_if_novel(ferns.encode(other), other, np.eye(4), 3)
    assert len(ferns) == 2 and list(ferns.times) == [0, 3]


def test_candidates_are_old_enough_and_come_best_first():
    ferns = database(6, min_similarity=0.01)
    code = ferns.encode(random_view(4))
    found = ferns.candidates(code, time=1000, min_age=300)
    assert found[0][0].index == 4 and found[0][1] == 1
    assert [s for _, s in found] == sorted((s for _, s in found), reverse=True)
    assert 4 not in [k.index for k, _ in ferns.candidates(code, time=40 + 299, min_age=300)]
    assert ferns.candidates(code, time=40 + 300, min_age=300)[0][0].index == 4
    keyframe, similarity = ferns.candidate(code, 1000, 300) or pytest.fail("no candidate")
    np.testing.assert_allclose(keyframe.view.depth, random_view(4).depth, atol=6e-4)
    np.testing.assert_array_equal(keyframe.view.rgb, random_view(4).rgb)
    assert keyframe.time == 40 and similarity == 1
    assert database().candidate(code, 1000, 0) is None
    strict = database(6, min_similarity=0.99)
    assert strict.candidate(strict.encode(random_view(77)), 1000, 0) is None


def test_keyframes_move_with_the_map():
    ferns = database(3)
    ferns.poses = exp_se3(np.array([1.0, 0, 0, 0, 0, 0.0])) @ ferns.poses
    assert ferns.keyframe(0).T_world_camera[0, 3] == 1
    assert ferns.keyframe(2).T_world_camera[0, 3] > 1


def test_state_goes_on_bit_for_bit():
    ferns = database(4)
    state = ferns.state()
    again = FernDatabase.from_state(ferns.config, SIZE, state)
    for i in range(4, 70):
        view = random_view(i)
        for each in (ferns, again):
            each.add_if_novel(each.encode(view), view, np.eye(4), 10 * i)
    assert len(ferns) == len(again) == 70
    for name, array in ferns.state().items():
        np.testing.assert_array_equal(array, again.state()[name], err_msg=name)
    assert (database(4).state()["codes"] == state["codes"]).all(), "the same seed gives the same ferns"
    other = FernDatabase(ferns.config, SIZE, (0.3, 8.0), seed=6)
    assert (other.state()["pixels"] != state["pixels"]).any()


def test_search_is_much_faster_than_comparing_one_by_one():
    ferns = database()
    rng = np.random.default_rng(0)
    rows = 5000
    state = ferns.state() | {
        "codes": rng.integers(0, 16, (rows, 500), dtype=np.uint8),
        "rgb": np.zeros((rows, *SIZE, 3), np.uint8),
        "depth_mm": np.zeros((rows, *SIZE), np.uint16),
        "poses": np.tile(np.eye(4), (rows, 1, 1)),
        "times": np.arange(rows),
    }
    large = FernDatabase.from_state(ferns.config, SIZE, state)
    query = rng.integers(0, 16, 500, dtype=np.uint8)

    def fastest(call) -> float:
        times = []
        for _ in range(5):
            start = time.perf_counter()
            call()
            times.append(time.perf_counter() - start)
        return min(times)

    one_by_one = fastest(lambda: [(codes == query).mean() for codes in state["codes"]])
    assert fastest(lambda: large.similarities(query)) < one_by_one / 4
    np.testing.assert_allclose(large.similarities(query), (state["codes"] == query).mean(axis=1), atol=1e-6)


def test_small_view_averages_colour_but_never_depth():
    colour = np.zeros((48, 64, 3), np.float32)
    colour[:, :32], colour[:, 32:] = 0.2, 0.8
    depth = np.ones((48, 64), np.float32)
    depth[:, 32:] = 3
    depth[:24, :16] = 0
    colour[:24, :8] = 1  # no depth: this colour is not the model's
    view = small_view(colour, depth, (12, 16))
    assert view.rgb.shape == (12, 16, 3) and view.depth.shape == (12, 16)
    assert set(np.unique(view.depth)) == {0, 1, 3}
    assert (view.depth[:6, :4] == 0).all() and (view.rgb[view.depth == 1] == 51).all()
    assert small_size(INTRINSICS, 80) == (60, 80) and small_size(INTRINSICS, 500) == (72, 96)
