"""Readers, association, calibration, resizing, the writer."""

import threading

import cv2
import numpy as np
import pytest
import yaml
from conftest import shared_data
from sequence_files import CAMERA, RATE, colour, depth, pose, write_redwood, write_seven_scenes, write_tum

from dsmap.frame import Intrinsics
from dsmap.sequences import SequenceWriter, open_sequence
from dsmap.sequences.associate import associate, gaps, poses_at
from dsmap.sequences.calibration import known_default
from dsmap.sequences.images import resize_nearest
from dsmap.sequences.mesh import LabelledMesh, read_mesh, write_mesh
from dsmap.sequences.registration import register_colour, register_depth


def test_what_the_writer_writes_is_read_back(tmp_path):
    sequence = open_sequence(write_tum(tmp_path / "s", labels=True))
    assert (sequence.layout, len(sequence), sequence.intrinsics) == ("tum", 6, CAMERA)
    assert sequence.intrinsics_source == "calibration.yaml" and sequence.depth_scale == 1000.0
    assert sequence.has_labels and sequence.has_poses and sequence.labelled() == list(range(6))
    frames = list(sequence)
    assert [f.index for f in frames] == list(range(6)) and sequence.skipped == []
    for i, frame in enumerate(frames):
        np.testing.assert_array_equal(frame.rgb, colour(i))
        np.testing.assert_allclose(frame.depth, depth(i), atol=1e-6)
        np.testing.assert_allclose(frame.T_world_camera, pose(i), atol=1e-7)
        assert frame.time == pytest.approx(i / RATE, abs=1e-6)
        assert frame.label is not None and frame.label.dtype == np.uint8 and (frame.label == i % 13 + 1).all()
        assert frame.instance is not None and (frame.instance == 1000 + i).all()


def test_seven_scenes(tmp_path):
    sequence = open_sequence(write_seven_scenes(tmp_path / "s"))
    assert (sequence.layout, sequence.depth_scale) == ("7-scenes", 1000.0)
    assert sequence.intrinsics_source == "known default of 7-Scenes"
    frame = sequence.frame(2)
    assert frame.depth[10, 10] == 0, "65535 is no measurement"
    assert sequence.calibration.color_camera is not None and sequence.calibration.T_color_depth is not None
    looked_up = register_colour(
        colour(2),
        frame.depth,
        sequence.intrinsics,
        sequence.calibration.color_camera,
        sequence.calibration.T_color_depth,
    )
    np.testing.assert_array_equal(frame.rgb, looked_up)
    np.testing.assert_allclose(frame.T_world_camera, pose(2))


@pytest.mark.parametrize("first", [0, 1])
def test_redwood(tmp_path, first):
    sequence = open_sequence(write_redwood(tmp_path / "s", first=first))
    assert (sequence.layout, sequence.intrinsics_source) == ("redwood", "known default of Redwood")
    np.testing.assert_allclose(sequence.frame(3).T_world_camera, pose(3), atol=1e-8)
    np.testing.assert_array_equal(sequence.frame(3).rgb, colour(3))


def test_redwood_without_trajectory_has_no_poses(tmp_path):
    sequence = open_sequence(write_redwood(tmp_path / "s", trajectory=False))
    assert not sequence.has_poses and sequence.T_world_camera(0) is None


def test_pairs_are_one_to_one_nearest_first():
    first, second = np.array([0.0, 0.010, 1.0]), np.array([0.009, 0.029, 1.021])
    # 0.010-0.009 is the nearest pair; 0.0 could only have had 0.009; 1.0 and 1.021 are too far apart.
    assert associate(first, second) == [(1, 0)]
    assert associate(np.array([0.0, 0.010]), np.array([0.009, 0.029])) == [(1, 0)]
    assert associate(np.array([0.0, 0.012]), np.array([0.009, 0.029])) == [(1, 0)]
    assert associate(np.array([0.0, 0.025]), np.array([0.009, 0.029])) == [(0, 0), (1, 1)]


