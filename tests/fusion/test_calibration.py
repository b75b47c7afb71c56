"""Calibration without a target: a synthetic room whose cameras are known, and what is said of the outcome."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from calibration_world import World, camera
from scipy.spatial.transform import Rotation

from dsmap.fusion.calibration.depth_planes import depth_planes, look_up
from dsmap.fusion.calibration.estimate import Estimate, estimate
from dsmap.fusion.calibration.features import follow
from dsmap.fusion.calibration.pose_scale import PoseScale, pose_scale
from dsmap.fusion.calibration.pose_spline import PoseSpline
from dsmap.fusion.calibration.recording import stretches
from dsmap.fusion.calibration.report import report
from dsmap.fusion.calibration.rig import PLACE, Rig
from dsmap.sequences.calibration import Calibration

TURN = (0.01, -0.02, 0.015)


def beside() -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(TURN).as_matrix(), (-0.025, 0.004, 0.006)
    return T


def solved(truth: Calibration, given: Calibration, places: bool, **world: float) -> Estimate:
    windows = [World(truth, seed=1, window=w, frames=24, **world).start() for w in range(2)]
    return estimate(Rig(given, places), windows)


@pytest.fixture(scope="module")
def registered() -> Estimate:
    truth = Calibration(camera(), 1000.0, "", depth_time_offset_s=0.012, readout_s=0.02)
    given = replace(truth, intrinsics=camera(131.0 * 1.03, -0.02), depth_time_offset_s=0.0, readout_s=0.0)
    return solved(truth, given, False, depth_noise=5e-4, pixel_noise=0.1, turning=1.5)


def test_lens_and_times_are_found_from_wrong_ones(registered):
    found = registered.rig.cameras(registered.vector)
    assert found.colour.fx == pytest.approx(131.0, rel=0.005)
    assert found.colour.distortion is not None
    assert found.colour.distortion[0] == pytest.approx(-0.04, abs=0.005)
    assert found.readout_s == pytest.approx(0.02, abs=0.002)
    assert found.offset_s == pytest.approx(0.012, abs=0.001)


def test_standard_deviations_cover_the_errors(registered):
    truth = np.array([-np.log(1.03), 0.0, 0.0, -0.02, 0.02, 0.012])
    off = np.abs(registered.vector - truth) / registered.sigma
    assert (off < 4).all(), off
    assert (registered.sigma < registered.rig.prior_sigma / 4).all()


def test_the_depth_camera_is_found_beside_the_colour_camera():
    truth = Calibration(camera(k1=0.0), 1000.0, "", readout_s=0.02, T_color_depth=beside())
    found = solved(
        truth, replace(truth, T_color_depth=np.eye(4)), True, depth_noise=2e-5, pixel_noise=0.02, turning=2.0
    )
    got = found.rig.cameras(found.vector)
    assert np.allclose(got.t_color_depth, truth.T_color_depth[:3, 3], atol=0.002)
    between = Rotation.from_matrix(got.R_color_depth.T @ truth.T_color_depth[:3, :3])
    assert np.rad2deg(between.magnitude()) < 0.2


def test_a_camera_that_does_not_turn_leaves_its_times_undetermined():
    truth = Calibration(camera(), 1000.0, "", readout_s=0.02)
    found = solved(truth, replace(truth, readout_s=0.0), False, turning=0.0, moving=0.02)
    told = report(found, False, None, False)
    assert {"readout_s", "depth_time_offset_s", "depth_scale"} <= set(told.calibration.undetermined)
    assert told.calibration.readout_s == 0.0
    assert not told.warnings
    advice = {line.name: line.advice for line in told.lines}
    assert "turn" in advice["readout_s"]


def test_a_contradiction_is_warned_of_and_the_found_number_written(registered):
    told = report(registered, False, None, False)
    assert any("fx 134.93" in warning for warning in told.warnings)
    assert any("readout_s" in warning for warning in told.warnings)
    assert told.calibration.intrinsics.fx == pytest.approx(131.0, rel=0.005)
    assert told.calibration.uncertainty is not None
    assert 0 < told.calibration.uncertainty["fx"] < 0.7


def test_depth_scale_comes_from_poses_only_where_that_is_asked_for(registered):
    scale = PoseScale(1.1, 0.002)
    assert report(registered, False, scale, False).calibration.depth_scale == 1000.0
    assert report(registered, False, scale, True).calibration.depth_scale == pytest.approx(1000.0 / 1.1)
    assert "depth_scale" in report(registered, False, None, True).calibration.undetermined


def test_scale_of_poses_is_that_of_their_lengths():
    truth = Calibration(camera(), 1000.0, "")
    windows = [World(truth, seed=2, window=w, frames=12).start(0.0) for w in range(3)]
    cameras = Rig(truth, False).cameras(np.zeros(6))
    for k, window in enumerate(windows):
        window.tracks.given_centres = 1.05 * World(truth, seed=2, window=k).pose(window.tracks.times)[1]
    found = pose_scale(windows, cameras, False)
    assert found is not None
    assert found.factor == pytest.approx(1.05, rel=1e-3)
    windows[0].tracks.given_centres = None
    assert pose_scale(windows, cameras, False) is None


def test_spline_goes_through_frames_and_between_them():
    times = np.array([0.0, 0.03, 0.07, 0.1, 0.13, 0.17, 0.2, 0.23])
    turns = np.stack([0.2 * np.sin(5 * times), 0.1 * np.cos(4 * times), 0.05 * times], axis=1)
    centres = np.stack([np.sin(3 * times), times, times**2], axis=1)
    spline = PoseSpline(times)
    controls = spline.controls(Rotation.from_rotvec(turns).as_matrix(), centres)
    R, c = spline.at(*controls, *spline.shares(times))
    assert np.allclose(c, centres, atol=1e-9)
    assert np.allclose(R, Rotation.from_rotvec(turns).as_matrix(), atol=2e-3)
    later = times[2:-2] + 0.013
    _, between = spline.at(*controls, *spline.shares(later))
    assert np.allclose(between, np.stack([np.sin(3 * later), later, later**2], axis=1), atol=1e-3)


def test_planes_are_exact_on_a_wall_and_absent_on_edges_and_holes():
    y, x = np.mgrid[:120, :160].astype(np.float64)
    inverse = 0.4 + 1e-3 * (x - 80) - 5e-4 * (y - 60)
    depth = 1 / inverse
    depth[:, 100:] *= 0.5  # something near
    depth[40, 40] = 0
    planes = depth_planes(depth)[None]
    at = np.array([[60.25, 70.5], [100.0, 60.0], [40.0, 41.0], [300.0, 5.0], [np.nan, 5.0]])
    found, there = look_up(planes, np.zeros(5, int), at)
    assert there.tolist() == [True, False, False, False, False]
    assert found[0] == pytest.approx([0.4 + 1e-3 * -19.75 - 5e-4 * 10.5, 1e-3, -5e-4], rel=1e-4)


def test_planes_leave_out_the_corner_between_two_walls():
    y, x = np.mgrid[:120, :160].astype(np.float64)
    rng = np.random.default_rng(0)
    inverse = 0.5 - 3e-3 * np.abs(x - 80) + 1e-3 * rng.standard_normal(x.shape)
    planes = depth_planes(1 / inverse)[..., 0]
    assert (planes[10:-10, 80] == 0).mean() > 0.9
    assert (planes[10:-10, 20:70] > 0).mean() > 0.8


def test_corners_are_followed_to_a_tenth_of_a_pixel():
    rng = np.random.default_rng(0)
    texture = np.repeat(np.repeat(rng.integers(0, 255, (40, 50)), 8, 0), 8, 1).astype(np.float32)
    smooth = cv2.GaussianBlur(texture, (0, 0), 1.5)
    images = []
    for i in range(20):
        shift = np.array([[1, 0, -30 - 1.3 * i], [0, 1, -30 - 0.7 * i]], np.float32)
        images.append(cv2.warpAffine(smooth, shift, (320, 240)).clip(0, 255).astype(np.uint8))
    corners = follow(images)
    _, first, track = np.unique(corners.track, return_index=True, return_inverse=True)
    age = corners.frame - corners.frame[first][track]
    moved = corners.pixel - corners.pixel[first][track]
    off = (moved + age[:, None] * (1.3, 0.7))[age >= 10]
    assert len(off) > 200
    assert np.median(np.abs(off)) < 0.1


def test_windows_do_not_reach_over_holes():
    times = np.concatenate([np.arange(100) / 30, 10 + np.arange(100) / 30])
    found = stretches(times, 180)
    assert all(r.stop <= 100 or r.start >= 100 for r in found)
    assert len(found) == 4
    assert stretches(np.array([0.0, 1.0]), 90) == []


def test_a_rig_moves_only_what_it_is_told_to():
    given = Calibration(camera(k1=0.0), 1000.0, "", T_color_depth=beside())
    rig = Rig(given, True)
    still = rig.cameras(np.zeros(len(rig.names)))
    assert np.allclose(still.T_color_depth, beside())
    assert still.colour.fx == given.intrinsics.fx
    vector = np.zeros(len(rig.names))
    vector[rig.names.index(PLACE[0])] = 0.01
    assert np.allclose(rig.cameras(vector).t_color_depth - still.t_color_depth, (0.01, 0, 0))
