"""Residual reductions against their NumPy twins, and what they must be able to estimate."""

import dataclasses

import numpy as np
import pytest
import warp as wp

from dsmap.fusion.config import TrackConfig
from dsmap.fusion.lie import exp_se3, exp_so3, inverse, log_se3, rotation_angle
from dsmap.fusion.surfels.model_view import ModelView
from dsmap.fusion.tracking.exposure import exposure_gain
from dsmap.fusion.tracking.motion_filter import Expected
from dsmap.fusion.tracking.tracker import Tracker
from dsmap.kernels import odometry
from dsmap.kernels.preprocess import preprocess
from dsmap.tools.twins import images as reference
from dsmap.tools.twins.corner import LEVEL_CAMERAS, room

CPU = wp.get_device("cpu")


def pair(T_prev_cur: np.ndarray):
    """Maps of two views of the room, and the first as a model view."""
    first = preprocess(*room(np.eye(4)), LEVEL_CAMERAS, CPU)
    second = preprocess(*room(T_prev_cur), LEVEL_CAMERAS, CPU)
    return second, ModelView(first[0].vertex, first[0].normal, first[0].intensity, 3, np.eye(4)), first


@pytest.mark.parametrize("stride", [1, 2])
def test_joint_normal_equations(stride):
    frame, model, _ = pair(exp_se3(np.array([0.02, -0.01, 0.015, 0.01, 0.02, -0.01])))
    tracker = Tracker(TrackConfig(huber_icp=0.004, huber_rgb=0.02, noise_z=0.3), LEVEL_CAMERAS)
    gates = tracker._gates(1, gain=1.05)
    gates.stride = stride
    T = exp_se3(np.array([0.01, 0.0, 0.005, 0.0, 0.01, 0.0]))
    surfaces = frame[1].surface, model.level(1)
    got = odometry.joint_normal_equations(LEVEL_CAMERAS[1], gates, *surfaces)(T)
    arrays = [
        [getattr(s, n).numpy().astype(np.float64) for n in ("vertex", "normal", "intensity")]
        for s in surfaces
    ]
    arrays[1].append(surfaces[1].gradient.numpy().astype(np.float64))
    for ours, rows in zip(got, reference.joint_rows(LEVEL_CAMERAS[1], T, gates, *arrays), strict=True):
        A, b, cost, count = reference.normal_equations(rows)
        assert abs(ours.count - count) <= 2, "a pixel on a gate may fall either way in single precision"
        np.testing.assert_allclose(ours.A, A, rtol=0.02, atol=2e-3 * np.abs(A).max())
        np.testing.assert_allclose(ours.b, b, atol=0.01 * np.abs(b).max())
        np.testing.assert_allclose(ours.squares, cost, rtol=0.02)


def test_exposure_is_not_taken_for_motion():
    """A frame exposed a quarter darker than the model: the same pose as without, and not without the gain."""
    T = exp_se3(np.array([0.02, -0.01, 0.015, 0.01, 0.02, -0.01]))
    frame, model, _ = pair(T)
    frame = [
        dataclasses.replace(m, intensity=wp.array(0.75 * m.intensity.numpy(), dtype=wp.float32))
        for m in frame
    ]
    coarsest = frame[-1].surface
    assert exposure_gain(coarsest, model.level(-1)) == pytest.approx(1 / 0.75, rel=0.05)
    errors = {}
    for exposure in (True, False):
        config = TrackConfig(exposure=exposure, so3=False, w_rgb=1.0, rgb_balance=1e3)  # colour decides
        found, health = Tracker(config, LEVEL_CAMERAS).track(frame, model)
        errors[exposure] = np.linalg.norm((np.linalg.inv(T) @ found)[:3, 3])
    assert errors[True] < 2e-3 and errors[True] < 0.1 * errors[False]
    nothing = dataclasses.replace(coarsest, intensity=wp.zeros_like(coarsest.intensity))
    assert exposure_gain(nothing, model.level(-1)) is None, (
        "a black image cannot be compared with a bright one"
    )


def test_rotation_normal_equations():
    frame, _, first = pair(exp_se3(np.array([0, 0, 0, 0.01, 0.03, -0.01])))
    R = exp_so3(np.array([0.0, 0.01, 0.0]))
    last = first[2].intensity
    gradient = odometry.gradient(last)
    got = odometry.rotation_normal_equations(LEVEL_CAMERAS[2], frame[2].intensity, last, gradient)(R)
    rows = reference.rotation_rows(
        LEVEL_CAMERAS[2], R, frame[2].intensity.numpy(), last.numpy(), gradient.numpy()
    )
    ours_by_name = (got.A, got.b, got.squares, got.count)
    for ours, expected in zip(ours_by_name, reference.normal_equations(rows), strict=True):
        np.testing.assert_allclose(ours, expected, rtol=1e-3, atol=1e-3 * np.abs(expected).max())


def test_lanes_do_not_change_the_sums(monkeypatch):
    """The CUDA path splits rows into lanes: the same sums, in another order."""
    frame, model, _ = pair(exp_se3(np.array([0.02, 0, 0, 0, 0.01, 0])))
    gates = Tracker(TrackConfig(), LEVEL_CAMERAS)._gates(0)
    maps = frame[0].surface
    one = odometry.joint_normal_equations(LEVEL_CAMERAS[0], gates, maps, model.level(0))(np.eye(4))
    monkeypatch.setattr(odometry, "lanes_of", lambda device: odometry.CUDA_LANES)
    many = odometry.joint_normal_equations(LEVEL_CAMERAS[0], gates, maps, model.level(0))(np.eye(4))
    for a, b in zip(one, many, strict=True):
        assert a.count == b.count
        np.testing.assert_allclose(a.A, b.A, rtol=1e-4, atol=1e-4 * np.abs(a.A).max())


