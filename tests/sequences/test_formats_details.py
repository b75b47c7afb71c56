"""What single formats have of their own: two cameras, lenses, units, damage, archives, missing libraries."""

import builtins
import io
import shutil
import sys
import tarfile
import zipfile
from pathlib import Path

import cv2
import format_exporters as formats
import numpy as np
import pytest
import ros_exporters as ros
import sequence_files
from format_cases import CASES, written
from recording_shots import CAMERA, COUNT, START, shots

from dsmap.classes import CLASS_TO_NYU40
from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sequences import open_sequence
from dsmap.sequences.cut import cut_sequence
from dsmap.sequences.formats.nyu_raw import depth_of_disparity
from dsmap.sequences.formats.protocol import Options

SHOTS = shots()
OTHER = Intrinsics(96, 72, 80.0, 81.0, 46.0, 34.0)
T_COLOR_DEPTH = np.array([[1, 0, 0, 0.015], [0, 1, 0, 0.001], [0, 0, 1, 0], [0, 0, 0, 1.0]])


@pytest.mark.parametrize(
    "name",
    [
        "ros1",
        "ros2-db3-file",
        "ros2-mcap-file",
        "realsense",
        "scannet-sens",
        "klg",
        "record3d",
        "azure-kinect",
    ],
)
@pytest.mark.parametrize("share", [0.0, 0.02, 0.6])
def test_a_file_that_was_cut_off_is_one_sentence(name: str, share: float, tmp_path: Path):
    path = written(CASES[name], tmp_path / "recording")
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    try:
        sequence = open_sequence(path)
    except InputError as error:
        assert str(path) in str(error) and len(str(error).splitlines()) == 1
    else:  # what is whole can be read: those frames, and a count of the rest
        assert share == 0.6
        frames = list(sequence)
        assert 0 < len(frames) < COUNT and len(frames) + len(sequence.skipped) == len(sequence)


@pytest.mark.parametrize("name", ["stray-scanner", "scannet", "replica", "transforms.json", "rtabmap"])
def test_a_damaged_depth_image_is_left_out(name: str, tmp_path: Path):
    path = written(CASES[name], tmp_path / "recording")
    depth = (p for p in path.rglob("*.png") if "depth" in str(p.relative_to(path)))
    image = sorted(depth, key=lambda p: (len(p.name), p.name))[3]
    image.write_bytes(image.read_bytes()[:60])
    sequence = open_sequence(path)
    assert len(list(sequence)) == COUNT - 1
    assert [index for index, _ in sequence.skipped] == [3]


def test_realsense_depth_of_another_place_brings_colour_to_it(tmp_path: Path):
    path = ros.write_realsense(tmp_path, SHOTS, OTHER, T_COLOR_DEPTH, units_m=0.00025)
    calibration = open_sequence(path).calibration
    assert calibration.depth_scale == 4000.0
    assert calibration.intrinsics == OTHER
    assert calibration.color_camera == CAMERA
    assert calibration.T_color_depth == pytest.approx(T_COLOR_DEPTH)
    frame = open_sequence(path).frame(2)
    assert np.array_equal(frame.depth, SHOTS[2].stored(4000) * np.float32(1 / 4000))


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


def test_rtabmap_cameras_in_plain_yaml(tmp_path: Path):
    path = formats.write_rtabmap(tmp_path, SHOTS)
    K = ", ".join(f"{v:.9g}" for v in CAMERA.K.ravel())
    for file in (path / "rtabmap_calib").iterdir():
        file.write_text(
            "%YAML:1.0\n---\ncamera_name: c\nimage_width: 96\nimage_height: 72\ncamera_matrix:\n"
            f"   rows: 3\n   cols: 3\n   data: [ {K} ]\n"
        )
    assert open_sequence(path).intrinsics == CAMERA


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


def test_scannet_labels_of_a_larger_colour_image_are_seen_from_the_depth_camera(tmp_path: Path):
    path = formats.write_scannet(tmp_path, SHOTS)
    large = CAMERA.scaled(192, 144)
    for k, s in enumerate(SHOTS):
        for name, image in (("color", s.rgb[..., ::-1]), ("label", CLASS_TO_NYU40[s.label])):
            file = next((path / name).glob(f"{k}.*"))
            cv2.imwrite(str(file), cv2.resize(image, (192, 144), interpolation=cv2.INTER_NEAREST))
    (path / "intrinsic/intrinsic_color.txt").write_text(formats.matrix(formats.k4(large)))
    frame = open_sequence(path).frame(1)
    assert frame.label is not None and np.array_equal(frame.label, SHOTS[1].label)
    assert frame.rgb.shape == (72, 96, 3)


def test_scannet_raw_labels_need_the_label_map(tmp_path: Path):
    path = formats.write_scannet(tmp_path / "scene0000_00", SHOTS)
    (path / "label").rename(path / "label-filt")
    for k, s in enumerate(SHOTS):
        cv2.imwrite(str(path / f"label-filt/{k}.png"), (s.label.astype(np.uint16) + 1000))
    sequence = open_sequence(path)
    assert not sequence.has_labels and any("scannetv2-labels" in note for note in sequence.notes)
    rows = "".join(f"{i + 1000}\tx\t{CLASS_TO_NYU40[i]}\n" for i in range(1, 14))
    (tmp_path / "scannetv2-labels.combined.tsv").write_text("id\traw_category\tnyu40id\n" + rows)
    label = open_sequence(path).frame(0).label
    assert label is not None and np.array_equal(label, SHOTS[0].label)


