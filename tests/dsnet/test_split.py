"""Cutting a validation set where neighbouring images share no view, and the committed list of NYUv2."""

import cv2
import numpy as np
import pytest

from dsmap.dsnet.datasets.registry import open_set
from dsmap.dsnet.datasets.splits import validation_numbers
from dsmap.dsnet.datasets.view_overlap import MIN_INLIERS, choose_blocks, cuts, matches, missing_before
from dsmap.features import Features
from dsmap.tools import cli

from conftest import shared_data  # isort: skip


def wall(seed):
    """A picture full of corners, larger than a view of it."""
    rng = np.random.default_rng(seed)
    picture = np.full((300, 420), 128, np.uint8)
    for _ in range(260):
        x, y, w, h = rng.integers(0, (400, 280, 40, 40))
        cv2.rectangle(picture, (int(x), int(y)), (int(x + w), int(y + h)), int(rng.integers(0, 256)), -1)
    return cv2.GaussianBlur(picture, (0, 0), 1)


def view(picture, x, y):
    return picture[y : y + 180, x : x + 240]


def test_views_of_one_wall_match_and_others_do_not():
    one, other = wall(1), wall(2)
    a, b, c = (Features(v) for v in (view(one, 0, 0), view(one, 60, 30), view(other, 0, 0)))
    assert matches(a, b) > 5 * MIN_INLIERS and matches(a, c) < MIN_INLIERS
    blank = Features(np.full((180, 240), 90, np.uint8))
    assert matches(a, blank) == matches(blank, blank) == 0


def test_series_is_cut_between_rooms_only():
    rooms = [wall(k) for k in range(3)]
    # Images 0 and 2 are of one room, 1 of another: no cut within 0..2.
    series = [view(rooms[0], 0, 0), view(rooms[1], 0, 0), view(rooms[0], 40, 20), view(rooms[2], 9, 9)]
    assert cuts([Features(v) for v in series]).tolist() == [True, False, False, True, True]


def test_gaps_of_one_number_do_not_count():
    assert missing_before([3, 4, 6, 9, 10]).tolist() == [True, False, False, True, False, True]


def test_blocks_lie_between_cuts_and_keep_the_classes_mixed():
    rng = np.random.default_rng(0)
    free = rng.random(201) < 0.3
    free[[0, -1]] = True
    pixels = rng.random((200, 4)) + np.array([0.1, 0.5, 1, 3])
    blocks = choose_blocks(free, pixels, 24, 3, trials=3000)
    assert len(blocks) == 3 and abs(sum(end - first for first, end in blocks) - 24) <= 2
    assert all(free[first] and free[end] for first, end in blocks)
    assert all(a[1] < b[0] for a, b in zip(blocks, blocks[1:], strict=False))
    chosen = np.concatenate([pixels[first:end] for first, end in blocks]).sum(axis=0)
    ratio = chosen / chosen.sum() / (pixels.sum(axis=0) / pixels.sum())
    assert np.abs(np.log(ratio)).max() < 0.1


def test_more_blocks_than_cuts_fit_nowhere():
    assert choose_blocks(np.array([True, True, True, True]), np.ones((3, 2)), 1, 3, trials=10) == []
    assert choose_blocks(np.array([True, False, False, True]), np.ones((3, 2)), 1, 5, trials=10) == []


def test_the_command_writes_ranges(tmp_path, capsys):
    numbers = [*range(1, 5), *range(10, 14), *range(20, 24), *range(30, 34)]
    for name in ("rgb", "label"):
        (tmp_path / "set" / name).mkdir(parents=True)
    for number in numbers:
        cv2.imwrite(
            str(tmp_path / "set" / "rgb" / f"{number:04}.png"), view(wall(number // 10), number % 10 * 3, 0)
        )
        cv2.imwrite(str(tmp_path / "set" / "label" / f"{number:04}.png"), np.full((180, 240), 5, np.uint8))
    out = tmp_path / "val.txt"
    argv = [str(tmp_path / "set"), "--out", str(out), "--images", "4", "--blocks", "1"]
    assert cli.run("validation-split", argv) == 0
    assert "4 of 16 images; 4 groups" in capsys.readouterr().out
    assert validation_numbers(out) in [set(numbers[k : k + 4]) for k in (0, 4, 8, 12)]
    assert cli.run("validation-split", [*argv[:-3], "90", "--blocks", "1"]) == 2
    assert cli.run("validation-split", [str(tmp_path / "none"), *argv[1:]]) == 2


def test_committed_list_holds_back_about_92_of_the_real_images():
    folder = shared_data("nyuv2_13_train")
    parts = {split: [item.name for item in open_set(f"{folder}@{split}").items] for split in ("train", "val")}
    assert 88 <= len(parts["val"]) <= 96 and len(parts["train"]) + len(parts["val"]) == 792
    assert not set(parts["train"]) & set(parts["val"])


@pytest.mark.parametrize("split", ["train", "val"])
def test_ranges_begin_and_end_at_gaps_of_the_real_numbers(split):
    numbers = [int(item.label.stem) for item in open_set(f"{shared_data('nyuv2_13_train')}@{split}").items]
    others = validation_numbers()
    for a, b in zip(numbers, numbers[1:], strict=False):
        between = (set(range(a, b + 1)) & others) if split == "train" else set(range(a, b + 1)) - others
        assert not between or b - a > 2
