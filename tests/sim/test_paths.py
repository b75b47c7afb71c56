"""Camera paths: clear of things, calm, through doors and back, and the trials."""

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt
from sim_toys import two_rooms

from dsmap.errors import InputError
from dsmap.sim_scenes.camera_paths.hand import BANDS_HZ, POSITION_RMS_M, ROTATION_RMS_RAD, tremor
from dsmap.sim_scenes.camera_paths.paths import camera_path, frame_rotations, walked_length
from dsmap.sim_scenes.camera_paths.trials import covered_frames
from dsmap.sim_scenes.rooms.build import build_scene
from dsmap.sim_scenes.space.free_space import FreeSpace

FPS = 15.0


def angle_between(a: np.ndarray, b: np.ndarray) -> float:
    """Angle between two poses [deg]."""
    return float(np.degrees(np.arccos(np.clip((np.trace(a[:3, :3].T @ b[:3, :3]) - 1) / 2, -1, 1))))


@pytest.mark.parametrize("seed", [1, 2])
def test_a_round_trip_visits_both_rooms_and_comes_back(seed: int) -> None:
    scene = two_rooms()
    poses = camera_path(scene, "loop", 0, FPS, seed)
    eyes = poses[:, :3, 3]
    assert walked_length(eyes) >= 15.0
    assert eyes[:, 0].min() < -0.5 and eyes[:, 0].max() > 0.8
    assert np.linalg.norm(eyes[-1] - eyes[0]) < 0.03 and angle_between(poses[0], poses[-1]) < 3.0
    speed = np.linalg.norm(np.diff(eyes, axis=0), axis=1) * FPS
    turning = frame_rotations(poses) * FPS
    assert speed.max() <= 0.7 and np.median(turning) < 35 and turning.max() < 90
    assert FreeSpace(scene).clearance(eyes).min() > 0.3
    # Through the opening and not through the wall.
    crossing = np.flatnonzero(np.diff(np.sign(eyes[:, 0])) != 0)
    assert len(crossing) >= 2 and (np.abs(eyes[crossing, 1] - 0.6) < 0.35).all()


def test_a_round_trip_of_given_length_begins_alike_and_goes_around_again() -> None:
    scene = two_rooms()
    whole = camera_path(scene, "loop", 0, FPS, 3)
    part = camera_path(scene, "loop", 100, FPS, 3)
    more = camera_path(scene, "loop", len(whole) + 200, FPS, 3)
    assert np.allclose(part, whole[:100])
    assert np.allclose(more[: len(whole)], whole) and len(more) == len(whole) + 200
    assert walked_length(more[len(whole) :, :3, 3]) > 1.0


def test_a_round_trip_in_one_room() -> None:
    scene = build_scene("living_room", 1)
    poses = camera_path(scene, "loop", 0, FPS, 1)
    assert walked_length(poses[:, :3, 3]) > 5.0
    assert np.linalg.norm(poses[-1, :3, 3] - poses[0, :3, 3]) < 0.03
    assert angle_between(poses[0], poses[-1]) < 3.0
    assert FreeSpace(scene).clearance(poses[:, :3, 3]).min() > 0.25


def test_walks_through_flats_pass_doors_and_longer_ones_begin_like_shorter_ones() -> None:
    scene = two_rooms()
    short, long = (camera_path(scene, "walk", n, FPS, 2) for n in (60, 700))
    assert np.allclose(short, long[:60])
    assert long[:, 0, 3].min() < -0.5 and long[:, 0, 3].max() > 0.5
    assert FreeSpace(scene).clearance(long[:, :3, 3]).min() > 0.3


def test_fast_has_bursts_of_120_degrees_a_second_for_half_a_second() -> None:
    poses = camera_path(two_rooms(), "fast", 300, 30.0, 1)
    turning = frame_rotations(poses) * 30
    window = np.lib.stride_tricks.sliding_window_view(turning, 15).mean(1)
    assert (window >= 120).any()
    assert np.median(turning) < 60
    assert (frame_rotations(camera_path(two_rooms(), "walk", 300, 30.0, 1)) * 30).max() < 100


def test_a_shaken_camera_turns_about_all_axes_by_up_to_250_degrees_a_second() -> None:
    for seed in (1, 2, 3):
        poses = camera_path(two_rooms(), "shake", 90, 30.0, seed)
        relative = np.einsum("nji,njk->nik", poses[:-1, :3, :3], poses[1:, :3, :3])
        about = np.abs([R[[2, 0, 1], [1, 2, 0]] for R in relative]) * np.degrees(30.0)
        assert 150 < (frame_rotations(poses) * 30).max() < 260
        assert (about.max(axis=0) > 60).all() and (frame_rotations(poses[:4]) * 30).max() < 60


def test_the_covered_lens_is_covered_for_a_second() -> None:
    covered = covered_frames("cover", 300, 30.0, 1)
    edges = np.flatnonzero(np.diff(covered.astype(int)))
    assert 29 <= edges[1] - edges[0] <= 31 and not covered[:30].any()
    assert 0.05 < covered.mean() < 0.25
    assert not covered_frames("walk", 300, 30.0, 1).any()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_jump_leads_to_a_place_seen_before(seed: int) -> None:
    poses = camera_path(two_rooms(), "jump", 450, 30.0, seed)
    eyes = poses[:, :3, 3]
    step = np.linalg.norm(np.diff(eyes, axis=0), axis=1) + np.radians(frame_rotations(poses))
    leaps = np.flatnonzero(step > 0.3)
    assert 1 <= len(leaps) <= 3
    for k in leaps:
        back = np.linalg.norm(eyes[: k - 15] - eyes[k + 1], axis=1)
        near = int(np.argmin(back))
        assert back[near] < 0.05 and angle_between(poses[near], poses[k + 1]) < 5.0


def test_the_tremor_has_the_spectrum_that_was_measured() -> None:
    t = np.arange(0, 60, 0.01)
    for seed in range(2):
        shake = tremor(np.random.default_rng(seed), t)
        for (low, high), shift, turn in zip(BANDS_HZ, POSITION_RMS_M, ROTATION_RMS_RAD, strict=True):
            if low < 2.0:
                continue
            rms = sosfiltfilt(butter(3, (low, high), "band", fs=100, output="sos"), shake, axis=0).std(0)
            assert rms[:3].mean() == pytest.approx(shift, rel=0.35)
            assert rms[3:].mean() == pytest.approx(turn, rel=0.35)


def test_unknown_kinds_and_missing_lengths_are_input_errors() -> None:
    with pytest.raises(InputError, match="expected one of: walk, views, loop"):
        camera_path(two_rooms(), "fly", 10, FPS, 1)
    with pytest.raises(InputError, match="frames is 0"):
        camera_path(two_rooms(), "walk", 0, FPS, 1)


def test_the_inside_of_a_cupboard_is_not_free_space() -> None:
    space = FreeSpace(two_rooms())
    inside, free, wall, outside = [-2.6, 1.65, 1.4], [-3.5, -1.5, 1.4], [0.0, -1.0, 1.4], [5.0, 0.0, 1.4]
    clear = space.clearance(np.array([inside, free, wall, outside]))
    assert (clear[[0, 2, 3]] == 0).all() and clear[1] == pytest.approx(0.5, abs=0.06)
