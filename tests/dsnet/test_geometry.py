"""Geometry channels of a depth image, as training makes them."""

import cv2
import numpy as np
import pytest
from conftest import shared_data

from dsmap.dsnet.datasets.geometry import frame_geometry
from dsmap.frame import Intrinsics
from dsmap.sequences.calibration import read_calibration

CAMERA = Intrinsics(96, 72, 60.0, 60.0, 47.5, 35.5)


def level_room() -> np.ndarray:
    """Depth [m] from 1.4 m above a floor, 3 m from a wall."""
    y = np.mgrid[:72, :96][0]
    slope = (y - CAMERA.cy) / CAMERA.fy
    return np.minimum(3.0, np.where(slope > 0, 1.4 / np.maximum(slope, 1e-6), 3.0)).astype(np.float32)


def test_channels_of_a_level_room():
    got = frame_geometry(level_room(), CAMERA)
    assert got.shape == (72, 96, 4) and got.dtype == np.float32
    floor, wall = got[-4, 10:-10], got[20, 10:-10]
    np.testing.assert_allclose(floor[:, 1], 1, atol=0.01)
    np.testing.assert_allclose(floor[:, 2], -1 / 0.8, atol=0.05)
    np.testing.assert_allclose(wall[:, 1], 0, atol=0.02)


def test_given_up_and_floor_are_taken():
    up = np.array([0.0, -0.6, -0.8])
    got = frame_geometry(level_room(), CAMERA, up=up, floor_height=-2.0)
    assert got[20, 48, 1] == pytest.approx(0.8, abs=0.01)  # the wall's normal is (0, 0, -1)


def test_far_depth_and_no_depth():
    assert (frame_geometry(level_room(), CAMERA, depth_max=2.5)[20, :, 3] == 0).all()
    assert (frame_geometry(np.zeros((72, 96), np.float32), CAMERA) == 0).all()


def test_floors_of_photographs_lie_level_at_height_0():
    folder = shared_data("nyuv2_13_train")
    stored = read_calibration(folder)
    assert stored is not None
    heights, cosines, walls = [], [], []
    for file in sorted((folder / "depth").glob("*.png"))[::40]:
        depth = cv2.imread(str(file), -1).astype(np.float32) / stored.depth_scale
        label = cv2.imread(str(folder / "label" / file.name), -1)
        got = frame_geometry(depth, stored.intrinsics)
        floor, wall = got[(label == 5) & (got[..., 3] > 0)], got[(label == 12) & (got[..., 3] > 0)]
        if len(floor) > 4000:
            heights.append(np.median(floor[:, 2]) * 0.8 + 1.0)
            cosines.append(np.median(floor[:, 1]))
        if len(wall) > 4000:
            walls.append(np.median(wall[:, 1]))
    assert len(heights) > 8 and len(walls) > 8
    assert np.median(np.abs(heights)) < 0.02
    assert np.median(cosines) > 0.99
    assert np.median(np.abs(walls)) < 0.1
