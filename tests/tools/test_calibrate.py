"""`dsmap calibrate`."""

import numpy as np
import pytest
from conftest import shared_data
from sequence_files import CAMERA

from dsmap.errors import InputError
from dsmap.fusion.calibration.report import Line, Report
from dsmap.sequences import SequenceWriter
from dsmap.sequences.calibration import CALIBRATION_FILE, Calibration, read_calibration, write_calibration
from dsmap.tools.cli import run
from dsmap.tools.commands.calibrate import describe


def plain_wall(folder):
    """A recording that shows nothing to follow."""
    with SequenceWriter(folder, CAMERA, 1000.0) as writer:
        shape = (CAMERA.height, CAMERA.width)
        for i in range(40):
            writer.write(i / 30, np.full((*shape, 3), 128, np.uint8), np.full(shape, 2.0, np.float32))
    return folder


def test_too_little_to_see_exits_with_1_and_says_what_to_film(tmp_path, capsys):
    folder = plain_wall(tmp_path / "s")
    before = (folder / CALIBRATION_FILE).read_text()
    assert run("calibrate", [str(folder), "--overwrite"]) == 1
    said = capsys.readouterr().err
    assert "0 observations of corners" in said
    assert "textured" in said
    assert (folder / CALIBRATION_FILE).read_text() == before


def test_a_calibration_that_is_there_is_not_replaced(tmp_path, capsys):
    assert run("calibrate", [str(plain_wall(tmp_path / "s"))]) == 2
    assert "--overwrite" in capsys.readouterr().err


def test_a_folder_without_a_recording_exits_with_2(tmp_path, capsys):
    assert run("calibrate", [str(tmp_path)]) == 2
    assert "looked for rgb.txt" in capsys.readouterr().err


def test_uncertainties_come_back_from_the_file(tmp_path):
    told = Calibration(
        CAMERA, 1000.0, CALIBRATION_FILE, uncertainty={"fx": 0.5, "cx": 1.0}, undetermined=("readout_s",)
    )
    write_calibration(tmp_path, told)
    found = read_calibration(tmp_path)
    assert found is not None
    assert found.uncertainty == told.uncertainty
    assert found.undetermined == told.undetermined


@pytest.mark.parametrize(
    "line", ["uncertainty: 3", "uncertainty: {fx: much}", "undetermined: fx", "undetermined: [3]"]
)
def test_damaged_uncertainties_are_refused(tmp_path, line):
    write_calibration(tmp_path, Calibration(CAMERA, 1000.0, CALIBRATION_FILE))
    with open(tmp_path / CALIBRATION_FILE, "a") as file:
        file.write(line + "\n")
    with pytest.raises(InputError, match=r"uncertainty|undetermined|fx"):
        read_calibration(tmp_path)


def test_the_report_names_what_is_open_and_what_contradicts():
    lines = [
        Line("fx", 540.0, 525.0, 0.5, "px", "contradicts"),
        Line("readout_s", 0.02, 0.05, 0.01, "s", "undetermined", "turn the camera fast"),
    ]
    text = "\n".join(
        describe(Report(Calibration(CAMERA, 1000.0, CALIBRATION_FILE), lines, ["the given fx contradicts"]))
    )
    assert "undetermined: readout_s stays as given; turn the camera fast" in text
    assert "0.05" not in text
    assert "warning: the given fx contradicts" in text


@pytest.mark.slow
def test_fr1_keeps_its_published_focal_length_and_its_times(tmp_path):
    """The published camera was found with a target; offset and readout in the docs by mapping with many."""
    out = tmp_path / "found.yaml"
    assert run("calibrate", [str(shared_data("tum_fr1_xyz_10s")), "--out", str(out), "--frames", "135"]) == 0
    out.rename(tmp_path / CALIBRATION_FILE)
    found = read_calibration(tmp_path)
    assert found is not None
    assert found.intrinsics.fx == pytest.approx(517.3, rel=0.01)
    assert found.depth_time_offset_s == pytest.approx(-0.02, abs=0.01)
    assert found.readout_s == pytest.approx(0.026, abs=0.008)
