"""What calibration.yaml keeps, and what is known of public data sets."""

import numpy as np
import pytest
from sequence_files import CAMERA

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sequences.calibration import Calibration, known_default, read_calibration, write_calibration


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
