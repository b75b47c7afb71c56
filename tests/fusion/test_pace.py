"""Keeping up with a camera: what is given up when steps are slow, and taken back when there is time."""

import dataclasses

import numpy as np
from corner_frames import FRAMES, config

from dsmap.fusion.config import LabelConfig
from dsmap.fusion.labels.semantics import GroundTruthSegmenter
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.runs.pace import LABEL_SHARE, Pace
from dsmap.tools.twins.corner import INTRINSICS


def session(**changes) -> tuple[Mapper, Pace]:
    mapper = Mapper(config(**changes), INTRINSICS, GroundTruthSegmenter())
    return mapper, Pace(mapper)


def told(result, step_ms: float, label_ms: float = 0.0):
    """The result of a step that took so long."""
    stages = {"track": step_ms, "segment": label_ms}
    return dataclasses.replace(result, stages_ms=stages, segmented=label_ms > 0)


def test_slow_steps_predict_less_often_and_fast_ones_as_usual_again():
    mapper, pace = session()
    result, usual = mapper.step(FRAMES[0]), mapper.model.predict_every
    for k in range(8):
        pace.observe(k / 30, told(result, 50.0), 0.05, dropped=k)
    assert mapper.model.predict_every == 4 > usual
    for k in range(8, 60):
        pace.observe(k / 30, told(result, 5.0), 0.01, dropped=7)
    assert mapper.model.predict_every == usual


def test_dropped_frames_do_not_make_the_camera_look_slow():
    mapper, pace = session()
    result = mapper.step(FRAMES[0])
    for k in range(20):
        pace.observe(k / 10, told(result, 100.0), 0.1, dropped=2 * k)  # two of three frames are dropped
    assert abs(pace.period_s - 1 / 30) < 1e-6 and mapper.model.predict_every == 4


def test_labels_wait_until_their_share_of_the_time_is_there():
    labels = LabelConfig(every=1)
    mapper, pace = session(labels=labels)
    result = mapper.step(FRAMES[0])
    assert result.segmented
    pace.observe(FRAMES[0].time, told(result, 5.0, label_ms=20.0), 0.03, dropped=0)
    rest = 0.02 / LABEL_SHARE
    segmented = [mapper.step(frame).segmented for frame in FRAMES[1:6]]
    assert segmented == [frame.time >= FRAMES[0].time + rest for frame in FRAMES[1:6]]
    assert any(segmented) and not all(segmented)


def test_the_summary_tells_median_and_95_percent():
    mapper, pace = session()
    assert "no frame" in pace.summary(0)
    pace.delays_s = list(np.linspace(0.01, 0.11, 101))
    line = pace.summary(7)
    assert "60 ms (median), 105 ms (95 %); 7 frames dropped, 101 mapped" in line
