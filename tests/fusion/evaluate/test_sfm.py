"""Poses judged by structure from motion; what COLMAP itself finds is tested where it is installed."""

import sys

import numpy as np
import pytest
from two_walls import CAMERA, look

from dsmap.fusion.evaluate import sfm as evaluate_sfm
from dsmap.fusion.evaluate.sfm import Structure, sfm_table, structure_from_motion
from dsmap.fusion.lie import exp_se3
from dsmap.sequences import SequenceWriter, open_sequence
from dsmap.tools.cli import run as command

FRAMES = 12
TRUE = {
    i: exp_se3(np.array([0.1 * (i - 6), 0.04 * np.sin(i), 0.02 * i, 0.01 * np.sin(i), -0.03 * (i - 6), 0.0]))
    for i in range(FRAMES)
}
SHAKEN = {i: T @ exp_se3(np.array([0.02 * (-1) ** i, 0, 0, 0, 0, 0])) for i, T in TRUE.items()}
MODEL = exp_se3(np.array([1.0, -2.0, 3.0, 0.4, -0.5, 0.6]))
"""Where COLMAP's frame lies; its unit of length is 5 m."""


def write(folder, views) -> None:
    with SequenceWriter(folder, CAMERA, 1000.0) as writer:
        for i, (rgb, depth) in enumerate(views):
            writer.write(i / 30, rgb, depth, T_world_camera=TRUE[i])


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sfm") / "s"
    write(folder, [look(T) for T in TRUE.values()])
    return open_sequence(folder)


WHOLE = {(i, i + 1): 0.6 for i in range(FRAMES - 1)}


def model_of(poses: dict[int, np.ndarray], T_color_frame: np.ndarray) -> dict[int, np.ndarray]:
    """The same motion as COLMAP would give it: poses of the colour camera in another frame and unit."""
    found = {}
    for i, T in poses.items():
        found[i] = MODEL @ T @ np.linalg.inv(T_color_frame)
        found[i][:3, 3] /= 5.0
    return found


def test_the_distance_is_that_of_the_colour_camera_after_the_best_similarity(recording, monkeypatch):
    lever = exp_se3(np.array([-0.3, 0.1, 0, 0, 0, 0.2]))
    monkeypatch.setattr(type(recording.calibration), "T_color_frame", lever)
    monkeypatch.setattr(
        evaluate_sfm, "structure_from_motion", lambda *_: Structure(model_of(TRUE, lever), 0.25, WHOLE)
    )
    table = sfm_table(recording, SHAKEN, TRUE)
    assert table["given_rmse_m"] < 1e-9
    assert table["estimated_rmse_m"] == pytest.approx(0.02, rel=0.05)
    assert (table["frames"], table["registered"], table["reprojection_px"]) == (FRAMES, FRAMES, 0.25)
    assert sfm_table(recording, SHAKEN, {})["given_rmse_m"] is None


def test_a_model_of_few_images_or_of_two_parts_says_nothing(recording, monkeypatch):
    whole = model_of(TRUE, np.eye(4))
    few = {i: T for i, T in whole.items() if i < 5}
    torn = WHOLE | {(6, 7): 0.0}
    cases = (
        (Structure(few, 0.3, WHOLE), f"5 of {FRAMES} images"),
        (Structure(whole, 0.3, torn), "torn between frames 6 and 7"),
        (None, "no model"),
    )
    for found, reason in cases:
        monkeypatch.setattr(evaluate_sfm, "structure_from_motion", lambda *_, found=found: found)
        table = sfm_table(recording, TRUE, TRUE)
        assert (
            table["estimated_rmse_m"] is None and table["given_rmse_m"] is None and reason in table["reason"]
        )


def test_without_colmap_the_command_says_what_to_install(recording, tmp_path, monkeypatch, capsys):
    options = ["--out", str(tmp_path / "run"), "--poses", "given", "--segmenter", "none", "--no-pictures"]
    assert command("map", [str(recording.path), *options]) == 0
    monkeypatch.setitem(sys.modules, "pycolmap", None)
    capsys.readouterr()
    assert command("evaluate", [str(tmp_path / "run"), "--sfm"]) == 2
    assert "pip install 'dsmap[sfm]'" in capsys.readouterr().err


def test_colmap_finds_the_true_motion(recording):
    pytest.importorskip("pycolmap", reason="pycolmap is not installed (pip install 'dsmap[sfm]')")
    table = sfm_table(recording, SHAKEN, TRUE)
    assert table["registered"] == FRAMES and table["reprojection_px"] < 0.5
    assert table["given_rmse_m"] < 0.004, "of a way of 1.1 m"
    assert 0.01 < table["estimated_rmse_m"] < 0.025


def test_colmap_finds_nothing_in_blank_or_damaged_images(tmp_path):
    pytest.importorskip("pycolmap", reason="pycolmap is not installed (pip install 'dsmap[sfm]')")
    blank = (np.full((240, 320, 3), 128, np.uint8), np.full((240, 320), 2.0, np.float32))
    write(tmp_path / "s", [blank] * FRAMES)
    sequence = open_sequence(tmp_path / "s")
    sequence.entries[3].rgb.write_bytes(b"\xff\xd8 not an image \xff\xd9")
    assert structure_from_motion(sequence, list(range(FRAMES))) is None
