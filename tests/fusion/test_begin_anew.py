"""The first frame defines the world, but not for ever: a start that fits nothing is given up, and no other."""

import warnings

import numpy as np
import pytest
from corner_frames import config, frames

from dsmap.errors import InputWarning
from dsmap.frame import Frame
from dsmap.fusion import mapper as module
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.runs.checkpoint import load_map, save_map
from dsmap.fusion.runs.resume import resumed_mapper
from dsmap.tools.twins.corner import INTRINSICS

H, W = INTRINSICS.height, INTRINSICS.width
GOOD = frames(9)
RNG = np.random.default_rng(0)


def numbered(index: int, rgb: np.ndarray, depth: np.ndarray) -> Frame:
    return Frame(index, index / 30, rgb, depth.astype(np.float32), None)


def noise() -> tuple[np.ndarray, np.ndarray]:
    return RNG.integers(0, 255, (H, W, 3)).astype(np.uint8), RNG.uniform(0.4, 4, (H, W))


def little_depth() -> tuple[np.ndarray, np.ndarray]:
    return GOOD[0].rgb, np.where(RNG.random((H, W)) < 0.03, GOOD[0].depth, 0)


def half_scale() -> tuple[np.ndarray, np.ndarray]:
    return GOOD[0].rgb, GOOD[0].depth / 2


def flat(depth: float, grey: int) -> tuple[np.ndarray, np.ndarray]:
    rgb = np.clip(grey + RNG.normal(0, 3, (H, W, 3)), 0, 255).astype(np.uint8)
    return rgb, depth + RNG.normal(0, 0.001, (H, W))


def hand() -> tuple[np.ndarray, np.ndarray]:
    return flat(0.42, 170)


def bare_wall() -> tuple[np.ndarray, np.ndarray]:
    return flat(1.5, 190)


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """Six frames instead of forty: what is tested does not depend on it."""
    monkeypatch.setattr(module, "_ENOUGH", 6)


@pytest.mark.parametrize("garbage", [noise, little_depth, hand, bare_wall, half_scale])
def test_garbage_first(garbage):
    m = Mapper(config(), INTRINSICS)
    m.step(numbered(0, *garbage()))
    with pytest.warns(
        InputWarning, match="begins anew at frame 1: none of 6 frames fits what the 1 before had begun"
    ):
        results = [m.step(numbered(i, f.rgb, f.depth)) for i, f in enumerate(GOOD, start=1)]
    straight = Mapper(config(), INTRINSICS)
    for i, f in enumerate(GOOD):
        straight.step(numbered(i, f.rgb, f.depth))
    assert m.trajectory.tracked.tolist() == [False] + [True] * 9 and m.begins_at == 1
    np.testing.assert_allclose(m.trajectory.poses[1:], straight.trajectory.poses, atol=4e-3)
    assert m.surfels.count == pytest.approx(straight.surfels.count, rel=0.1)
    assert [r.tracked for r in results] == [False] * 5 + [True] * 4


def test_a_hand_that_stays_for_some_frames_fixes_no_pose_and_is_given_up():
    m = Mapper(config(), INTRINSICS)
    grey, depth = np.full((H, W, 3), 20, np.uint8), np.full((H, W), 0.4)
    covered = [m.step(numbered(i, grey, depth)) for i in range(8)]
    assert sum(r.tracked for r in covered) >= 5 and not m.settled
    with pytest.warns(InputWarning, match="begins anew at frame 8"):
        for i, f in enumerate(GOOD, start=8):
            m.step(numbered(i, f.rgb, f.depth))
    assert m.trajectory.tracked.tolist() == [False] * 8 + [True] * 9


def test_a_short_recording_is_settled_at_its_end():
    m = Mapper(config(), INTRINSICS)
    m.step(numbered(0, *noise()))
    for i, f in enumerate(GOOD[:5], start=1):
        m.step(numbered(i, f.rgb, f.depth))
    assert not m.settled and m.tracked_frames == 1
    m.skip(0.2)
    with pytest.warns(InputWarning, match="begins anew"):
        m.settle()
    assert m.settled and m.trajectory.tracked.tolist() == [False] + [True] * 5 + [False]


def no_light() -> tuple[np.ndarray, np.ndarray]:
    return np.zeros((H, W, 3), np.uint8), np.zeros((H, W))


@pytest.mark.parametrize(
    "cover",
    [hand, no_light, *(pytest.param(cover, marks=pytest.mark.slow) for cover in (bare_wall, noise))],
)
def test_good_first_then_30_covered_frames(cover):
    m = Mapper(config(), INTRINSICS)
    with warnings.catch_warnings():
        warnings.simplefilter("error", InputWarning)
        first = [m.step(numbered(0, GOOD[0].rgb, GOOD[0].depth))]
        covered = [m.step(numbered(i, *cover())) for i in range(1, 31)]
        after = [m.step(numbered(31 + i, f.rgb, f.depth)) for i, f in enumerate(GOOD[:4])]
        m.settle()
    assert first[0].tracked and not any(r.tracked for r in covered) and all(r.tracked for r in after)
    assert m.begins_at == 0


def test_a_settled_map_a_resumed_one_and_given_poses_stay(tmp_path):
    settled = Mapper(config(), INTRINSICS)
    for i, f in enumerate(GOOD[:5]):
        settled.step(numbered(i, f.rgb, f.depth))
    resumed = Mapper(config(), INTRINSICS)
    resumed.step(numbered(0, *noise()))
    save_map(resumed, tmp_path / "map")
    resumed = resumed_mapper(*load_map(tmp_path / "map"), "", INTRINSICS)
    for m in (settled, resumed):
        assert m.settled
        for i in range(8):
            m.step(numbered(5 + i, *half_scale()))
        m.settle()
        assert m.begins_at == 0
    given = Mapper(config(poses="given"), INTRINSICS)
    assert given.settled
