"""The motion of the camera as one more measurement (fusion/tracking/motion_filter.py), and the algebra of twists."""

import numpy as np
import pytest

from dsmap.fusion.config import TrackConfig
from dsmap.fusion.lie import adjoint, exp_se3, hat, inverse, log_se3, uncertainty
from dsmap.fusion.tracking.motion_filter import MotionFilter
from dsmap.fusion.trajectory import TrajectoryPoint

SECONDS = 1 / 30
VELOCITY = np.array([0.3, -0.1, 0.2, 0.4, 0.5, -0.3])
"""[m/s, rad/s]"""
SURE = np.diag([1e-4] * 3 + [2e-4] * 3) ** 2
START = exp_se3(np.array([0.1, 0.2, -0.3, 0.2, 0.1, 0.4]))
"""T_world_camera of the first frame."""


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-5, 0.01, 1.0, 3.0])
def test_log_is_the_inverse_of_exp(size):
    xi = size * np.array([0.3, -0.5, 0.2, 0.6, -0.3, 0.7])
    np.testing.assert_allclose(log_se3(exp_se3(xi)), xi, atol=1e-10)


def test_adjoint_takes_a_twist_to_the_other_side():
    T, xi = exp_se3(np.array([0.4, -0.2, 0.9, 0.3, 1.1, -0.4])), np.array([0.1, 0.2, -0.1, 0.3, -0.2, 0.1])
    np.testing.assert_allclose(T @ exp_se3(xi), exp_se3(adjoint(T) @ xi) @ T, atol=1e-12)
    generator = np.zeros((4, 4))
    generator[:3, :3], generator[:3, 3] = hat(xi[3:]), xi[:3]
    moved = T @ generator @ inverse(T)
    np.testing.assert_allclose((adjoint(T) @ xi)[:3], moved[:3, 3], atol=1e-12)


def test_what_nothing_was_measured_of_is_uncertain():
    """A pseudo-inverse would call it certain: zero."""
    J = np.array([[1.0, 0, 0], [1, 0, 0], [0, 2, 0]])
    np.testing.assert_allclose(np.diag(uncertainty(J.T @ J, 0.5))[:2], [0.25, 0.125], rtol=1e-6)
    assert uncertainty(J.T @ J, 0.5)[2, 2] > 1e7
    assert np.isinf(uncertainty(np.zeros((3, 3)))).all()


def tracked(motion: MotionFilter, velocities, covariance=SURE, path=None) -> list[TrajectoryPoint]:
    """A path with these velocities, one frame each, that `motion` learns from; the view is the last pose."""
    path = path or [TrajectoryPoint(0.0, START, True)]
    for velocity in velocities:
        T_last_cur = exp_se3(velocity * SECONDS)
        T, taken = path[-1].T_world_camera @ T_last_cur, path[-1].time + SECONDS
        motion.learn(path, taken, T, T_last_cur, covariance)
        path.append(TrajectoryPoint(taken, T, True))
    return path


def ahead(motion: MotionFilter, path, seconds=SECONDS):
    return motion.expected(path, path[-1].time + seconds, inverse(path[-1].T_world_camera))


def test_constant_motion_goes_on():
    motion = MotionFilter(TrackConfig())
    assert motion.expected([TrajectoryPoint(0.0, START, True)], SECONDS, np.eye(4)) is None, (
        "nothing is known yet"
    )
    path = tracked(motion, [VELOCITY] * 30)
    for frames in (1, 2):
        expected = ahead(motion, path, frames * SECONDS)
        assert expected is not None
        np.testing.assert_allclose(expected.T, exp_se3(frames * VELOCITY * SECONDS), atol=1e-9)
    np.testing.assert_allclose(
        motion.acceleration, [0.5, 3.0], err_msg="nothing has accelerated: the least is left"
    )


def test_certainty_is_that_of_velocity_and_acceleration():
    """Seen from another view and by a slow way: random next poses have the covariance that is stated."""
    motion, rng = MotionFilter(TrackConfig()), np.random.default_rng(0)
    path = tracked(motion, [VELOCITY] * 30)
    T_view_world = exp_se3(np.array([0.5, 0.1, 0.2, 0.3, -0.4, 0.2]))
    expected = motion.expected(path, path[-1].time + SECONDS, T_view_world)
    assert expected is not None
    std = np.repeat(motion.acceleration * SECONDS, 3)
    twists = []
    for _ in range(4000):
        velocity = rng.multivariate_normal(motion.velocity, motion.covariance) + std * rng.standard_normal(6)
        T = T_view_world @ path[-1].T_world_camera @ exp_se3(velocity * SECONDS)
        twists.append(log_se3(T @ inverse(expected.T)))
    # Information is in units of a residual's stated variance, which is too small by the factor 5.
    stated = 5 * np.linalg.inv(expected.information)
    np.testing.assert_allclose(np.cov(np.array(twists).T), stated, atol=0.1 * np.abs(stated).max())


def test_a_camera_that_jerks_is_expected_to_jerk_again():
    steady, jerky = MotionFilter(TrackConfig()), MotionFilter(TrackConfig())
    path = tracked(steady, [VELOCITY] * 30)
    other = tracked(jerky, [VELOCITY] * 30 + [VELOCITY + [0.2, 0, 0, 0, 2, 0]] + [VELOCITY])
    calm, wild = ahead(steady, path), ahead(jerky, other)
    assert calm is not None and wild is not None
    assert jerky.acceleration[0] > 2 and jerky.acceleration[1] > 20
    assert np.trace(np.linalg.inv(wild.information)) > 5 * np.trace(np.linalg.inv(calm.information))
    tracked(jerky, [VELOCITY] * 60, path=other)
    np.testing.assert_allclose(jerky.acceleration, [0.5, 3.0], rtol=1e-6, err_msg="and calms down again")


def test_a_gap_ends_what_is_known():
    motion = MotionFilter(TrackConfig())
    path = tracked(motion, [VELOCITY] * 5)
    assert ahead(motion, path, 0.5) is None, "too long ago"
    assert ahead(motion, path, 0.0) is None, "stamps that stand still"
    assert MotionFilter(TrackConfig(motion=False)).expected(path, path[-1].time + SECONDS, np.eye(4)) is None
    last = path[-1]
    path.append(TrajectoryPoint(last.time + SECONDS, last.T_world_camera, False))
    assert ahead(motion, path) is None, "a lost frame"
    path.append(TrajectoryPoint(last.time + 2 * SECONDS, last.T_world_camera, True))
    assert ahead(motion, path) is None, "found again: where it goes from there is not known"
    tracked(motion, [VELOCITY], path=path)
    assert ahead(motion, path) is not None


def test_state_goes_on():
    motion = MotionFilter(TrackConfig())
    path = tracked(motion, [VELOCITY] * 5 + [1.1 * VELOCITY])
    other = MotionFilter(TrackConfig())
    other.load_state(motion.state())
    ours, theirs = ahead(motion, path), ahead(other, path)
    assert ours is not None and theirs is not None
    np.testing.assert_array_equal(ours.information, theirs.information)
    np.testing.assert_array_equal(ours.T, theirs.T)
    np.testing.assert_array_equal(motion.acceleration, other.acceleration)
