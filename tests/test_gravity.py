"""Up and the floor of a view."""

import numpy as np
import pytest
from box_room import room, turned

from dsmap.gravity import CAMERA_HEIGHT, LEVEL, estimate_floor, estimate_up


def error_deg(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b, -1, 1))))


@pytest.mark.parametrize("pitch, roll", [(0, 0), (30, 0), (10, 10), (20, -30)])
def test_up_and_floor_of_a_room(pitch, roll):
    R = turned(pitch, roll)
    points, normals = room(R, noise=0.05)
    up = estimate_up(normals)
    assert error_deg(up.direction, R @ [0, -1, 0]) < 0.5
    assert up.confidence > 0.9
    assert estimate_floor(points, normals, up.direction) == pytest.approx(-1.4, abs=0.02)


@pytest.mark.parametrize("roll", [90, 180, -90])
def test_a_rolled_camera_needs_a_start(roll):
    R = turned(10, roll)
    _, normals = room(R)
    start = turned(0, roll) @ [0, -1, 0]
    assert error_deg(estimate_up(normals, start).direction, R @ [0, -1, 0]) < 0.5
    assert error_deg(estimate_up(normals).direction, R @ [0, -1, 0]) > 60


def test_one_wall_leaves_up_to_the_start():
    start = turned(15, 0) @ [0, -1, 0]
    wall = np.tile(turned(15, 0) @ [0, 0, -1], (60, 80, 1))
    up = estimate_up(wall, start)
    assert error_deg(up.direction, start) < 0.1 and up.confidence < 0.1


def test_without_normals_up_is_the_start():
    up = estimate_up(np.zeros((60, 80, 3)))
    assert tuple(up.direction) == LEVEL and up.confidence == 0


def test_normals_that_follow_nothing_are_no_evidence():
    n = np.random.default_rng(1).normal(size=(60, 80, 3))
    assert estimate_up(n / np.linalg.norm(n, axis=-1, keepdims=True)).confidence < 0.5


def test_a_table_that_hides_the_floor_is_no_floor():
    points, normals = room(turned(50, 0), table=0.75)
    seen = points @ [0, -1.0, 0]
    points[(points @ (turned(50, 0) @ [0, -1, 0])) < -0.7] = 0  # only what lies above the table top
    assert seen.any()
    floor = estimate_floor(points, normals, turned(50, 0) @ [0, -1, 0])
    assert floor == -CAMERA_HEIGHT


def test_few_points_that_lie_lower_do_not_move_the_floor():
    R = turned(20, 0)
    points, normals = room(R)
    points[::10, ::10] *= 1.6  # reflections
    assert estimate_floor(points, normals, R @ [0, -1, 0]) == pytest.approx(-1.4, abs=0.02)


def test_without_depth_the_floor_is_where_cameras_are_held():
    assert estimate_floor(np.zeros((60, 80, 3)), np.zeros((60, 80, 3)), np.array(LEVEL)) == -CAMERA_HEIGHT