def test_poses_are_interpolated_and_left_out_far_from_any():
    half_turn = [0, 0, np.sin(np.pi / 4), np.cos(np.pi / 4)]  # 90 degrees about z
    poses = np.array([[0, 0, 0, 0, 0, 0, 1], [1, 0, 0, *half_turn], [5, 0, 0, 0, 0, 0, 1]], dtype=float)
    between, near, far = poses_at(np.array([0.01, 1.01, 0.5]), np.array([0.0, 0.02, 1.0]), poses)
    np.testing.assert_allclose(between[:3, 3], (0.5, 0, 0))
    np.testing.assert_allclose(between[:2, 0], (np.sqrt(0.5), np.sqrt(0.5)))
    np.testing.assert_allclose(near[:3, 3], (5, 0, 0))
    assert far is None


def test_given_poses_are_those_of_the_depth_images(tmp_path):
    folder = write_tum(tmp_path / "s")
    lines = (folder / "depth.txt").read_text().splitlines()
    late = [line for line in lines if line.startswith("#")]
    late += [f"{float(t) + 0.01:.6f} {name}" for t, name in (x.split() for x in lines if x[0] != "#")]
    (folder / "depth.txt").write_text("\n".join(late))
    frame = open_sequence(folder).frame(2)
    assert frame.time == pytest.approx(2 / RATE, abs=1e-5)
    assert frame.depth_time == pytest.approx(2 / RATE + 0.01, abs=1e-5)
    assert frame.T_world_camera is not None
    assert frame.T_world_camera[0, 3] == pytest.approx(0.2 + 0.1 * 0.01 * RATE, abs=1e-4)


def test_gaps_are_three_median_intervals():
    times = np.array([0.0, 0.1, 0.2, 0.3, 0.65, 0.75])
    assert gaps(times) == [(0.3, pytest.approx(0.35))]


def test_stamps_out_of_order_are_sorted_and_counted(tmp_path):
    folder = write_tum(tmp_path / "s")
    lines = (folder / "rgb.txt").read_text().splitlines()
    lines[2], lines[4] = lines[4], lines[2]
    (folder / "rgb.txt").write_text("\n".join(lines))
    sequence = open_sequence(folder)
    assert len(sequence) == 6 and (np.diff(sequence.times) > 0).all()
    np.testing.assert_array_equal(sequence.frame(0).rgb, colour(0))
    assert any("rgb.txt" in note and "out of order" in note for note in sequence.notes)


def test_start_stop_stride_keep_the_index_of_the_recording(tmp_path):
    sequence = open_sequence(write_tum(tmp_path / "s"), start=1, stop=6, stride=2)
    assert [frame.index for frame in sequence] == [1, 3, 5]


def test_the_frame_rate_is_that_of_the_frames_taken(tmp_path):
    folder = write_tum(tmp_path / "s")
    times = open_sequence(folder).times
    for stride in (1, 2):
        expected = 1 / np.median(np.diff(times[::stride]))
        assert open_sequence(folder, stride=stride).frame_rate == pytest.approx(expected)
    assert open_sequence(folder, stop=1).frame_rate is None


def test_half_pixel_centres_are_converted(tmp_path):
    folder = write_tum(tmp_path / "s")
    content = yaml.safe_load((folder / "calibration.yaml").read_text())
    content |= {"pixel_center": "half", "cx": 32.0, "cy": 24.0}
    (folder / "calibration.yaml").write_text(yaml.safe_dump(content))
    sequence = open_sequence(folder)
    assert (sequence.intrinsics.cx, sequence.intrinsics.cy) == (31.5, 23.5)
    assert sequence.calibration.pixel_center == "half"


def test_flags_come_before_the_file(tmp_path):
    sequence = open_sequence(write_tum(tmp_path / "s"), intrinsics=(70, 71, 30, 20), depth_scale=2000)
    assert (sequence.intrinsics.fx, sequence.intrinsics.cy, sequence.depth_scale) == (70, 20, 2000)
    np.testing.assert_allclose(sequence.frame(0).depth, depth(0) / 2, atol=1e-6)
    mixed = open_sequence(tmp_path / "s", depth_scale=2000)
    assert mixed.intrinsics_source == "intrinsics: calibration.yaml, depth scale: --depth-scale"


