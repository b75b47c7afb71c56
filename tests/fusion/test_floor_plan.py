"""The floor plan's score: what of a mesh is in the way, what is floor, and how cells are counted."""

import numpy as np

from dsmap.classes import CLASS_NAMES
from dsmap.fusion.evaluate import floor_plan
from dsmap.fusion.exports.occupancy import FREE, UNKNOWN, Grid
from dsmap.sequences.mesh import LabelledMesh


def rectangle(x: tuple[float, float], y: tuple[float, float], z: float) -> np.ndarray:
    return np.array([[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]])


def level_mesh(*rectangles: np.ndarray) -> LabelledMesh:
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(len(rectangles))])
    label = np.full(len(faces), CLASS_NAMES.index("floor"), np.uint8)
    return LabelledMesh(np.concatenate(rectangles).astype(np.float32), faces.astype(np.int32), label)


def test_a_table_top_is_in_the_way_a_lamp_on_the_ceiling_is_not():
    mesh = level_mesh(
        rectangle((0, 4), (0, 3), 0.0), rectangle((1, 2), (1, 2), 0.75), rectangle((3, 3.5), (0, 1), 2.2)
    )
    grid = Grid(np.full((40, 60), UNKNOWN, np.uint8), np.array([-0.5, -0.5]), 0.1)
    things, floor = floor_plan._true_cells(grid, mesh, np.eye(4))
    x, y = np.meshgrid(-0.45 + 0.1 * np.arange(60), -0.45 + 0.1 * np.arange(40))
    np.testing.assert_array_equal(things, (x > 1) & (x < 2) & (y > 1) & (y < 2))
    np.testing.assert_array_equal(floor, (x > 0) & (x < 4) & (y > 0) & (y < 3))


def test_points_spread_evenly_over_large_and_small_faces():
    points = floor_plan._points_on(
        level_mesh(rectangle((0, 3), (0, 1), 0.0), rectangle((10, 11), (0, 1), 0.0))
    )
    assert np.mean(points[:, 0] > 5) == np.clip(np.mean(points[:, 0] > 5), 0.24, 0.26)
    assert abs(points[points[:, 0] < 5].mean(axis=0) - [1.5, 0.5, 0.0]).max() < 0.02


def test_shares_of_cells():
    grid = Grid(np.array([[FREE, UNKNOWN], [FREE, FREE]], np.uint8), np.zeros(2), 1.0)
    counted = grid.count(np.array([[0.5, 0.5, 9.0], [0.6, 0.5, 0.0], [1.5, 1.5, 0.0], [2.5, 0.5, 0.0]]))
    np.testing.assert_array_equal(counted, [[2, 0], [0, 1]])
    assert floor_plan._share(counted > 0, grid.cells == FREE) == 2 / 3
    assert floor_plan._share(counted > 0, counted < 0) is None
