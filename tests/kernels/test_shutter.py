"""RowMotion shutter: the kernel against its twin, a frame put right against the truth, and what tracking gains."""

import numpy as np
import pytest
import warp as wp

from dsmap.frame import Frame
from dsmap.fusion.config import MapConfig, TrackConfig
from dsmap.fusion.lie import exp_se3, inverse, rotation_angle
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.surfels.model_view import ModelView
from dsmap.fusion.tracking.rolling_shutter import RowMotion, corrected_frame, row_motion, undo_rolling_shutter
from dsmap.fusion.tracking.tracker import Tracker
from dsmap.fusion.trajectory import TrajectoryPoint
from dsmap.kernels.preprocess import preprocess
from dsmap.kernels.shutter import global_shutter
from dsmap.metrics import ate_rmse
from dsmap.tools.twins import corner as wall_corner
from dsmap.tools.twins import images as reference
from dsmap.tools.twins.corner import READOUT, TWIST, rolled

CPU = wp.get_device("cpu")
LEVELS = wall_corner.LEVEL_CAMERAS


def test_the_kernel_equals_its_twin():
    maps = preprocess(*rolled(np.eye(4)), LEVELS, CPU)[0]
    got = global_shutter(LEVELS[0], maps, TWIST, READOUT)
    names = ("vertex", "normal", "intensity", "depth", "radius", "colour", "edge")
    before = {name: getattr(maps, name).numpy().astype(np.float64) for name in names}
    twin = reference.global_shutter(LEVELS[0], before, TWIST, READOUT)
    same = np.abs(got.vertex.numpy() - twin["vertex"]).max(axis=-1) < 1e-4
    assert same.mean() > 0.99, "a pixel on a border may take over its neighbour in single precision"
    for name in names:
        np.testing.assert_allclose(getattr(got, name).numpy()[same], twin[name][same], atol=1e-4)


def test_a_frame_put_right_is_one_taken_at_once():
    frame = preprocess(*rolled(np.eye(4)), LEVELS, CPU)
    right = [global_shutter(c, m, TWIST, READOUT) for c, m in zip(LEVELS, frame, strict=True)]
    for level, (raw, got) in enumerate(zip(frame, right, strict=True)):
        # Vertices against the planes of the room, seen from the middle pose.
        off = {}
        for name, maps in (("raw", raw), ("right", got)):
            vertex = maps.vertex.numpy().astype(np.float64)
            known = vertex[..., 2] > 0
            off[name] = np.percentile(wall_corner.distance(vertex[known]), 80)
            assert known.mean() > 0.85
        assert off["right"] < 0.25 * off["raw"], (level, off)


def test_nothing_changes_without_motion():
    maps = preprocess(*rolled(np.eye(4), np.zeros(6)), LEVELS, CPU)
    same = global_shutter(LEVELS[0], maps[0], np.zeros(6), READOUT)
    for name in ("vertex", "normal", "intensity", "radius", "colour", "edge"):
        np.testing.assert_allclose(getattr(same, name).numpy(), getattr(maps[0], name).numpy(), atol=1e-6)
    assert undo_rolling_shutter(LEVELS, maps, None, np.eye(4)) is maps
    for T in (np.eye(4), exp_se3(np.array([50.0, 0, 0, 0, 0, 0])), np.full((4, 4), np.nan)):
        assert undo_rolling_shutter(LEVELS, maps, RowMotion(READOUT, np.eye(4), 0.033), T) is maps


def test_tracking_finds_the_pose_of_the_middle_row():
    first = preprocess(*wall_corner.view(np.eye(4)), LEVELS, CPU)
    model = ModelView(first[0].vertex, first[0].normal, first[0].intensity, 3, np.eye(4))
    truth = exp_se3(TWIST / 30)
    frame = preprocess(*rolled(truth), LEVELS, CPU)
    tracker = Tracker(TrackConfig(so3=False), LEVELS)
    off = {}
    for name, rows in (("without", None), ("with", RowMotion(READOUT, np.eye(4), 1 / 30))):
        found, health = tracker.track(frame, model, rows=rows)
        error = inverse(truth) @ found
        assert health.tracked
        off[name] = np.linalg.norm(error[:3, 3]) + rotation_angle(error)  # a radian counts as a metre
    assert off["with"] < 1.5e-3 and off["with"] < 0.3 * off["without"], off


def test_the_network_sees_the_frame_put_right():
    rgb, depth = rolled(np.eye(4))
    maps = preprocess(rgb, depth, LEVELS, CPU)
    frame = Frame(0, 0.0, rgb, depth)
    np.testing.assert_array_equal(corrected_frame(frame, maps[0]).rgb, rgb)
    right = corrected_frame(frame, global_shutter(LEVELS[0], maps[0], TWIST, READOUT))
    truth = wall_corner.view(np.eye(4))[0].astype(float)
    assert np.abs(right.rgb - truth).mean() < 0.5 * np.abs(rgb - truth).mean()
    assert right.depth.dtype == np.float32 and right.rgb.dtype == np.uint8


def test_what_tells_nothing_about_the_motion_is_left_alone():
    def point(time: float, tracked: bool = True) -> TrajectoryPoint:
        return TrajectoryPoint(time, exp_se3(TWIST * time), tracked)

    found = row_motion(READOUT, [point(0.0), point(0.1)], 0.15, np.eye(4))
    assert found is not None
    np.testing.assert_allclose(found.twist(exp_se3(TWIST * 0.15)), TWIST, atol=1e-9)
    assert row_motion(0.0, [point(0.1)], 0.15, np.eye(4)) is None
    assert row_motion(READOUT, [], 0.15, np.eye(4)) is None
    assert row_motion(READOUT, [point(0.1, tracked=False)], 0.15, np.eye(4)) is None
    assert row_motion(READOUT, [point(0.1)], 0.5, np.eye(4)) is None
    assert row_motion(READOUT, [point(0.1)], 0.1, np.eye(4)) is None, "no time has passed"


def test_rows_after_a_lost_frame_move_as_since_the_last_tracked_one():
    points = [TrajectoryPoint(k / 30, exp_se3(TWIST * k / 30), True) for k in range(3)]
    points.append(TrajectoryPoint(0.1, points[-1].T_world_camera, False))
    found = row_motion(READOUT, points, 4 / 30, np.eye(4))
    assert found is not None
    np.testing.assert_allclose(found.twist(exp_se3(TWIST * 4 / 30)), TWIST, atol=1e-9)


@pytest.mark.parametrize("poses", ["track", "given"])
def test_a_camera_that_swings_is_tracked_and_maps_straight_walls(poses):
    """Twelve frames of one swing: rows read late see what an earlier frame's first rows saw."""
    steps = [exp_se3(TWIST * k / 30) for k in range(12)]
    frames = [Frame(k, k / 30, *rolled(T, TWIST if k else np.zeros(6)), T) for k, T in enumerate(steps)]
    pose, wall = {}, {}
    for readout in (0.0, READOUT):
        mapper = Mapper(MapConfig(readout_s=readout, poses=poses), wall_corner.INTRINSICS)
        results = [mapper.step(frame) for frame in frames]
        assert all(result.tracked for result in results)
        s = mapper.surfels.numpy()
        wall[readout] = float(
            np.mean(wall_corner.distance(s["position"][s["weight"] >= 3].astype(np.float64)))
        )
        pose[readout] = ate_rmse(np.array([r.T_world_camera for r in results]), np.array(steps), align=False)
    assert wall[READOUT] < 0.7 * wall[0.0], wall
    assert poses == "given" or pose[READOUT] < 0.5 * pose[0.0], pose
