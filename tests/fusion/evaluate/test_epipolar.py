"""Poses judged by the colour images alone."""

import cv2
import numpy as np
import pytest
from two_walls import CAMERA, look

from dsmap.fusion.evaluate.epipolar import epipolar_error, epipolar_table, match_frames, sampson_distance
from dsmap.fusion.lie import exp_se3
from dsmap.sequences import SequenceWriter, open_sequence

TRUE = exp_se3(np.array([0.12, 0.03, 0.05, 0.01, -0.03, 0.02]))
"""T_world_camera of the second of two frames; the first is the world."""
WRONG = TRUE @ exp_se3(np.array([0, 0, 0, np.deg2rad(1.0), 0, 0]))


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("epipolar") / "s"
    with SequenceWriter(folder, CAMERA, 1000.0) as writer:
        for i, T in enumerate((np.eye(4), TRUE)):
            writer.write(i / 30, *look(T), T_world_camera=T)
    return open_sequence(folder)


def test_distance_of_points_from_the_lines_of_their_partners():
    points = np.random.default_rng(1).uniform((-1, -1, 1.5), (1, 1, 3), (50, 3))
    T_b_a = np.linalg.inv(TRUE)
    pixels = []
    for p in (points, points @ T_b_a[:3, :3].T + T_b_a[:3, 3]):
        pixels.append(p[:, :2] / p[:, 2:] * CAMERA.fx + (CAMERA.cx, CAMERA.cy))
    assert sampson_distance(*pixels, T_b_a, CAMERA).max() < 1e-9
    longer = T_b_a.copy()
    longer[:3, 3] *= 3
    assert sampson_distance(*pixels, longer, CAMERA).max() < 1e-9, "images alone tell no scale"
    off = sampson_distance(pixels[0], pixels[1] + (0.0, 2.0), T_b_a, CAMERA)
    assert 0.1 < np.median(off) <= 2.0 / np.sqrt(2) + 0.1


def test_true_poses_pass_and_wrong_ones_do_not(recording):
    matches = match_frames(recording, [0, 1], 1)
    assert len(matches[0, 1][0]) > 40
    right = epipolar_error(recording, matches, {0: np.eye(4), 1: TRUE})
    wrong = epipolar_error(recording, matches, {0: np.eye(4), 1: WRONG})
    assert right is not None and wrong is not None
    assert right < 0.3 and wrong > 4 * right


def test_the_table_says_none_where_nothing_can_be_said(recording):
    still = {0: np.eye(4), 1: np.eye(4)}
    table = epipolar_table(recording, {0: np.eye(4), 1: TRUE}, still, (1, 40))
    assert table["epipolar_px"]["1"] == pytest.approx(0.15, abs=0.15)
    assert table["epipolar_px"]["40"] is None and table["epipolar_given_px"] == {"1": None, "40": None}


def test_images_that_share_nothing_and_opencv_s_own_failures_give_no_matches(recording, monkeypatch):
    def fails(*_):
        raise cv2.error("!model.empty()")

    monkeypatch.setattr(cv2, "findFundamentalMat", fails)
    assert match_frames(recording, [0, 1], 1) == {}
