"""Keeping up with a camera: what is given up when steps are slow, and taken back when there is time."""

import dataclasses

import numpy as np
import pytest
from corner_frames import FRAMES, config

from dsmap.fusion.config import LabelConfig
from dsmap.fusion.labels.semantics import GroundTruthSegmenter
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.runs.pace import (
    LABEL_SHARE,
    LATENCY_S,
    Pace,
    largest_that_keeps_up,
    sizes,
    trial,
)
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


def test_labels_that_would_be_late_are_rarer_than_the_frames_that_may_be():
    mapper, pace = session()
    result = mapper.step(FRAMES[0])
    for k in range(30):
        pace.observe(k / 30, told(result, 30.0), 0.04, dropped=0)
    pace.observe(1.0, told(result, 30.0, label_ms=20.0), 0.06, dropped=0)
    assert abs(mapper.labeller.rest_until - (1.0 + 0.02 / LABEL_SHARE)) < 1e-6
    pace.observe(2.0, told(result, 30.0, label_ms=60.0), 0.12, dropped=29)
    assert mapper.labeller.rest_until >= 2.0 + 20 * pace.step_s


@pytest.mark.parametrize(
    "step_ms, label_ms, period_ms",
    [(15, 20, 33), (30, 45, 33), (45, 60, 33), (60, 30, 33), (30, 300, 33), (20, 60, 16), (50, 40, 66)],
)
def test_95_of_100_frames_are_new_when_they_are_mapped_whatever_the_machine(step_ms, label_ms, period_ms):
    mapper, pace = session(labels=LabelConfig(every=1))
    result = mapper.step(FRAMES[0])
    now, mapped, dropped = 0.0, -1, 0  # a clock of its own: a camera, and a machine that takes so long
    for _ in range(1500):
        index = max(int(now * 1e3 / period_ms + 1e-9), mapped + 1)
        time = index * period_ms / 1e3
        dropped += index - mapped - 1
        labelled = time >= mapper.labeller.rest_until
        predicted = len(pace.delays_s) % mapper.model.predict_every == 0
        took_ms = step_ms * (1.2 if predicted else 0.8)
        now = max(now, time) + (took_ms + label_ms * labelled) / 1e3
        pace.observe(time, told(result, took_ms, label_ms * labelled), now - time, dropped)
        mapped = index
    report = pace.report()
    assert report["latency_ms"]["p95"] <= 1e3 * LATENCY_S + 1e-6
    assert report["labelled_frames"] >= 10, "labels are never given up altogether"
    assert report["dropped_frames"] + report["mapped_frames"] == mapped + 1
    if step_ms + label_ms < period_ms:
        assert dropped == 0


def test_the_largest_size_that_leaves_labels_their_share_is_chosen():
    candidates = sizes(640, 480)
    assert candidates == [(640, 480), (480, 360), (320, 240)]
    ms_a_pixel = {"fast": 5e-8, "middle": 1.2e-7, "slow": 1e-6}
    chosen = {
        name: largest_that_keeps_up(candidates, lambda size, s=s: (s * size[0] * size[1], 0.04), 1 / 30)
        for name, s in ms_a_pixel.items()
    }
    assert chosen == {"fast": (640, 480), "middle": (480, 360), "slow": (320, 240)}
    assert largest_that_keeps_up(candidates, lambda _: (0.028, 0.0), 1 / 30) == (640, 480), "without labels"
    assert largest_that_keeps_up(candidates, lambda _: (0.028, 0.01), 1 / 30) == (320, 240), "with labels"


def test_sizes_keep_the_shape_and_are_no_narrower_than_320():
    assert sizes(1280, 720) == [(1280, 720), (960, 540), (640, 360), (480, 270), (320, 180)]
    assert sizes(320, 240) == [(320, 240)] and sizes(96, 72) == [(96, 72)]


def test_a_trial_counts_what_labels_cost_apart():
    class Told:
        def __init__(self):
            self.count = 0

        def step(self, frame):
            self.count += 1
            cold = 500.0 if self.count < 3 else 0.0
            return told(result, 20.0 + cold, label_ms=50.0 if self.count % 3 == 1 else 0.0)

    mapper, _ = session()
    result = mapper.step(FRAMES[0])
    assert trial(Told(), FRAMES) == pytest.approx((0.020, 0.050))
    assert trial(Told(), FRAMES[:1]) == pytest.approx((0.520, 0.050)), "all there is"


def test_the_summary_tells_median_and_95_percent():
    mapper, pace = session()
    assert "no frame" in pace.summary()
    pace.delays_s, pace.dropped, pace.labelled_at = list(np.linspace(0.01, 0.11, 101)), 7, [0.0, 0.5, 1.0]
    first, second = pace.summary().splitlines()
    assert first == "latency 60 ms (median), 105 ms (95 %); 7 frames dropped, 101 mapped"
    assert "96x72, labels every 0.5 s" in second
