"""What calibration.yaml keeps, and what is known of public data sets."""

import cv2
import numpy as np
import pytest
import yaml
from sequence_files import CAMERA, write_tum

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sequences import open_sequence
from dsmap.sequences.calibration import (
    Calibration,
    known_default,
    read_calibration,
    resolve,
    write_calibration,
)
from dsmap.sequences.open import read_recording


def test_a_color_camera_is_written_and_read_back(tmp_path):
    T = np.eye(4)
    T[0, 3] = -0.025
    color = Intrinsics(96, 80, 70.0, 72.0, 47.0, 40.0)
    write_calibration(tmp_path, Calibration(CAMERA, 1000.0, "", T_color_depth=T, color_camera=color))
    found = read_calibration(tmp_path)
    assert found is not None and found.color_camera == color
    np.testing.assert_array_equal(found.T_color_depth, T)


def test_readout_of_a_rolling_shutter_is_kept_and_checked(tmp_path):
    write_calibration(tmp_path, Calibration(CAMERA, 1000.0, "", readout_s=-0.01))
    found = read_calibration(tmp_path)
    assert found is not None and found.readout_s == -0.01
    text = (tmp_path / "calibration.yaml").read_text()
    (tmp_path / "calibration.yaml").write_text(text.replace("-0.01", "fast"))
    with pytest.raises(InputError, match="found 'fast' for readout_s"):
        read_calibration(tmp_path)
    for layout, name, expected in (
        ("tum", "fr1_desk", 0.026),
        ("tum", "fr3_office", 0.0),
        ("7-scenes", "x", 0.026),
    ):
        known = known_default(layout, tmp_path / name, 640, 480)
        assert known is not None and known.readout_s == expected


_GOOD = {
    "width": 640, "height": 480, "fx": 525.0, "fy": 525.0, "cx": 319.5, "cy": 239.5, "depth_scale": 1000.0
}  # fmt: skip
_TURNED = [[1.0, 0.0, 0.0, 25.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"depth_Max": 4.0}, "unknown key 'depth_Max', expected depth_max"),
        ({"deph_scale": 5000}, "unknown key 'deph_scale', expected depth_scale"),
        ({"baseline": 0.1}, "unknown key 'baseline'"),
        ({"distortion": {"k1": 0.1, "k4": 0.2}}, "distortion: found the unknown key 'k4', expected k"),
        ({"color_camera": {**_GOOD}}, "color_camera: found the unknown key 'depth_scale'"),
        ({"distortion": {"k1": 160.0}}, "160 for distortion k1"),
        ({"T_color_depth": _TURNED}, "25 m apart, expected a translation in metres"),
        ({"T_color_depth": np.diag([1.0, 1.0, -1.0, 1.0]).tolist()}, "expected a rigid 4x4 transform"),
        ({"cx": 700.0}, "cx 700, cy 239.5, expected"),
        ({"cx": 0.4992, "cy": 0.499, "fx": 0.82, "fy": 1.09}, "expected a focal length in pixels"),
        ({"fy": 319.5, "cx": 525.0}, "the order is fx, fy, cx, cy"),
        ({"cx": 239.5, "cy": 319.5}, "cx 239.5, cy 319.5, .* probably exchanged"),
        ({"fx": 3.6, "fy": 3.6}, "expected a focal length in pixels"),
        ({"width": 640.5}, "expected a whole number of pixels"),
        ({"depth_scale": 0.001}, "metres per unit. then write 1000"),
        ({"depth_max": 4000}, "4000 for depth_max, expected metres"),
        ({"depth_max": 0.01}, "0.01 for depth_max, expected metres"),
        ({"depth_time_offset_s": -20}, "-20 for depth_time_offset_s, expected seconds"),
        ({"readout_s": 26}, "26 for readout_s, expected seconds"),
    ],
)
def test_misspelled_keys_and_values_of_another_unit_are_refused(tmp_path, changes, message):
    (tmp_path / "calibration.yaml").write_text(yaml.safe_dump({**_GOOD, **changes}))
    with pytest.raises(InputError, match=message):
        read_calibration(tmp_path)


@pytest.mark.parametrize(
    "camera",
    [
        {"width": 848, "height": 480, "fx": 610.0, "fy": 609.2, "cx": 424.1, "cy": 241.3},
        {"width": 192, "height": 256, "fx": 212.0, "fy": 212.0, "cx": 95.2, "cy": 127.8},
        {"width": 640, "height": 576, "fx": 504.0, "fy": 504.0, "cx": 320.0, "cy": 288.0},
        {"width": 1024, "height": 1024, "fx": 252.0, "fy": 252.0, "cx": 511.5, "cy": 511.5},
        {"width": 640, "height": 480, "fx": 472.5, "fy": 630.0, "cx": 320.0, "cy": 240.0},
    ],
)
def test_cameras_that_are_sold_are_accepted(tmp_path, camera):
    (tmp_path / "calibration.yaml").write_text(yaml.safe_dump({**_GOOD, **camera}))
    found = read_calibration(tmp_path)
    assert found is not None and found.intrinsics.fx == camera["fx"]


def test_flags_are_checked_like_the_file(tmp_path):
    args = ("tum", tmp_path, (640, 480), None)
    with pytest.raises(InputError, match="--intrinsics: found .*the order is fx, fy, cx, cy"):
        resolve(*args, (525.0, 319.5, 525.0, 239.5), 1000.0)
    with pytest.raises(InputError, match="--depth-scale: found depth scale 0.001"):
        resolve(*args, (525.0, 525.0, 319.5, 239.5), 0.001)


def test_colour_that_asks_to_be_turned_stays_over_its_depth(tmp_path):
    folder = write_tum(tmp_path / "r")
    rgb = np.full((48, 64, 3), 40, np.uint8)
    rgb[:8, :8] = 255
    whole = cv2.imencode(".jpg", rgb)[1].tobytes()
    exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x03\0\0\0\0\0\0\0"
    turned = whole[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + whole[2:]
    for entry in read_recording(folder).entries:
        entry.rgb.write_bytes(turned)
    sequence = open_sequence(folder)
    assert any("EXIF" in note for note in sequence.notes)
    assert sequence.frame(0).rgb[2, 2, 0] > 200
