"""Scores of a rolling camera's poses: right poses must not look wrong because rows are read one after the other."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dsmap.fusion.evaluate.epipolar import sampson_distance
from dsmap.fusion.evaluate.rolling_rows import Rows, rows_of
from dsmap.fusion.evaluate.trajectory import point_to_plane
from dsmap.fusion.lie import exp_se3, inverse
from dsmap.tools.twins import corner as wall_corner
from dsmap.tools.twins.corner import READOUT, TWIST, rolled

CAMERA = wall_corner.INTRINSICS
OTHER = np.array([0.2, 0.3, -0.1, -0.6, 0.4, 0.8])


def test_rows_are_where_the_camera_was():
    rows = np.array([0, 10, 35.5, 71])
    of = Rows(TWIST, READOUT, 72)
    for row, there, back in zip(rows, of.T_middle_row(rows), of.T_row_middle(rows), strict=True):
        np.testing.assert_allclose(there, exp_se3(TWIST * (row / 71 - 0.5) * READOUT), atol=1e-5)
        np.testing.assert_allclose(there @ back, np.eye(4), atol=1e-5)


def test_depth_of_a_rolling_camera_is_consistent_with_its_poses():
    T = exp_se3(np.array([0.1, 0.05, 0.0, 0.02, -0.05, 0.03]))
    (_, a), (_, b) = rolled(np.eye(4)), rolled(T, OTHER)
    plain = point_to_plane(a, b, inverse(T), CAMERA)
    right = point_to_plane(a, b, inverse(T), CAMERA, Rows(TWIST, READOUT, 72), Rows(OTHER, READOUT, 72))
    assert plain is not None and right is not None and right < 2e-4 and right < 0.1 * plain, (plain, right)


def test_features_of_a_rolling_camera_lie_on_their_epipolar_lines():
    rng = np.random.default_rng(0)
    points = rng.uniform((-0.8, -0.6, 1.5), (0.8, 0.6, 2.5), (200, 3))
    T_b_a = exp_se3(np.array([0.2, 0.05, 0.02, 0.02, -0.05, 0.03]))

    def seen(T: np.ndarray, rows: Rows) -> np.ndarray:
        """Pixels of points given in the camera of the middle row of a; T takes them into this one's."""
        p = points @ T[:3, :3].T + T[:3, 3]
        y = np.full(len(p), 36.0)
        for _ in range(20):
            R = rows.T_row_middle(y)
            q = np.einsum("nij,nj->ni", R[:, :3, :3], p) + R[:, :3, 3]
            y = CAMERA.fy * q[:, 1] / q[:, 2] + CAMERA.cy
        return np.stack([CAMERA.fx * q[:, 0] / q[:, 2] + CAMERA.cx, y], axis=1)

    rows_a, rows_b = Rows(TWIST, READOUT, 72), Rows(OTHER, READOUT, 72)
    a, b = seen(np.eye(4), rows_a), seen(T_b_a, rows_b)
    each = rows_b.T_row_middle(b[:, 1]) @ T_b_a @ rows_a.T_middle_row(a[:, 1])
    assert np.median(sampson_distance(a, b, T_b_a, CAMERA)) > 0.1
    assert np.median(sampson_distance(a, b, each, CAMERA)) < 1e-3


def test_the_motion_is_that_to_a_neighbour():
    entries = [SimpleNamespace(pose_time=k / 30) for k in range(4)]
    reference: Any = SimpleNamespace(entries=entries)
    poses = {k: exp_se3(TWIST * k / 30) for k in (0, 1, 3)}
    for frame in (0, 1):
        found = rows_of(reference, poses, frame, READOUT, 72)
        assert found is not None and found.twist == pytest.approx(TWIST)
    assert rows_of(reference, poses, 3, READOUT, 72) is None, "no neighbour has a pose"
    assert rows_of(reference, poses, 1, 0.0, 72) is None
