"""What single formats have of their own: lenses, units, labels, damage."""

from pathlib import Path

import cv2
import format_exporters as formats
import numpy as np
import pytest
import ros_exporters as ros
from format_cases import CASES, written
from recording_shots import CAMERA, COUNT, START, shots

from dsmap.classes import CLASS_TO_NYU40
from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sequences import open_sequence
from dsmap.sequences.formats.nyu_raw import depth_of_disparity

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


def test_rtabmap_cameras_in_plain_yaml(tmp_path: Path):
    path = formats.write_rtabmap(tmp_path, SHOTS)
    K = ", ".join(f"{v:.9g}" for v in CAMERA.K.ravel())
    for file in (path / "rtabmap_calib").iterdir():
        file.write_text(
            "%YAML:1.0\n---\ncamera_name: c\nimage_width: 96\nimage_height: 72\ncamera_matrix:\n"
            f"   rows: 3\n   cols: 3\n   data: [ {K} ]\n"
        )
    assert open_sequence(path).intrinsics == CAMERA


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


def test_a_calibration_beside_a_log_goes_before_what_is_assumed(tmp_path: Path):
    path = formats.write_klg(tmp_path, SHOTS)
    assert any("assumed" in note for note in open_sequence(path).notes)
    c = CAMERA
    (tmp_path / "calibration.yaml").write_text(
        f"width: 96\nheight: 72\nfx: {c.fx}\nfy: {c.fy}\ncx: {c.cx}\ncy: {c.cy}\ndepth_scale: 1000\n"
    )
    assert open_sequence(path).intrinsics == CAMERA
