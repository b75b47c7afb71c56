"""Image effects: nothing by default, deterministic per (seed, frame), blur along the camera's motion."""

import cv2
import numpy as np
import pytest

from dsmap.errors import InputError
from dsmap.sim_scenes.render.renderer import default_camera
from dsmap.sim_scenes.sensors.colour_camera import Effects, apply, exposure_flow, frame_tremor

CAMERA = default_camera(160, 120)


def picture() -> np.ndarray:
    """Smooth lumps of colour, uint8 (120, 160, 3)."""
    rng = np.random.default_rng(0)
    return cv2.resize(
        rng.integers(40, 216, (8, 10, 3)).astype(np.uint8), (160, 120), interpolation=cv2.INTER_CUBIC
    )


def turned(degrees: float) -> np.ndarray:
    """A camera turned about its vertical axis."""
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array([0.0, np.radians(degrees), 0.0]))[0]
    return T


def test_no_effects_return_the_image_itself() -> None:
    image = picture()
    assert apply(image, Effects.none(), 3) is image
    assert Effects.sample("none", 5).idle


@pytest.mark.parametrize("level", ["mild", "strong"])
def test_the_same_seed_and_frame_give_the_same_picture_and_others_do_not(level: str) -> None:
    image, effects = picture(), Effects.sample(level, 4)
    first = apply(image, effects, 7)
    assert first.dtype == np.uint8 and first.shape == image.shape
    assert (first == apply(image, Effects.sample(level, 4), 7)).all()
    assert (first != apply(image, effects, 8)).mean() > 0.1
    assert (first != apply(image, Effects.sample(level, 5), 7)).mean() > 0.3
    assert 30 < first.mean() < 220


def test_unknown_level_is_an_input_error() -> None:
    with pytest.raises(InputError, match="expected one of: none, mild, strong"):
        Effects.sample("wild", 1)


def test_exposure_doubles_the_light_and_white_balance_tints_it() -> None:
    grey = np.full((8, 8, 3), 90, np.uint8)
    brighter = apply(grey, Effects(exposure=2.0), 0)
    assert (brighter[0, 0] / 255.0) ** 2.2 == pytest.approx(2 * (90 / 255.0) ** 2.2, rel=0.03)
    warm = apply(grey, Effects(white_balance=(1.2, 1.0, 0.8)), 0)[0, 0].astype(int)
    assert warm[0] > warm[1] > warm[2]


def test_auto_exposure_brings_dark_pictures_to_middle_grey() -> None:
    dark = (picture() // 6).astype(np.uint8)
    full = apply(dark, Effects(auto_exposure=1.0), 0)
    assert dark.mean() < 30 and 90 < full.mean() < 150


def test_noise_grows_with_the_light() -> None:
    effects = Effects(shot_noise=0.03)
    spread = [
        float(((apply(np.full((64, 64, 3), v, np.uint8), effects, 0) / 255.0) ** 2.2).std())
        for v in (60, 200)
    ]
    expected = np.sqrt((200 / 60) ** 2.2)
    assert spread[1] / spread[0] == pytest.approx(expected, rel=0.15)


def test_vignetting_darkens_corners_only() -> None:
    out = apply(np.full((60, 80, 3), 128, np.uint8), Effects(vignetting=0.5), 0).astype(float)
    assert out[30, 40, 0] == pytest.approx(128, abs=1)
    assert (out[0, 0, 0] / 255) ** 2.2 == pytest.approx(0.5 * (128 / 255) ** 2.2, rel=0.05)


def test_flow_of_a_turn_is_the_focal_length_times_the_angle() -> None:
    depth = np.full((120, 160), 2.0, np.float32)
    flow = exposure_flow(depth, CAMERA, np.eye(4), turned(2.0), Effects(shutter=0.5))
    assert flow is not None
    expected = -0.5 * CAMERA.fx * np.tan(np.radians(2.0))
    assert flow[60, 80, 0] == pytest.approx(expected, rel=0.02)
    assert abs(flow[60, 80, 1]) < 0.05
    assert exposure_flow(depth, CAMERA, np.eye(4), turned(0.01), Effects(shutter=0.5)) is None
    assert exposure_flow(depth, CAMERA, np.eye(4), turned(2.0), Effects.none()) is None


def test_blur_smears_across_the_motion_and_keeps_edges_along_it() -> None:
    image = np.zeros((120, 160, 3), np.uint8)
    image[:, 80:] = 200
    effects = Effects(shutter=0.5)
    depth = np.full((120, 160), 2.0, np.float32)
    flow = exposure_flow(depth, CAMERA, np.eye(4), turned(4.0), effects)
    across = apply(image, effects, 0, flow)
    along = apply(np.ascontiguousarray(image.transpose(1, 0, 2))[:120, :120], effects, 0, flow[:, :120])
    steps_across, steps_along = (
        np.abs(np.diff(across[60, :, 0].astype(int))),
        np.abs(np.diff(along[:, 60, 0].astype(int))),
    )
    assert steps_across.max() < 90 and (steps_across > 0).sum() >= 4
    assert steps_along.max() > 150
    assert across[60, :, 0].astype(int).argmax() > 79  # centred on the middle of the exposure


def test_tremor_is_a_small_rigid_motion() -> None:
    T = frame_tremor(Effects(seed=2), 5)
    assert np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3)) and (frame_tremor(Effects(seed=2), 5) == T).all()
    assert np.linalg.norm(T[:3, 3]) < 0.02 and (frame_tremor(Effects(seed=2), 6) != T).any()