def test_record3d_depth_of_a_smaller_size_is_the_frame(tmp_path: Path):
    sequence = open_sequence(formats.write_record3d(tmp_path, SHOTS, (48, 36)))
    assert sequence.intrinsics == CAMERA.scaled(48, 36)
    assert sequence.frame(0).rgb.shape == (36, 48, 3)


def test_icl_original_files_hold_distances_from_the_centre(tmp_path: Path):
    camera = Intrinsics(640, 480, 481.2, 480.0, 319.5, 239.5).scaled(96, 72)
    sequence = open_sequence(formats.write_icl_original(tmp_path, SHOTS[:3], camera))
    frame = sequence.frame(2)
    assert frame.depth == pytest.approx(SHOTS[2].metres, abs=1e-5)
    assert frame.T_world_camera == pytest.approx(SHOTS[2].T_world_camera, abs=1e-6)


def test_azure_kinect_lenses_are_straightened(tmp_path: Path):
    distortion = (0.05, -0.02, 0.0, 0.0, 0.0, 0.0, 0.001, 0.0)
    attached = formats.azure_calibration(CAMERA, OTHER, distortion, T_COLOR_DEPTH)
    sequence = open_sequence(formats.write_azure(tmp_path, SHOTS, attached))
    assert sequence.intrinsics.fx == pytest.approx(OTHER.fx) and sequence.intrinsics.cx == pytest.approx(
        OTHER.cx
    )
    assert sequence.calibration.T_color_depth == pytest.approx(T_COLOR_DEPTH)
    coefficients = np.array([0.05, -0.02, 0.001, 0, 0, 0, 0, 0])
    maps = cv2.initUndistortRectifyMap(OTHER.K, coefficients, np.eye(3), OTHER.K, (96, 72), cv2.CV_32FC1)
    expected = cv2.remap(SHOTS[1].millimetres, *maps, interpolation=cv2.INTER_NEAREST)
    assert np.array_equal(sequence.frame(1).depth, expected * np.float32(0.001))


def test_a_film_is_the_same_in_order_and_at_random(tmp_path: Path):
    sequence = open_sequence(formats.write_stray(tmp_path, SHOTS))
    for i in (7, 2, 3, 11, 0):
        assert np.array_equal(sequence.frame(i).rgb, SHOTS[i].rgb)


def test_nyu_raw_disparities(tmp_path: Path):
    disparity = np.full((480, 640), 600, np.uint16)
    disparity[:5] = 2047  # no measurement
    for k in range(3):
        (tmp_path / f"r-{START + k / 30:.6f}-{k}.ppm").write_bytes(
            cv2.imencode(".ppm", np.full((480, 640, 3), 90, np.uint8))[1].tobytes()
        )
        header = b"P5 640 480 65535\n"  # the toolbox swaps the bytes
        (tmp_path / f"d-{START + 0.01 + k / 30:.6f}-{k}.pgm").write_bytes(
            header + disparity.astype("<u2").tobytes()
        )
    assert depth_of_disparity(disparity.byteswap())[100, 100] == pytest.approx(351.3 / 492.5)
    assert not depth_of_disparity(disparity)[:5].any()
    sequence = open_sequence(tmp_path)
    assert len(sequence) == 3 and sequence.frame(0).depth[240, 320] == pytest.approx(351.3 / 492.5)
    assert sequence.calibration.color_camera is not None


@pytest.mark.parametrize("kind", ["zip", "gztar"])
@pytest.mark.parametrize("name", ["realsense", "record3d", "scannet", "tum"])
def test_archives_of_a_recording(kind: str, name: str, tmp_path: Path):
    folder = tmp_path / "room"
    if name == "tum":
        sequence_files.write_tum(folder)
    else:
        written(CASES[name], folder)
    archive = formats.zipped(folder, kind)
    shutil.rmtree(folder)
    sequence = open_sequence(archive)
    assert sequence.layout == ("tum" if name == "tum" else CASES[name].reader)
    assert len(list(sequence)) == len(sequence) > 0


