"""What the mapper knows of up and the floor, and when it does not believe it."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from box_room import CAMERA, frame, room, turned

from dsmap.errors import InputWarning
from dsmap.frame import Frame, FrameGeometry
from dsmap.fusion.config import LabelConfig, MapConfig
from dsmap.fusion.exports.ply import up_of_ply
from dsmap.fusion.labels.segment import segment_later
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.runs.checkpoint import load_map, save_map
from dsmap.fusion.runs.read_run import load_run
from dsmap.fusion.runs.resume import resumed_mapper
from dsmap.fusion.runs.run_folder import save_run


class Curious:
    """A segmenter that keeps what it is shown and takes everything for a wall."""

    wants_geometry = True

    def __init__(self):
        self.seen: list[tuple[Frame, FrameGeometry | None]] = []

    def __call__(self, frame: Frame, geometry: FrameGeometry | None = None) -> np.ndarray:
        self.seen.append((frame, geometry))
        out = np.zeros((*frame.depth.shape, 14), np.float32)
        out[..., 12] = 1
        return out


def mapped(count: int, pitch=20.0, roll=0.0, scale=1.0, camera=CAMERA, **config) -> tuple[Mapper, Curious]:
    """A mapper after a slow sweep of the camera over the room, and its segmenter."""
    segmenter = Curious()
    labels = LabelConfig(every=1, mirror=False)
    mapper = Mapper(MapConfig(depth_max=60.0, poses="given", labels=labels, **config), camera, segmenter)
    for i in range(count):
        assert mapper.step(frame(i, turned(pitch - 0.5 * i, roll), scale)).tracked
    return mapper, segmenter


@pytest.fixture
def no_warnings():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def test_up_and_floor_come_from_the_map(no_warnings):
    mapper, segmenter = mapped(17)
    assert mapper.up @ [0, -1, 0] > np.cos(np.deg2rad(0.5))
    for i, (seen, geometry) in enumerate(segmenter.seen):
        assert seen.rgb is frame(i, turned(20, 0)).rgb or seen.rgb.shape == (120, 160, 3)
        assert geometry is not None and geometry.confidence > 0.9
        assert geometry.up @ turned(20 - 0.5 * i, 0) @ [0, -1, 0] > np.cos(np.deg2rad(0.5))
        assert geometry.floor_height == pytest.approx(-1.4, abs=0.02)
        floor = seen.label == 5
        assert np.median(geometry.channels[floor, 1]) > 0.99
        assert np.median(geometry.channels[floor, 2]) == pytest.approx(-1 / 0.8, abs=0.05)


def test_plain_functions_get_the_frame_alone():
    given = []
    mapper = Mapper(MapConfig(poses="given", camera_up="left"), CAMERA, lambda *args: given.append(args))
    mapper.step(frame(0, turned(20, 0)))
    assert len(given) == 1 and len(given[0]) == 1 and given[0][0].rgb.shape == (120, 160, 3)


@pytest.mark.parametrize("roll, side", [(90, "left"), (-90, "right"), (180, "bottom")])
def test_frames_of_a_rolled_camera_are_upright(roll, side, no_warnings):
    mapper, segmenter = mapped(2, roll=roll, camera_up=side)
    level = frame(1, turned(19.5, 0))
    seen, geometry = segmenter.seen[-1]
    assert mapper.up @ [0, -1, 0] > np.cos(np.deg2rad(0.5))
    assert geometry is not None and geometry.up[1] < -0.9
    assert seen.rgb.shape[:2] == ((120, 160) if roll == 180 else (160, 120))
    middle = (slice(30, 90), slice(50, 110)) if roll == 180 else (slice(50, 110), slice(30, 90))
    assert (seen.label[middle] == level.label[30:90, 50:110]).mean() > 0.97
    assert (mapper.surfels.numpy()["label"] == 12).mean() > 0.9, "turned back, every pixel has its label"


def test_a_camera_that_hangs_upside_down_is_noticed(no_warnings):
    mapper, segmenter = mapped(34, pitch=35, roll=180)
    first, last = (segmenter.seen[i][0].label for i in (0, -1))
    np.testing.assert_array_equal(first, frame(0, turned(35, 180)).label, "at first its top is taken for up")
    np.testing.assert_array_equal(last[::-1, ::-1], frame(33, turned(35 - 0.5 * 33, 180)).label)
    assert mapper.up @ [0, -1, 0] > np.cos(np.deg2rad(0.5))


def test_an_upright_camera_that_sees_the_ceiling_stays_upright(no_warnings):
    mapper, _ = mapped(34, pitch=15)
    assert mapper.labeller.gravity.side == "top" and mapper.up @ [0, -1, 0] > 0.99


@pytest.mark.parametrize("scale, why", [(1 / 7, "0.20 m below"), (5.7, "high"), (8, "high")])
def test_a_wrong_depth_scale_drops_geometry_and_says_so_once(scale, why):
    with pytest.warns(InputWarning, match=f"{why}.*depth scale.*colours alone") as said:
        mapper, segmenter = mapped(4, scale=scale, depth_min=0.01)
    assert len(said) == 1
    assert all(geometry is None for _, geometry in segmenter.seen)
    assert mapper.up @ [0, -1, 0] > 0.99, "up does not depend on the scale"


def test_a_far_floor_hints_at_the_scale():
    segmenter = Curious()
    mapper = Mapper(MapConfig(depth_max=60.0, poses="given"), CAMERA, segmenter)
    R = turned(40, 0)  # no ceiling in view: only the floor's distance can tell
    with pytest.warns(InputWarning, match=r"4\.2. m below the camera.*depth scale"):
        mapper.step(replace(frame(0, R), depth=3 * room(R)[0][..., 2].astype(np.float32)))


def test_intrinsics_that_no_camera_has():
    with pytest.warns(InputWarning, match="fx = 1 .*179 degrees.*colours alone"):
        _, segmenter = mapped(1, camera=replace(CAMERA, fx=1.0, fy=1.0))
    assert segmenter.seen[0][1] is None


def test_a_frame_without_depth():
    mapper, segmenter = mapped(1)
    tiles = np.uint8(
        np.indices((120, 160)).sum(axis=0) // 20 % 2 * 100 + 60
    )  # colours that could tell something
    blind = replace(
        frame(1, turned(20, 0)), rgb=np.dstack([tiles] * 3), depth=np.zeros((120, 160), np.float32)
    )
    with pytest.warns(InputWarning, match="no depth.*colours alone"):
        mapper.step(blind)
    mapper.step(frame(2, turned(20, 0)))
    assert [geometry is None for _, geometry in segmenter.seen] == [False, True, False]


def test_a_checkpoint_keeps_up_and_the_floor(tmp_path):
    mapper, _ = mapped(18)
    save_map(mapper, tmp_path / "map.safetensors")
    again = resumed_mapper(*load_map(tmp_path / "map.safetensors"), "here", CAMERA)
    before, after = mapper.labeller.gravity.state(), again.labeller.gravity.state()
    assert before.keys() == after.keys() and before
    for name in before:
        np.testing.assert_array_equal(before[name], after[name])


def test_a_robot_sees_its_wide_floor_from_near(no_warnings):
    R = turned(15, 0)
    points, _ = room(R, above=0.5)
    mapper = Mapper(MapConfig(depth_max=8.0, poses="given"), CAMERA, Curious())
    mapper.step(replace(frame(0, R), depth=points[..., 2].astype(np.float32)))
    assert mapper.labeller.gravity.floor == pytest.approx(-0.5, abs=0.02)


def test_a_run_says_which_way_is_up(tmp_path):
    mapper, _ = mapped(3)
    save_run(mapper, tmp_path)
    up = up_of_ply(tmp_path / "map.ply")
    np.testing.assert_allclose(up, mapper.up, atol=1e-5)
    np.testing.assert_array_equal(load_run(tmp_path).gravity.up, mapper.labeller.gravity.up)


def test_a_frame_of_a_finished_map_is_shown_as_it_was_then():
    mapper, segmenter = mapped(3)
    then = segmenter.seen[-1][1]
    last = frame(2, turned(19, 0))
    segment_later(segmenter, last, last.T_world_camera, mapper.labeller.gravity, CAMERA, mapper.config)
    np.testing.assert_array_equal(segmenter.seen[-1][1].channels, then.channels)


def test_asking_for_up_changes_nothing():
    mapper, _ = mapped(3)
    before = mapper.labeller.gravity.state()
    mapper.labeller.gravity._looked -= 15
    assert mapper.up is not None
    mapper.labeller.gravity._looked += 15
    for name, value in mapper.labeller.gravity.state().items():
        np.testing.assert_array_equal(value, before[name])
