"""The Kinect model: statistics against the published formula, missing data where it belongs."""

import numpy as np
import pytest

from dsmap.frame import Intrinsics
from dsmap.sim_scenes.render.renderer import default_camera
from dsmap.sim_scenes.sensors import azure as sensor_azure
from dsmap.sim_scenes.sensors import d435 as sensor_d435
from dsmap.sim_scenes.sensors.kinect import BASELINE_M, FOCAL_PX, kinect_depth, kinect_sigma
from dsmap.sim_scenes.sensors.registry import SENSORS

CAMERA = default_camera(640, 480)


def wall(distance: float, angle_deg: float = 0.0) -> np.ndarray:
    """Depth of a plane through (0, 0, distance), turned about the vertical axis."""
    x = (np.arange(CAMERA.width) - CAMERA.cx) / CAMERA.fx
    z = distance / (1 - np.tan(np.radians(angle_deg)) * x)
    return np.broadcast_to(z.astype(np.float32), (CAMERA.height, CAMERA.width)).copy()


def noisy(depth: np.ndarray, glass: np.ndarray | None = None, seed: int = 1, frame: int = 0) -> np.ndarray:
    """The model under test, at 640x480."""
    nothing = np.zeros(depth.shape, bool) if glass is None else glass
    return kinect_depth(depth, CAMERA, nothing, seed=seed, frame=frame)


@pytest.mark.parametrize("distance", [1.0, 2.0, 3.0, 4.0])
def test_axial_noise_follows_the_formula_and_quantisation(distance: float) -> None:
    error = np.concatenate([noisy(wall(distance), frame=k).ravel() for k in range(4)]) - distance
    assert (error > -1).mean() > 0.98
    error = error[error > -1]
    step = distance**2 / (BASELINE_M * FOCAL_PX) * 0.125
    expected = np.hypot(kinect_sigma(np.array(distance), np.array(1.0)), step / np.sqrt(12))
    assert error.std() == pytest.approx(expected, rel=0.15)
    assert abs(error.mean()) < 0.3 * expected


def test_noise_is_correlated_between_neighbours() -> None:
    error = noisy(wall(3.0)) - 3.0
    inner = error[100:380, 100:540]
    near = np.corrcoef(inner[:, :-1].ravel(), inner[:, 1:].ravel())[0, 1]
    far = np.corrcoef(inner[:, :-12].ravel(), inner[:, 12:].ravel())[0, 1]
    assert near > 0.4 and abs(far) < 0.1


def test_depth_comes_in_steps_of_disparity() -> None:
    values = np.unique(noisy(wall(2.5)))
    disparity = BASELINE_M * FOCAL_PX / values[values > 0]
    assert np.allclose(disparity * 8, np.round(disparity * 8), atol=1e-2)


def test_nothing_beyond_range_on_glass_or_at_grazing_angles() -> None:
    assert (noisy(wall(5.5)) == 0).all()
    assert (noisy(wall(0.3)) == 0).all()
    glass = np.zeros((480, 640), bool)
    glass[100:200, 100:300] = True
    depth = noisy(wall(2.0), glass)
    assert (depth[glass] == 0).all() and (depth[~glass] > 0).mean() > 0.98
    # Turned by 84 degrees, the plane is seen at over 80 degrees from its normal around the image centre.
    assert (noisy(wall(1.5, 84.0))[:, 300:340] == 0).mean() > 0.95
    assert (noisy(wall(1.5, 60.0))[:, 300:340] > 0).mean() > 0.9


def test_depth_is_lost_at_edges_and_in_the_projectors_shadow() -> None:
    depth = wall(3.0)
    depth[:, 300:400] = 1.2
    missing = noisy(depth) == 0
    width = BASELINE_M * FOCAL_PX * (1 / 1.2 - 1 / 3.0)  # 21.75 px
    assert missing[:, 302 - int(width) : 297].mean() > 0.95
    assert missing[:, 100 : 295 - int(width)].mean() < 0.02
    assert 0.1 < missing[:, 400:404].mean() < 0.8
    assert missing[:, 410:600].mean() < 0.02


def test_deterministic_in_seed_and_frame() -> None:
    depth = wall(2.0)
    assert np.array_equal(noisy(depth, seed=3, frame=5), noisy(depth, seed=3, frame=5))
    assert not np.array_equal(noisy(depth, seed=3, frame=5), noisy(depth, seed=3, frame=6))
    assert not np.array_equal(noisy(depth, seed=4, frame=5), noisy(depth, seed=3, frame=5))


def test_small_images_work() -> None:
    small = Intrinsics(80, 60, 65.6, 65.6, 39.5, 29.5)
    depth = np.full((60, 80), 1.5, np.float32)
    out = kinect_depth(depth, small, np.zeros((60, 80), bool), seed=1, frame=0)
    assert (out > 0).mean() > 0.95 and abs(np.median(out[out > 0]) - 1.5) < 0.02


