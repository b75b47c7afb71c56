"""Registration that stays on the device, tried on the CPU: the same as the host's, within rounding."""

import dataclasses

import numpy as np
import pytest
import warp as wp
from corner_frames import FRAMES, config

from dsmap.fusion import lie
from dsmap.fusion.config import TrackConfig
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.surfels.model_view import ModelView
from dsmap.fusion.tracking import tracker as tracking
from dsmap.fusion.tracking.motion_filter import Expected
from dsmap.fusion.tracking.rolling_shutter import RowMotion
from dsmap.kernels import se3
from dsmap.kernels.preprocess import preprocess
from dsmap.tools.twins import corner

CPU = wp.get_device("cpu")
MOTION = lie.exp_se3(np.array([0.02, -0.01, 0.015, 0.01, 0.02, -0.01]))


@pytest.fixture
def forced(monkeypatch):
    monkeypatch.setenv("DSMAP_FORCE_DEVICE_PATH", "1")


@wp.kernel
def _of_twist(xi: wp.array(dtype=se3.vec6d), T: wp.array(dtype=wp.mat44d), back: wp.array(dtype=se3.vec6d)):
    i = wp.tid()
    T[i] = se3.exp_se3(xi[i])
    back[i] = se3.log_se3(se3.inverse(se3.inverse(T[i])))


@wp.kernel
def _of_matrix(
    A: wp.array(dtype=se3.mat66d),
    b: wp.array(dtype=se3.vec6d),
    x: wp.array(dtype=se3.vec6d),
    fine: wp.array(dtype=int),
):
    i = wp.tid()
    L, definite = se3.cholesky(A[i])
    x[i] = se3.solve(L, b[i])
    fine[i] = int(definite)


@pytest.mark.parametrize("size", [1e-9, 1e-5, 1e-3, 0.3, 2.5])
def test_exponential_and_logarithm_are_those_of_the_twin(size):
    twists = np.random.default_rng(0).normal(0, size / 2, (40, 6)).clip(-1.3, 1.3)
    T, back = wp.empty(40, dtype=wp.mat44d, device="cpu"), wp.empty(40, dtype=se3.vec6d, device="cpu")
    wp.launch(
        _of_twist,
        40,
        inputs=[wp.array(twists, dtype=se3.vec6d, device="cpu")],
        outputs=[T, back],
        device="cpu",
    )
    np.testing.assert_allclose(T.numpy(), [lie.exp_se3(xi) for xi in twists], atol=1e-14)
    np.testing.assert_allclose(back.numpy(), twists, atol=1e-9)


def test_cholesky_solves_and_says_what_has_no_solution():
    rng = np.random.default_rng(0)
    J = rng.normal(size=(30, 20, 6))
    A, b = np.einsum("nij,nik->njk", J, J), rng.normal(size=(30, 6))
    A[-1, 2, 2], A[-2, 5, 5], A[-3] = -1.0, np.nan, 0.0
    x, fine = wp.empty(30, dtype=se3.vec6d, device="cpu"), wp.empty(30, dtype=int, device="cpu")
    arrays = [wp.array(A, dtype=se3.mat66d, device="cpu"), wp.array(b, dtype=se3.vec6d, device="cpu")]
    wp.launch(_of_matrix, 30, inputs=arrays, outputs=[x, fine], device="cpu")
    assert fine.numpy().tolist() == [1] * 27 + [0] * 3
    np.testing.assert_allclose(x.numpy()[:27], np.linalg.solve(A[:27], b[:27, :, None])[..., 0], atol=1e-10)


def views(rolled: bool):
    first = preprocess(*corner.room(np.eye(4)), corner.LEVEL_CAMERAS, CPU)
    images = corner.rolled(MOTION) if rolled else corner.room(MOTION)
    model = ModelView(first[0].vertex, first[0].normal, first[0].intensity, 3, np.eye(4))
    return preprocess(*images, corner.LEVEL_CAMERAS, CPU), model


@pytest.mark.parametrize(
    "what", ["as it is", "exposed", "no colour", "expected", "rolling", "one iteration", "fine weights"]
)
def test_the_device_finds_what_the_host_finds(what, monkeypatch):
    config = TrackConfig(iterations=(1, 1, 1)) if what == "one iteration" else TrackConfig()
    config = dataclasses.replace(config, huber_rgb=0.01, noise_z=0.2) if what == "fine weights" else config
    frame, model = views(what == "rolling")
    options = {"gain": {"exposed": 1.1, "no colour": None}.get(what, 1.0)}
    if what == "expected":
        options["expected"] = Expected(lie.exp_se3(np.array([0.03, 0, 0.01, 0, 0.02, 0])), np.diag([1e5] * 6))
    if what == "rolling":
        back = MOTION @ lie.exp_se3(-corner.TWIST / 30)
        options["rows"] = RowMotion(corner.READOUT, back, 1 / 30)
    tracker = tracking.Tracker(config, corner.LEVEL_CAMERAS)
    source = [maps.surface for maps in frame]
    T, health = tracker.register(source, model, np.eye(4), **options)
    looked = []
    monkeypatch.setattr(tracker, "normal_equations", lambda *a: looked.append(a))
    monkeypatch.setenv("DSMAP_FORCE_DEVICE_PATH", "1")
    T_device, health_device = tracker.register(source, model, np.eye(4), **options)
    assert not looked, "the host had no look at the equations"
    np.testing.assert_allclose(T_device, T, atol=1e-7)
    assert np.abs(T - np.eye(4)).max() > 5e-3, "it has moved"
    for name in ("tracked", "reason"):
        assert getattr(health_device, name) == getattr(health, name)
    for name in (
        "inlier_fraction",
        "rms_icp",
        "rms_rgb",
        "covariance",
        "information_icp",
        "inliers",
        "cofactor",
    ):
        np.testing.assert_allclose(
            getattr(health_device, name), getattr(health, name), rtol=1e-4, err_msg=name
        )


def test_what_leaves_directions_open_is_left_to_the_host(monkeypatch):
    depth = np.full((72, 96), 1.5, np.float32)
    rgb = np.full((72, 96, 3), 128, np.uint8)
    wall = preprocess(rgb, depth, corner.LEVEL_CAMERAS, CPU)
    model = ModelView(wall[0].vertex, wall[0].normal, wall[0].intensity, 3, np.eye(4))
    tracker = tracking.Tracker(TrackConfig(), corner.LEVEL_CAMERAS)
    source, start = [maps.surface for maps in wall], lie.exp_se3(np.array([0, 0, 0.004, 0, 0, 0]))
    T, health = tracker.register(source, model, start)
    assert len(health.unheld) == 3
    monkeypatch.setenv("DSMAP_FORCE_DEVICE_PATH", "1")
    T_device, health_device = tracker.register(source, model, start)
    np.testing.assert_array_equal(T_device, T)
    np.testing.assert_array_equal(health_device.unheld.twists, health.unheld.twists)


def test_a_recording_is_mapped_alike(monkeypatch):
    def mapped() -> Mapper:
        mapper = Mapper(config(), corner.INTRINSICS)
        assert all(mapper.step(frame).tracked for frame in FRAMES)
        return mapper

    host = mapped()
    monkeypatch.setenv("DSMAP_FORCE_DEVICE_PATH", "1")
    device = mapped()
    np.testing.assert_allclose(device.trajectory.poses, host.trajectory.poses, atol=2e-4)
    assert abs(device.surfels.count - host.surfels.count) <= 0.01 * host.surfels.count
