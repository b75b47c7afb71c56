"""The contact sheet: as many scenes as asked for, colour beside classes."""

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from dsmap.classes import PALETTE
from dsmap.errors import InputError
from dsmap.sim_scenes.recording.contact_sheet import contact_sheet
from dsmap.sim_scenes.recording.record import RenderOptions
from dsmap.tools import cli


@pytest.mark.slow
def test_a_sheet_shows_colour_beside_classes(tmp_path: Path) -> None:
    arguments = ["--scene", "bathroom", "--seed", "3", "--size", "64x48", "--columns", "2", "--rows", "1"]
    command = [
        sys.executable,
        "-m",
        "dsmap.tools.cli",
        "contact-sheet",
        str(tmp_path / "sheet.png"),
        *arguments,
    ]
    subprocess.run(command, check=True)
    sheet = cv2.imread(str(tmp_path / "sheet.png"))[..., ::-1]
    assert sheet.shape[0] > 48 and sheet.shape[1] == 2 * (2 * 64 + 4) - 4
    for left in (64, 64 + 132):
        classes = sheet[:48, left : left + 64].reshape(-1, 3)
        known = (classes[:, None] == PALETTE[None]).all(-1)
        assert known.any(1).all(), "the right half of a cell holds colours of classes only"
        assert known.any(0).sum() >= 3, "a view of a bathroom shows at least three classes"
    first, second = sheet[:48, :64], sheet[:48, 132 : 132 + 64]
    assert np.abs(first.astype(int) - second).mean() > 5, "two seeds, two scenes"


def test_wrong_sheets_are_said_to_be_wrong(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected .png or .jpg"):
        contact_sheet(tmp_path / "sheet.gif", RenderOptions(scene="bathroom"))
    assert cli.run("contact-sheet", [str(tmp_path / "x.png"), "--columns", "0"]) == 2


@pytest.mark.slow
def test_an_unknown_scene_is_said_to_be_one(tmp_path: Path) -> None:
    garage = [str(tmp_path / "x.png"), "--scene", "garage", "--rows", "1"]
    command = [sys.executable, "-m", "dsmap.tools.cli", "contact-sheet", *garage]
    assert subprocess.run(command).returncode == 2
