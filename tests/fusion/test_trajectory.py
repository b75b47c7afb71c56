"""The path of the camera between the stamps of depth and colour."""

import numpy as np
import pytest

from dsmap.fusion.lie import exp_se3, rotation_angle
from dsmap.fusion.trajectory import TrajectoryPoint, at_colour_stamps

TWIST = np.array([0.3, -0.1, 0.2, 0.2, 0.5, -0.3])
"""Motion of the camera [m/s, rad/s], in its own frame."""


def steady(time: float) -> np.ndarray:
    return exp_se3(time * TWIST)


def points(lag: float, frames: int = 6) -> list[TrajectoryPoint]:
    """A camera in steady motion at 30 frames/s whose depth images are `lag` seconds later than its colour."""
    return [TrajectoryPoint(k / 30, steady(k / 30 + lag), True, k / 30 + lag) for k in range(frames)]


@pytest.mark.parametrize("lag", [-0.012, 0.0, 0.012])
def test_steady_motion_is_found_at_the_colour_stamps(lag):
    poses = at_colour_stamps(points(lag))
    for k, T in enumerate(poses):
        error = np.linalg.inv(steady(k / 30)) @ T
        assert np.linalg.norm(error[:3, 3]) < 1e-4 and rotation_angle(error[:3, :3]) < 1e-4


def test_one_stamp_means_that_nothing_moves():
    path = points(0.0)
    for point in path[:3]:
        point.depth_time = None
    assert np.array_equal(at_colour_stamps(path), [p.T_world_camera for p in path])


def test_lost_and_distant_neighbours_say_nothing():
    path = points(-0.01)
    path[3].tracked = False
    path[5].time += 0.2
    assert path[5].depth_time is not None
    path[5].depth_time += 0.2
    poses = at_colour_stamps(path)
    moved = [not np.array_equal(T, p.T_world_camera) for T, p in zip(poses, path, strict=True)]
    assert moved == [True, True, False, False, False, False]
    assert len(at_colour_stamps([])) == 0