@pytest.mark.parametrize(
    "name", ["../out.txt", "/tmp/out.txt", "a/../../out.txt", "..\\out.txt", "C:/out.txt"]
)
def test_no_file_of_an_archive_leaves_its_folder(name: str, tmp_path: Path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr(name, "x")
    with tarfile.open(tmp_path / "a.tgz", "w:gz") as archive:
        member = tarfile.TarInfo(name)
        archive.addfile(member, io.BytesIO(b""))
    for file in ("a.zip", "a.tgz"):
        with pytest.raises(InputError, match="expected names inside one folder"):
            open_sequence(tmp_path / file)


def test_links_and_bombs_in_archives_are_refused(tmp_path: Path):
    with tarfile.open(tmp_path / "link.tar", "w") as archive:
        link = tarfile.TarInfo("room/rgb.txt")
        link.type, link.linkname = tarfile.SYMTYPE, "/etc/passwd"
        archive.addfile(link)
    with pytest.raises(InputError, match="a link or a device"):
        open_sequence(tmp_path / "link.tar")
    huge = tarfile.TarInfo("room/huge.bin")
    huge.size = 1 << 60
    (tmp_path / "huge.tar").write_bytes(huge.tobuf(tarfile.GNU_FORMAT) + b"\0" * 1024)
    with pytest.raises(InputError, match="has room for|cannot be unpacked"):
        open_sequence(tmp_path / "huge.tar")
    (tmp_path / "cut.zip").write_bytes(b"PK\x03\x04 and no more")
    with pytest.raises(InputError, match="cannot be unpacked"):
        open_sequence(tmp_path / "cut.zip")


def test_a_part_of_a_bag_is_cut_into_the_tum_layout(tmp_path: Path):
    sequence = open_sequence(written(CASES["ros1"], tmp_path / "recording"))
    cut_sequence(sequence, tmp_path / "out", start_s=0.1, seconds=0.2)
    part = open_sequence(tmp_path / "out")
    assert len(part) == 6
    assert np.array_equal(part.frame(0).rgb, SHOTS[3].rgb)
    assert np.array_equal(part.frame(0).depth, SHOTS[3].millimetres * np.float32(0.001))


@pytest.mark.parametrize(
    ("name", "package"), [("ros1", "rosbags"), ("record3d", "liblzfse"), ("stray-scanner", "av")]
)
def test_a_missing_library_names_the_extra(name: str, package: str, tmp_path: Path, monkeypatch):
    path = written(CASES[name], tmp_path / "recording")
    real = builtins.__import__

    def without(module: str, *args, **kwargs):
        if module.split(".")[0] == package:
            raise ImportError(module)
        return real(module, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    for module in [m for m in sys.modules if m.split(".")[0] == package]:
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=r"dsmap\[recordings\]"):
        open_sequence(path)


def test_a_calibration_beside_a_log_goes_before_what_is_assumed(tmp_path: Path):
    path = formats.write_klg(tmp_path, SHOTS)
    assert any("assumed" in note for note in open_sequence(path).notes)
    c = CAMERA
    (tmp_path / "calibration.yaml").write_text(
        f"width: 96\nheight: 72\nfx: {c.fx}\nfy: {c.fy}\ncx: {c.cx}\ncy: {c.cy}\ndepth_scale: 1000\n"
    )
    assert open_sequence(path).intrinsics == CAMERA


@pytest.mark.parametrize(
    "name", ["realsense", "ros2-mcap-file", "scannet-sens", "klg", "record3d", "azure-kinect"]
)
def test_a_folder_that_holds_one_file_of_a_recording_is_that_recording(name: str, tmp_path: Path):
    path = written(CASES[name], tmp_path / "recording")
    (path.parent / "metadata.yaml").unlink(missing_ok=True)  # a ROS 2 bag of several parts has one
    (path.parent / "readme.txt").write_text("scanned by hand\n")
    (path.parent / "._room.bag").write_bytes(b"of a Mac")
    (path.parent / "notes").mkdir()
    alone, within = open_sequence(path), open_sequence(path.parent)
    assert len(within) == len(alone) and within.intrinsics == alone.intrinsics
    said = any(path.name in note and "only recording" in note for note in within.notes)
    assert said or within.layout in ("ros", "realsense"), "a folder of parts of a bag is a bag"
    shutil.copy(path, path.with_name("second" + path.suffix))
    with pytest.raises(InputError, match=r"is a recording"):
        open_sequence(path.parent)


def test_a_folder_that_holds_an_archive_is_that_archive(tmp_path: Path):
    sequence_files.write_tum(tmp_path / "in" / "room")
    (tmp_path / "out").mkdir()
    shutil.make_archive(str(tmp_path / "out" / "room"), "zip", tmp_path / "in")
    assert len(open_sequence(tmp_path / "out")) == len(open_sequence(tmp_path / "in" / "room"))


def test_names_of_a_format_in_capital_letters(tmp_path: Path):
    path = written(CASES["stray-scanner"], tmp_path / "recording")
    expected = open_sequence(path)
    frame = expected.frame(3)
    for child in list(path.iterdir()):
        child.rename(child.with_name(child.name.upper()))
    found = open_sequence(path)
    assert found.layout == "stray-scanner" and len(found) == len(expected)
    assert found.intrinsics == expected.intrinsics and found.has_poses
    np.testing.assert_array_equal(found.frame(3).rgb, frame.rgb)
    np.testing.assert_array_equal(found.frame(3).depth, frame.depth)


@pytest.mark.parametrize(
    "name", ["realsense", "ros2-mcap-file", "scannet-sens", "klg", "record3d", "azure-kinect"]
)
def test_suffixes_in_capital_letters(name: str, tmp_path: Path):
    path = written(CASES[name], tmp_path / "recording")
    loud = path.rename(path.with_suffix(path.suffix.upper()))
    assert len(list(open_sequence(loud))) == COUNT
