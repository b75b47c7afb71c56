"""What bags of ROS have of their own: two cameras, topics, encodings, clocks, poses as messages."""

from pathlib import Path

import numpy as np
import pytest
import ros_exporters as ros
from format_cases import CASES, written
from recording_shots import CAMERA, COUNT, START, shots

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sequences import open_sequence
from dsmap.sequences.cut import cut_sequence
from dsmap.sequences.formats.protocol import Options

SHOTS = shots()
OTHER = Intrinsics(96, 72, 80.0, 81.0, 46.0, 34.0)
T_COLOR_DEPTH = np.array([[1, 0, 0, 0.015], [0, 1, 0, 0.001], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def test_ros_two_cameras_are_joined_by_tf_static(tmp_path: Path):
    with ros.BagWriter(tmp_path / "bag", "mcap") as bag:
        T_link_color = np.eye(4)
        T_link_color[0, 3] = 0.1
        T_link_depth = T_link_color @ T_COLOR_DEPTH
        links = [("camera_link", "depth_frame", T_link_depth), ("camera_link", "color_frame", T_link_color)]
        bag.tf("/tf_static", SHOTS[0].time, links)
        for s in SHOTS:
            bag.camera_info("/cam/depth/camera_info", s.time, "depth_frame", OTHER)
            bag.camera_info("/cam/color/camera_info", s.time, "color_frame", CAMERA)
            bag.image("/cam/depth/image_rect_raw", s.time, "depth_frame", s.metres, "32FC1")
            bag.image("/cam/color/image_raw", s.time, "color_frame", s.rgb, "rgb8")
    sequence = open_sequence(tmp_path / "bag")
    assert sequence.calibration.T_color_depth == pytest.approx(T_COLOR_DEPTH)
    assert (sequence.intrinsics, sequence.calibration.color_camera) == (OTHER, CAMERA)
    assert np.array_equal(sequence.frame(4).depth, SHOTS[4].metres)


def test_topics_can_be_chosen_and_are_named(tmp_path: Path):
    with ros.BagWriter(tmp_path / "bag", "sqlite3") as bag:
        for s in SHOTS:
            for side, rgb in (("left", s.rgb), ("right", s.rgb[:, ::-1])):
                bag.camera_info(f"/{side}/rgb/camera_info", s.time, side, CAMERA)
                bag.image(f"/{side}/rgb/image", s.time, side, rgb, "rgb8")
                bag.image(f"/{side}/depth/image", s.time, side, s.millimetres, "16UC1")
    chosen = open_sequence(tmp_path / "bag", options=Options("/right/rgb/image", "right/depth/image"))
    assert np.array_equal(chosen.frame(0).rgb, SHOTS[0].rgb[:, ::-1])
    assert "/right/rgb/image" in chosen.notes[0]
    assert "--color-topic" in open_sequence(tmp_path / "bag").notes[0]
    with pytest.raises(InputError, match="/up/rgb for --color-topic, expected one of: .*/left/rgb/image"):
        open_sequence(tmp_path / "bag", options=Options(color_topic="/up/rgb"))


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "rgba8", "bgra8", "mono8"])
def test_colour_encodings(encoding: str, tmp_path: Path):
    rgb = SHOTS[0].rgb
    alpha = np.full((*rgb.shape[:2], 1), 9, np.uint8)
    stored = {
        "rgb8": rgb, "bgr8": rgb[..., ::-1], "rgba8": np.dstack([rgb, alpha]),
        "bgra8": np.dstack([rgb[..., ::-1], alpha]), "mono8": rgb[..., 0],
    }[encoding]  # fmt: skip
    with ros.BagWriter(tmp_path / "a.bag", "ros1", chunks=False) as bag:
        bag.camera_info("/rgb/camera_info", START, "c", CAMERA)
        bag.image("/rgb/image", START, "c", stored, encoding, pad=3)
        bag.image("/depth_registered/image", START, "c", SHOTS[0].millimetres, "16UC1")
    expected = np.repeat(rgb[..., :1], 3, axis=2) if encoding == "mono8" else rgb
    assert np.array_equal(open_sequence(tmp_path / "a.bag").frame(0).rgb, expected)


def test_depth_in_rvl(tmp_path: Path):
    holes = SHOTS[0].millimetres.copy()
    holes[10:20, 5:50], holes[-1], holes[40, 40] = 0, 0, 65000
    data = ros.rvl_encoded(holes)
    with ros.BagWriter(tmp_path / "bag", "mcap") as bag:
        for k in range(2):
            bag.camera_info("/rgb/camera_info", START + k, "c", CAMERA)
            bag.image("/rgb/image", START + k, "c", SHOTS[0].rgb, "rgb8")
            cut = data if k == 0 else data[:400]
            bag.compressed(
                "/depth/image/compressedDepth", START + k, "c", bytes(12) + cut, "16UC1; compressedDepth rvl"
            )
    sequence = open_sequence(tmp_path / "bag")
    assert np.array_equal(sequence.frame(0).depth, holes * np.float32(0.001))
    with pytest.raises(InputError, match="RVL"):
        sequence.frame(1)


