"""`dsmap map` warns before it maps, and says what to try where nothing came of it."""

import warnings

import numpy as np
import pytest
from sequence_files import CAMERA, colour

from dsmap.errors import InputWarning
from dsmap.sequences import SequenceWriter
from dsmap.tools.cli import run
from dsmap.tools.support.depth_check import depth_warnings

FLAGS = ["--segmenter", "none", "--no-pictures"]


def write(folder, depths, scale=1000.0):
    with SequenceWriter(folder, CAMERA, scale) as writer:
        for i, values in enumerate(depths):
            writer.write(i / 30, colour(i), values)
    return folder


def test_a_run_without_a_map_exits_with_1_and_says_what_to_try(tmp_path, capsys):
    far = np.full((48, 64), 20.0, np.float32)
    folder = write(tmp_path / "s", [far] * 4)
    with pytest.warns(InputWarning, match="depth scale is probably wrong"):
        assert run("map", [str(folder), "--out", str(tmp_path / "r"), *FLAGS]) == 1
    said = capsys.readouterr().err
    assert (
        "nothing was mapped: the first lost frame is 0 (too little depth); try a larger --depth-max" in said
    )


def test_frames_that_cannot_be_read_are_the_reason(tmp_path, capsys):
    folder = write(tmp_path / "s", [np.zeros((48, 64), np.float32)] * 3)
    with pytest.warns(InputWarning, match="none of the sampled frames"):
        assert run("map", [str(folder), "--out", str(tmp_path / "r"), *FLAGS]) == 1
    assert "nothing was mapped: the first lost frame is 0 (" in capsys.readouterr().err


def test_nearly_all_lost_is_said(tmp_path, capsys):
    folder = write(
        tmp_path / "s", [np.full((48, 64), 1.5, np.float32)] + [np.full((48, 64), 9.0, np.float32)] * 9
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        assert run("map", [str(folder), "--out", str(tmp_path / "r"), *FLAGS]) == 1
    assert (
        "only 1 of 10 frames were mapped: the first lost frame is 1 (too little depth)"
        in capsys.readouterr().err
    )


def test_images_without_a_partner_are_counted(tmp_path, capsys):
    folder = write(tmp_path / "s", [np.full((48, 64), 1.5, np.float32)] * 6)
    lines = (folder / "depth.txt").read_text().splitlines()
    (folder / "depth.txt").write_text("\n".join(lines[:-2]) + "\n")
    run("map", [str(folder), "--out", str(tmp_path / "r"), *FLAGS])
    assert "2 of 6 colour and 0 of 4 depth images have no partner" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (0.01, "--depth-scale"),
        (50.0, "--depth-scale"),
        (6.0, "--depth-max"),
        (0.25, "--depth-min"),
        (1.5, ""),
    ],
)
def test_depth_that_will_not_be_mapped_is_warned_of(value, words):
    found = depth_warnings(np.full(100, value), (0.3, 4.0))
    assert (words in found[0]) if words else not found
