"""Colours that hold nothing must not destroy good geometry, and what nothing holds stands still."""

import numpy as np
import pytest
from bare_wall import film

from dsmap.frame import Frame
from dsmap.fusion.config import MapConfig
from dsmap.fusion.lie import exp_se3, inverse, pose_difference
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.tracking.image_content import Colours, contrast, judged
from dsmap.fusion.tracking.observability import MOST_BLIND_M, BlindWay, Unheld
from dsmap.kernels.fuse import NO_COLOUR
from dsmap.tools.twins.corner import INTRINSICS, room

FRAMES, SPOILT = 16, range(5, 11)


def path(k: int) -> np.ndarray:
    return exp_se3(np.array([0.01 * k, 0.004 * k, 0, 0.002 * k, -0.012 * k, 0]))


def spoilt(kind: str, k: int, rgb: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    if kind == "black":
        return np.zeros_like(rgb)
    if kind == "dark":
        return (0.03 * rgb + rng.normal(0, 1, rgb.shape)).clip(0, 255).astype(np.uint8)
    if kind == "noise":
        return rng.integers(0, 256, rgb.shape, dtype=np.uint8)
    return room(path(SPOILT[0] - 1))[0]  # frozen


@pytest.mark.parametrize("kind", ["black", "dark", "noise", "frozen"])
def test_colours_that_say_nothing_or_something_else_do_not_move_the_camera(kind):
    rng, mapper = np.random.default_rng(0), Mapper(MapConfig(depth_max=6.0), INTRINSICS)
    for k in range(FRAMES):
        rgb, depth = room(path(k))
        if k in SPOILT:
            rgb = spoilt(kind, k, rgb, rng)
        result = mapper.step(Frame(k, k / 30, rgb, depth))
        assert result.tracked, result.reason
        distance, angle = pose_difference(inverse(path(0)) @ path(k), result.T_world_camera)
        assert distance < 0.005 and angle < 0.3, f"frame {k}"
    colours = mapper.surfels.numpy()["colour"]
    light = colours[colours[:, 0] != np.float32(NO_COLOUR)]
    assert light.min() > 0.15 and light.max() < 0.95, "what the camera did not see is not in the map"


def test_a_dark_start_is_filled_in_later():
    mapper = Mapper(MapConfig(depth_max=6.0), INTRINSICS)
    for k in range(4):
        rgb, depth = room(path(k))
        assert mapper.step(Frame(k, k / 30, (rgb * min(0.02 + 0.4 * k, 1)).astype(np.uint8), depth)).tracked
        known = mapper.surfels.numpy()["colour"][:, 0] != np.float32(NO_COLOUR)
        assert not known.any() if k == 0 else known.mean() > 0.8


def test_what_images_are_good_for():
    rng = np.random.default_rng(0)
    rgb, _ = room(np.eye(4))
    picture = rgb[..., 0] / np.float32(255)
    wall = film(np.eye(4), rng)[0][..., 0] / np.float32(255)
    assert judged(picture) is Colours.GOOD and judged(picture, frozen=True) is Colours.UNTRUE
    assert judged(wall) is Colours.PLAIN and contrast(wall) < 0.1 * contrast(picture)
    assert judged(0.1 * picture) is Colours.GOOD and judged(0.02 * picture) is Colours.UNTRUE
    assert judged(rng.random(picture.shape, dtype=np.float32)) is Colours.UNTRUE


def test_a_camera_at_rest_before_a_bare_wall_stays_there_and_goes_on_when_something_comes_into_view():
    rng, mapper = np.random.default_rng(1), Mapper(MapConfig(), INTRINSICS)
    poses = [exp_se3(np.array([0, 0, 0, 0, 0.035 * max(k - 8, 0), 0])) for k in range(30)]
    lost = 0
    for k, T in enumerate(poses):
        result = mapper.step(Frame(k, k / 30, *film(T, rng)))
        off = pose_difference(T, result.T_world_camera)[0]
        if k <= 8:
            assert result.tracked and off < 0.001, "at rest"
            assert k == 0 or (result.health and len(result.health.unheld) == 3), "and known not to be held"
        lost += not result.tracked
        assert not result.tracked or off < 0.03
    assert result.tracked and lost <= 5


def test_a_blind_way_ends_where_nothing_has_held_the_camera_for_long():
    sideways, way = Unheld(np.eye(6)[:1], 0.5), BlindWay()
    step, creep = exp_se3(np.array([0.01, 0.1, 0, 0, 0, 0])), exp_se3(np.array([4e-4, 0.1, 0, 0, 0, 0]))
    assert way.resting(step, 1 / 30, sideways) is step
    np.testing.assert_allclose(way.resting(creep, 1 / 30, sideways)[:3, 3], [0, 0.1, 0], atol=1e-9)
    for _ in range(int(MOST_BLIND_M / 0.01)):
        assert not way.reason_to_reject(step, sideways)
        way.add(step, sideways)
    assert "1 of 6" in way.reason_to_reject(2 * step - np.eye(4), sideways)
    nothing = Unheld(np.zeros((0, 6)), 1.0)
    for _ in range(3):
        assert way.reason_to_reject(step, nothing), "noise may hold it in a frame or two"
        way.see(nothing)
    assert not way.reason_to_reject(step, nothing)