def test_two_clocks_are_paired_by_when_images_were_recorded(tmp_path: Path):
    with ros.BagWriter(tmp_path / "a.bag", "ros1") as bag:
        for s in SHOTS:
            bag.camera_info("/rgb/camera_info", s.time, "c", CAMERA)
            bag.image("/rgb/image", s.time, "c", s.rgb, "rgb8")
            depth = bag.make(
                "sensor_msgs/msg/Image", header=bag.header(s.time - START + 5, "c"), height=72, width=96,
                encoding="16UC1", is_bigendian=0, step=192, data=s.millimetres.ravel().view(np.uint8),
            )  # fmt: skip
            bag.write("/depth/image", depth, s.time + 0.006)
    sequence = open_sequence(tmp_path / "a.bag")
    assert len(sequence) == COUNT
    assert any("different clocks" in note for note in sequence.notes)
    assert np.array_equal(sequence.frame(5).depth, SHOTS[5].millimetres * np.float32(0.001))


OPTICAL = np.array([[0, 0, 1, 0.1], [-1, 0, 0, 0], [0, -1, 0, 0.2], [0, 0, 0, 1.0]])
"""T_base_camera."""


def pose_message(bag: ros.BagWriter, T: np.ndarray):
    t = bag.transform(T)
    place = bag.make("geometry_msgs/msg/Point", x=t.translation.x, y=t.translation.y, z=t.translation.z)
    return bag.make("geometry_msgs/msg/Pose", position=place, orientation=t.rotation)


def write_poses(bag: ros.BagWriter, kind: str, every: list) -> None:
    """Poses of frame base where they are odometry, else of the camera."""
    stamped = []
    for s in every:
        T = s.T_world_camera
        pose = pose_message(bag, T @ np.linalg.inv(OPTICAL) if kind == "Odometry" else T)
        header = bag.header(s.time, "odom")
        if kind == "Odometry":
            zero = bag.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
            twist = bag.make(
                "geometry_msgs/msg/TwistWithCovariance",
                twist=bag.make("geometry_msgs/msg/Twist", linear=zero, angular=zero), covariance=np.zeros(36),
            )  # fmt: skip
            with_covariance = bag.make(
                "geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)
            )
            message = bag.make(
                "nav_msgs/msg/Odometry",
                header=header,
                child_frame_id="base",
                pose=with_covariance,
                twist=twist,
            )
            bag.write("/odom", message, s.time)
            continue
        stamped.append(bag.make("geometry_msgs/msg/PoseStamped", header=header, pose=pose))
        if kind == "PoseStamped":
            bag.write("/vio/pose", stamped[-1], s.time)
        else:
            path = bag.make("nav_msgs/msg/Path", header=header, poses=list(stamped))
            bag.write("/slam/path", path, s.time)


@pytest.mark.parametrize("store", ["ros1", "mcap"])
@pytest.mark.parametrize("kind", ["Odometry", "PoseStamped", "Path"])
def test_poses_of_messages_of_their_own(kind: str, store: str, tmp_path: Path):
    path = tmp_path / ("a.bag" if store == "ros1" else "a")
    with ros.BagWriter(path, store) as bag:
        bag.tf("/tf_static", START - 0.1, [("base", "camera", OPTICAL)])
        for s in SHOTS:
            bag.camera_info("/camera/camera_info", s.time, "camera", CAMERA)
            bag.image("/camera/rgb/image", s.time, "camera", s.rgb, "rgb8")
            bag.image("/camera/depth/image", s.time, "camera", s.millimetres, "16UC1")
        write_poses(bag, kind, SHOTS)
    sequence = open_sequence(path)
    for frame, s in zip(sequence, SHOTS, strict=True):
        assert frame.T_world_camera == pytest.approx(s.T_world_camera, abs=2e-6)
    assert any(note.startswith("assumed: poses of") for note in sequence.notes) == (kind != "Odometry")


def test_a_bag_without_depth_says_what_there_is(tmp_path: Path):
    with ros.BagWriter(tmp_path / "a.bag", "ros1") as bag:
        bag.image("/rgb/image", START, "c", SHOTS[0].rgb, "rgb8")
    with pytest.raises(InputError, match=r"no topic of depth images, .*/rgb/image \(colour\)"):
        open_sequence(tmp_path / "a.bag")


def test_a_bag_without_camera_info_asks_for_the_camera(tmp_path: Path):
    with ros.BagWriter(tmp_path / "a.bag", "ros1") as bag:
        for s in SHOTS:
            bag.image("/rgb/image", s.time, "c", s.rgb, "rgb8")
            bag.image("/depth/image", s.time, "c", s.millimetres, "16UC1")
    with pytest.raises(InputError, match="no camera calibration"):
        open_sequence(tmp_path / "a.bag")
    values = (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
    assert open_sequence(tmp_path / "a.bag", intrinsics=values, depth_scale=1000).intrinsics == CAMERA


def test_a_part_of_a_bag_is_cut_into_the_tum_layout(tmp_path: Path):
    sequence = open_sequence(written(CASES["ros1"], tmp_path / "recording"))
    cut_sequence(sequence, tmp_path / "out", start_s=0.1, seconds=0.2)
    part = open_sequence(tmp_path / "out")
    assert len(part) == 6
    assert np.array_equal(part.frame(0).rgb, SHOTS[3].rgb)
    assert np.array_equal(part.frame(0).depth, SHOTS[3].millimetres * np.float32(0.001))
