"""Frames shown mirrored to a segmenter, and which ones are."""

import numpy as np
import pytest

from dsmap.classes import CLASS_NAMES
from dsmap.frame import Frame, FrameGeometry, Intrinsics
from dsmap.fusion.config import LabelConfig, MapConfig
from dsmap.fusion.labels.mirrored import Mirrored
from dsmap.fusion.labels.semantics import Schedule
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.segmenter import wants_geometry

RNG = np.random.default_rng(5)
SIZE = (60, 80)
BED, WALL = CLASS_NAMES.index("bed"), CLASS_NAMES.index("wall")


class Exact:
    """Says of every pixel the label that the frame has there, and remembers what it was shown."""

    wants_geometry = True

    def __call__(self, frame: Frame, geometry: FrameGeometry | None = None) -> np.ndarray | None:
        self.frame, self.geometry = frame, geometry
        return None if frame.label is None else np.eye(14, dtype=np.float32)[frame.label]


def frame(label: np.ndarray | None, time: float = 0.0) -> Frame:
    y, x, c = np.mgrid[: SIZE[0], : SIZE[1], :3]
    rgb = (128 + 60 * np.sin(x / 5 + c) + 60 * np.cos(y / 7)).astype(np.uint8)
    return Frame(0, time, rgb, np.full(SIZE, 1.5, np.float32), np.eye(4), label)


def test_answers_come_back_where_they_belong():
    seen = frame(RNG.integers(1, 14, SIZE, np.uint8))
    up = np.array([0.6, -0.8, 0.0])
    geometry = FrameGeometry(RNG.random((*SIZE, 4), np.float32), up, -1.3)
    inner = Exact()
    answer = Mirrored(inner)(seen, geometry)
    np.testing.assert_array_equal(answer, np.eye(14, dtype=np.float32)[seen.label])
    for name in ("rgb", "depth", "label"):
        np.testing.assert_array_equal(getattr(inner.frame, name), getattr(seen, name)[:, ::-1])
    assert inner.frame.T_world_camera is None and inner.frame.instance is None
    np.testing.assert_array_equal(inner.geometry.channels, geometry.channels[:, ::-1])
    np.testing.assert_array_equal(inner.geometry.up, [-0.6, -0.8, 0.0])
    assert inner.geometry.floor_height == -1.3


def test_a_segmenter_of_colours_alone_is_shown_no_geometry():
    mirrored = Mirrored(lambda seen: np.eye(14, dtype=np.float32)[seen.label])
    assert not wants_geometry(mirrored)
    seen = frame(RNG.integers(1, 14, SIZE, np.uint8))
    np.testing.assert_array_equal(mirrored(seen), np.eye(14, dtype=np.float32)[seen.label])
    assert Mirrored(Exact())(frame(None)) is None


@pytest.mark.parametrize("every, due", [(0, [1, 0, 0, 1, 0, 0, 1]), (2, [1, 0, 1, 0, 1, 0, 1])])
def test_every_second_labelled_frame_is_mirrored(every, due):
    schedule, never = (Schedule(LabelConfig(every=every, mirror=m)) for m in (True, False))
    T, mirrored = np.eye(4), []
    for expected in due:
        assert schedule.due(T) == never.due(T) == bool(expected)
        if expected:
            mirrored.append(schedule.mirrored)
        assert not never.mirrored
        T[0, 3] += 0.04
    assert mirrored == [i % 2 == 1 for i in range(len(mirrored))]


@pytest.mark.parametrize("mirror", [True, False])
def test_mistakes_that_have_a_side_cancel(mirror):
    """A network that takes whatever is on the left for a bed, in two frames of one view, before and after a resume."""

    def sided(seen: Frame) -> np.ndarray:
        p = np.zeros((*SIZE, 14), np.float32)
        p[:, :40, BED], p[:, :40, WALL] = 0.7, 0.3
        p[:, 40:, BED], p[:, 40:, WALL] = 0.3, 0.7
        return p

    config = MapConfig(poses="given", labels=LabelConfig(every=1, smooth=0.0, temperature=1.0, mirror=mirror))
    camera = Intrinsics(80, 60, 80.0, 80.0, 39.5, 29.5)
    first = Mapper(config, camera, sided)
    first.step(frame(None))
    second = Mapper(config, camera, sided, surfels=first.surfels)
    second.load_state(first.state(), first.trajectory)
    second.step(frame(None, 0.1))
    p = second.probabilities()
    left = second.surfels.numpy()["position"][:, 0] < -0.1
    expected = 0.5 if mirror else 0.7
    np.testing.assert_allclose(p[left, BED - 1], expected, atol=0.02)
    np.testing.assert_allclose(p[~left][-1, WALL - 1], expected, atol=0.02)
