"""The Kinect model: statistics against the published formula, missing data where it belongs."""

import numpy as np
import pytest

from dsmap.frame import Intrinsics
from dsmap.sim_scenes.render import default_camera
from dsmap.sim_scenes.sensor_noise import BASELINE_M, FOCAL_PX, axial_sigma, kinect_depth

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
    expected = np.hypot(axial_sigma(np.array(distance), np.array(1.0)), step / np.sqrt(12))
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