def test_known_defaults_follow_the_name_and_the_size(tmp_path):
    fr2 = known_default("tum", tmp_path / "rgbd_dataset_freiburg2_desk", 640, 480)
    assert fr2 is not None and fr2.intrinsics.fx == 520.9 and fr2.source == "known default of TUM fr2"
    fr3 = known_default("tum", tmp_path / "fr3_office", 320, 240)
    assert fr3 is not None and fr3.intrinsics.fx == pytest.approx(267.7) and fr3.intrinsics.distortion is None
    kitchen = known_default("7-scenes", tmp_path, 320, 240)
    assert kitchen is not None
    k = kitchen.intrinsics
    assert (k.fx, k.fy, k.cx, k.cy) == (292.5, 292.5, 160, 120)
    assert known_default("tum", tmp_path / "mine", 640, 480) is None
    assert known_default("tum", tmp_path / "fr11", 640, 480) is None


def test_a_smaller_size_keeps_pixels_and_rays_together(tmp_path):
    sequence = open_sequence(write_tum(tmp_path / "s"), size=(32, 24))
    frame = sequence.frame(1)
    assert frame.rgb.shape == (24, 32, 3) and frame.depth.shape == (24, 32)
    # Nearest neighbour: every new depth is one of the four it covers.
    blocks = depth(1).reshape(24, 2, 32, 2).swapaxes(1, 2).reshape(24, 32, 4)
    assert (np.abs(blocks - frame.depth[..., None]).min(axis=-1) < 1e-6).all()
    assert sequence.intrinsics == Intrinsics(32, 24, 30.0, 30.0, 15.5, 11.5)


def test_nearest_takes_the_pixel_under_the_centre():
    ramp = np.arange(9, dtype=np.float32)[None]
    np.testing.assert_array_equal(resize_nearest(ramp, 3, 1), [[1, 4, 7]])
    np.testing.assert_array_equal(resize_nearest(ramp, 18, 1), np.repeat(ramp, 2, axis=1))


def test_undistorting_straightens_what_the_lens_bent(tmp_path):
    camera = Intrinsics(160, 120, 140.0, 140.0, 79.5, 59.5, distortion=(0.3, -0.1, 0.0, 0.0, 0.0))
    coefficients = np.array(camera.distortion)
    # What a distorted camera sees of a vertical line at x = 0.4 m, 1 m away.
    points = np.stack([np.full(200, 0.4), np.linspace(-0.5, 0.5, 200), np.ones(200)], axis=1)
    pixels = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.K, coefficients)[0].reshape(-1, 2)
    rgb = np.zeros((120, 160, 3), np.uint8)
    for x, y in pixels:
        if 0 <= y < 119.5:
            rgb[int(y + 0.5), int(x + 0.5)] = 255
    with SequenceWriter(tmp_path / "s", camera) as writer:
        writer.write(0.0, rgb, np.where(rgb[..., 0] > 0, 1.0, 2.0))
    bent, straight = open_sequence(tmp_path / "s"), open_sequence(tmp_path / "s", undistort=True)
    assert straight.intrinsics.distortion is None and bent.intrinsics.distortion == camera.distortion

    def columns(frame):
        return np.nonzero(frame.depth == 1.0)[1]

    expected = camera.fx * 0.4 + camera.cx
    assert np.abs(columns(straight.frame(0)) - expected).max() <= 1
    assert np.abs(columns(bent.frame(0)) - expected).max() > 3


def test_depth_of_a_second_camera_is_registered():
    camera = Intrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
    shifted = np.eye(4)
    shifted[0, 3] = 0.05  # 0.05 m * 60 px / 1.5 m = 2 px to the right
    wall = np.full((48, 64), 1.5, dtype=np.float32)
    wall[20, 30] = 1.0  # moves 3 px: nearer than what it lands on
    registered = register_depth(wall, camera, shifted)
    assert (registered[:, :2] == 0).all() and registered[20, 33] == 1.0 and registered[5, 5] == 1.5


