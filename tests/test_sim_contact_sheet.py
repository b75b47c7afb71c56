"""The contact sheet: as many scenes as asked for, colour beside classes."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from dsmap.classes import PALETTE
from dsmap.errors import InputError
from dsmap.sim_scenes.contact_sheet import contact_sheet
from dsmap.sim_scenes.record import RenderOptions
from dsmap.tools import cli


def test_a_sheet_shows_colour_beside_classes(tmp_path: Path) -> None:
    base = RenderOptions(scene="bathroom", seed=3, width=64, height=48)
    contact_sheet(tmp_path / "sheet.png", base, columns=2, rows=1)
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
    assert cli.run("contact-sheet", [str(tmp_path / "x.png"), "--scene", "garage", "--rows", "1"]) == 2