@pytest.mark.parametrize(
    "xi", [[0.03, -0.02, 0.02, 0.02, -0.03, 0.01], [0, 0, 0, 0, 0.08, 0.0], [0.05, 0, 0, 0, 0, 0]]
)
def test_tracker_finds_the_motion(xi):
    truth = exp_se3(np.array(xi))
    frame, model, first = pair(truth)
    tracker = Tracker(TrackConfig(), LEVEL_CAMERAS)
    tracker.remember(first[-1].surface)
    T_prev_cur, health = tracker.track(frame, model)
    error = inverse(truth) @ T_prev_cur
    assert health.tracked, health.reason
    assert np.linalg.norm(error[:3, 3]) < 2e-3
    assert np.rad2deg(rotation_angle(error)) < 0.1
    assert 0.01 < health.information_icp < 0.99, "neither residual may drown the other"


def wall(distance: float, noise: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A bare grey wall straight ahead, depth with noise [m]."""
    depth = distance + noise * np.random.default_rng(seed).standard_normal((72, 96))
    return np.full((72, 96, 3), 128, np.uint8), depth.astype(np.float32)


def test_in_front_of_a_bare_wall_motion_says_what_depth_cannot():
    """Depth alone tells the distance and two angles; the rest comes from the expectation, however wrong it is."""
    model = preprocess(*wall(2.0, 0.0, 0), LEVEL_CAMERAS, CPU)
    view = ModelView(model[0].vertex, model[0].normal, model[0].intensity, 3, np.eye(4))
    frame = preprocess(*wall(1.98, 0.002, 1), LEVEL_CAMERAS, CPU)
    motion = np.array([0.01, -0.02, 0.005, 0.004, -0.003, 0.02])
    sure = 0.005**-2.0 * np.eye(6)
    tracker = Tracker(TrackConfig(), LEVEL_CAMERAS)
    found, health = tracker.track(frame, view, expected=Expected(exp_se3(motion), sure))
    xi = log_se3(found)
    np.testing.assert_allclose(
        xi[[0, 1, 5]], motion[[0, 1, 5]], atol=0.002, err_msg="along the wall: as expected"
    )
    np.testing.assert_allclose(xi[[2, 3, 4]], [0.02, 0, 0], atol=0.002, err_msg="across: as measured")
    _, by_itself = tracker.track(frame, view)
    assert health.inliers == pytest.approx(by_itself.inliers, rel=0.02)
    assert np.diag(health.covariance)[0] > 100 * np.diag(health.covariance)[2], "no part in the verdict"


def test_a_sure_measurement_outweighs_a_wrong_expectation():
    truth = exp_se3(np.array([0.03, -0.02, 0.02, 0.02, -0.03, 0.01]))
    frame, model, _ = pair(truth)
    wrong = Expected(np.eye(4), 0.02**-2.0 * np.eye(6))
    found, health = Tracker(TrackConfig(), LEVEL_CAMERAS).track(frame, model, expected=wrong)
    assert health.tracked and np.linalg.norm((inverse(truth) @ found)[:3, 3]) < 2e-3


def test_a_search_starts_where_motion_leads_if_that_fits_better():
    """So far from the last pose that registration does not get there from it."""
    truth = exp_se3(np.array([0.05, -0.05, 0.05, 0, 0.5, 0]))
    frame, model, _ = pair(truth)
    tracker = Tracker(TrackConfig(so3=False), LEVEL_CAMERAS)
    unsure = 10.0**-2 * np.eye(6)
    starts = {"rest": None, "expected": Expected(truth, unsure), "wrong": Expected(inverse(truth), unsure)}
    off = {
        name: np.linalg.norm((inverse(truth) @ tracker.track(frame, model, expected=e)[0])[:3, 3])
        for name, e in starts.items()
    }
    assert off["expected"] < 5e-3 and off["rest"] > 0.02
    assert off["wrong"] < 2 * off["rest"], "a start that fits worse is not taken"


def test_tracker_knows_when_it_is_lost():
    frame, model, first = pair(np.eye(4))
    rng = np.random.default_rng(0)
    noise = preprocess(rng.integers(0, 256, (72, 96, 3), dtype=np.uint8),
                       rng.uniform(0.5, 3, (72, 96)).astype(np.float32), LEVEL_CAMERAS, CPU)  # fmt: skip
    tracker = Tracker(TrackConfig(), LEVEL_CAMERAS)
    tracker.remember(first[-1].surface)
    assert not tracker.track(noise, model)[1].tracked
    far = preprocess(*room(exp_se3(np.array([0, 0, 0, 0, 2.5, 0]))), LEVEL_CAMERAS, CPU)
    assert not tracker.track(far, model)[1].tracked
    empty = preprocess(np.zeros((72, 96, 3), np.uint8), np.zeros((72, 96), np.float32), LEVEL_CAMERAS, CPU)
    assert not tracker.track(empty, model)[1].tracked
    assert tracker.track(frame, model)[1].tracked