NO_GLASS = np.zeros((CAMERA.height, CAMERA.width), bool)
PATTERN = np.random.default_rng(0).integers(0, 256, (CAMERA.height, CAMERA.width, 3), dtype=np.uint8)
WHITE = np.full_like(PATTERN, 255)
DARK = np.full_like(PATTERN, 12)


def measured(name: str, depth: np.ndarray, rgb: np.ndarray, frame: int = 0) -> np.ndarray:
    """Depth as a sensor gives it."""
    return SENSORS[name].measure(depth, CAMERA, NO_GLASS, rgb, 1, frame)


def errors(name: str, distance: float, rgb: np.ndarray, frames: int = 3) -> np.ndarray:
    """Errors of what is measured of a frontal wall [m], around the image's middle where rays are frontal."""
    seen = np.concatenate(
        [measured(name, wall(distance), rgb, k)[140:340, 220:420].ravel() for k in range(frames)]
    )
    return seen[seen > 0] - distance


@pytest.mark.parametrize("distance", [1.0, 2.0, 3.0, 4.0])
def test_the_kinects_two_published_models_agree(distance: float) -> None:
    khoshelham = 1.425e-3 * distance**2
    assert 0.6 < khoshelham / kinect_sigma(np.array(distance), np.array(1.0)) < 1.1


@pytest.mark.parametrize("distance", [0.6, 1.0, 2.0, 3.5])
def test_d435_follows_intels_rule_where_there_is_texture(distance: float) -> None:
    error = errors("d435", distance, PATTERN)
    # z^2 subpixel / (f b): 1.5 cm at 2 m.
    assert error.std() == pytest.approx(distance**2 * 0.08 / (424 * 0.05), rel=0.15)
    assert len(error) > 0.9 * 3 * 200 * 200


def test_d435_is_worse_on_bare_walls_and_blind_too_near_and_left_of_near_things() -> None:
    assert errors("d435", 2.0, WHITE).std() > 1.3 * errors("d435", 2.0, PATTERN).std()
    assert (measured("d435", wall(4.5), WHITE) == 0).mean() > (
        measured("d435", wall(1.5), WHITE) == 0
    ).mean() + 0.05
    assert (measured("d435", wall(0.2), PATTERN) == 0).all()
    depth = wall(3.0)
    depth[:, 300:400] = 1.0
    hidden = 0.05 * CAMERA.fx * (1 / 1.0 - 1 / 3.0)  # 17.5 px
    missing = measured("d435", depth, PATTERN) == 0
    assert missing[:, 302 - int(hidden) : 296].mean() > 0.8 and missing[:, 420:600].mean() < 0.1


@pytest.mark.parametrize("distance", [0.8, 1.5, 2.5, 3.5])
def test_azure_noise_by_returned_light_and_within_its_specification(distance: float) -> None:
    error = errors("azure", distance, WHITE)
    light = sensor_azure.returned_light(np.array(distance), np.array(1.0), np.array(1.0))
    assert error.std() == pytest.approx(float(sensor_azure.azure_sigma(light)), rel=0.1)
    assert error.std() < 0.017 and abs(error.mean()) < 0.011
    stereo = max(distance, 1.2) ** 2 * sensor_d435.SUBPIXEL / (sensor_d435.FOCAL_PX * sensor_d435.BASELINE_M)
    assert error.std() < 0.5 * stereo


def test_azure_has_flying_pixels_loses_dark_far_things_and_reads_corners_too_far() -> None:
    depth = wall(2.5)
    depth[:, 320:] = 1.5
    seen = measured("azure", depth, WHITE)
    between = (seen > 1.6) & (seen < 2.4)
    assert between[:, 316:324].mean() > 0.05 and between[:, :300].mean() == 0 == between[:, 340:].mean()
    assert (
        (measured("azure", wall(4.5), DARK) == 0).mean()
        > 0.9
        > 0.02
        > (measured("azure", wall(1.0), DARK) == 0).mean()
    )
    assert (measured("azure", wall(5.6), WHITE) == 0).all()
    x = np.abs(np.arange(CAMERA.width) - CAMERA.cx) / CAMERA.fx
    corner = np.broadcast_to((2.0 / (1 + x)).astype(np.float32), depth.shape).copy()
    error = measured("azure", corner, WHITE) - corner
    assert 0.003 < error[100:380, 312:328].mean() < 0.011 and abs(error[100:380, 100:160].mean()) < 0.0015


@pytest.mark.parametrize("name", ["d435", "azure"])
def test_the_other_sensors_see_no_glass_and_repeat_by_seed_and_frame(name: str) -> None:
    depth, glass = wall(1.5), NO_GLASS.copy()
    glass[100:200, 100:300] = True
    a, b, c = (SENSORS[name].measure(depth, CAMERA, glass, PATTERN, 3, k) for k in (5, 5, 6))
    assert np.array_equal(a, b) and not np.array_equal(a, c)
    assert a.dtype == np.float32 and (a[glass] == 0).all() and (a[~glass] > 0).mean() > 0.9
