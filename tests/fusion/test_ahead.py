"""Frames prepared ahead, and views kept: the same maps, and no prediction where nothing has changed."""

import numpy as np
import pytest
from loop_room import frame, mapper

from dsmap.errors import InputError
from dsmap.fusion.config import TrackConfig
from dsmap.fusion.runs.prepare_ahead import prepare_ahead
from dsmap.fusion.surfels.views import view_is_stale


def test_preparing_ahead_changes_nothing():
    frames = [frame(k, k) for k in range(5)]
    direct, ahead = mapper(), mapper()
    for each in frames:
        direct.step(each)
    for ready in prepare_ahead(ahead, iter(frames)):
        assert ahead.step(ready.frame, ready.maps, ready.waited_ms).stages_ms["preprocess"] == ready.waited_ms
    assert len(ahead.trajectory) == 5
    for name, value in direct.surfels.numpy().items():
        np.testing.assert_array_equal(value, ahead.surfels.numpy()[name], err_msg=name)


def test_a_bad_frame_is_told_in_its_turn():
    good, bad = frame(0, 0), frame(1, 1)
    bad.depth = bad.depth[:-1]
    m, seen = mapper(), []
    with pytest.raises(InputError, match="frame 1: depth"):
        for ready in prepare_ahead(m, [good, bad]):
            seen.append(m.step(ready.frame, ready.maps).tracked)
    assert seen == [True]
    assert list(prepare_ahead(m, [])) == []


def test_a_camera_that_stands_still_keeps_its_view():
    m = mapper()
    predicted = ["predict" in m.step(frame(k, 0)).stages_ms for k in range(7)]
    # Every second frame, and the fifth for the keyframes.
    assert predicted == [True, False, True, False, True, True, True]


def test_when_a_camera_view_is_stale_its_view():
    config, near, far, turned = TrackConfig(), np.eye(4), np.eye(4), np.eye(4)
    near[0, 3], far[0, 3] = 0.9 * config.predict_distance, 1.1 * config.predict_distance
    a = np.deg2rad(1.1 * config.predict_angle_deg)
    turned[:2, :2] = [[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]
    assert [view_is_stale(config, np.eye(4), T) for T in (near, far, turned)] == [False, True, True]