def test_colour_of_a_second_camera_is_registered():
    """A plane painted with a smooth function of its own coordinates, seen by two cameras."""
    depth_camera = Intrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
    color_camera = Intrinsics(96, 80, 70.0, 72.0, 47.0, 40.0)
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array([0.02, -0.03, 0.05]))[0]
    T[:3, 3] = (-0.05, 0.02, 0.01)

    def paint(x, y):
        return np.stack(
            [128 + 90 * np.sin(2 * x), 128 + 90 * np.cos(3 * y), 128 + 60 * np.sin(x + 2 * y)], -1
        )

    # The plane z = 1.5 of the depth camera, met by every ray of the colour camera.
    v, u = np.mgrid[: color_camera.height, : color_camera.width]
    rays = np.stack([(u - 47.0) / 70.0, (v - 40.0) / 72.0, np.ones(u.shape)], -1)
    T_depth_color = np.linalg.inv(T)
    directions = rays @ T_depth_color[:3, :3].T
    hit = T_depth_color[:3, 3] + directions * ((1.5 - T_depth_color[2, 3]) / directions[..., 2])[..., None]
    rgb = np.rint(paint(hit[..., 0], hit[..., 1])).astype(np.uint8)

    depth = np.full((48, 64), 1.5, dtype=np.float32)
    depth[10:14, 20:26] = 0  # a hole borrows its neighbours' depth
    v, u = np.mgrid[:48, :64]
    expected = paint((u - 31.5) / 60.0 * 1.5, (v - 23.5) / 60.0 * 1.5)
    found = register_colour(rgb, depth, depth_camera, color_camera, T)
    np.testing.assert_allclose(found, expected, atol=2.5)
    assert np.abs(cv2.resize(rgb, (64, 48)).astype(float) - expected).max() > 20, "the test would not notice"


def test_iterating_stops_its_thread_when_the_consumer_leaves(tmp_path):
    sequence = open_sequence(write_tum(tmp_path / "s", frames=20))
    for frame in sequence:
        if frame.index == 2:
            break
    assert not [t for t in threading.enumerate() if t.name == "dsmap-decode"]
    assert len(list(sequence)) == 20, "a second walk starts anew"


def test_labels_of_a_few_frames_only(tmp_path):
    folder = write_tum(tmp_path / "s", labels=True)
    lines = (folder / "label.txt").read_text().splitlines()
    (folder / "label.txt").write_text("\n".join([*lines[:2], lines[4]]))
    sequence = open_sequence(folder)
    assert sequence.labelled() == [2]
    assert sequence.frame(1).label is None and (sequence.frame(2).label == 3).all()


def test_a_mesh_is_read_back(tmp_path):
    rng = np.random.default_rng(0)
    mesh = LabelledMesh(
        rng.random((5, 3), dtype=np.float32),
        rng.integers(0, 5, (7, 3), dtype=np.int32),
        np.arange(7, dtype=np.uint8),
    )
    write_mesh(tmp_path / "mesh.ply", mesh)
    read = read_mesh(tmp_path / "mesh.ply")
    np.testing.assert_array_equal(read.vertices, mesh.vertices)
    np.testing.assert_array_equal(read.faces, mesh.faces)
    np.testing.assert_array_equal(read.label, mesh.label)


def test_real_tum_recording_has_300_pairs():
    sequence = open_sequence(shared_data("tum_fr1_xyz_10s"))
    assert (len(sequence), sequence.recording.num_rgb, sequence.recording.num_depth) == (300, 300, 301)
    assert sequence.intrinsics.fx == 517.3 and sequence.intrinsics_source == "known default of TUM fr1"
    frame = sequence.frame(0)
    assert abs(frame.pose_time - frame.time) < 0.005, "depth of fr1 is stamped 20 ms late"
    assert sequence.readout_s == 0.026, "a Kinect's rolling shutter"
    assert frame.rgb.shape == (480, 640, 3) and 0.5 < np.median(frame.depth[frame.depth > 0]) < 2


@pytest.mark.parametrize(
    ("name", "layout", "frames"),
    [("7scenes_redkitchen_320", "7-scenes", 600), ("livingroom1_micro", "redwood", 211)],
)
def test_other_real_recordings(name, layout, frames):
    sequence = open_sequence(shared_data(name))
    assert (sequence.layout, len(sequence), sequence.has_poses) == (layout, frames, True)
    assert 0.5 < np.median(sequence.depth(frames // 2)) < 4
