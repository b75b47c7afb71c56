"""Options of a recording: cameras, lens, effects, covered lens, round trips, sensors' ranges."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from dsmap.errors import InputError
from dsmap.sequences import open_sequence
from dsmap.sim_scenes.recording.options import RenderOptions, camera_of_options, plan_take
from dsmap.sim_scenes.recording.record import iter_frames, render_sequence
from dsmap.sim_scenes.rooms.build import build_scene

SMALL = RenderOptions(scene="bathroom", seed=3, frames=4, width=64, height=48, fps=2.0)


def test_intrinsics_and_lens_are_written_as_rendered(tmp_path: Path) -> None:
    options = replace(SMALL, intrinsics=(50.0, 61.0, 20.5, 30.0), distortion=True)
    sequence = open_sequence(render_sequence(tmp_path / "odd", options))
    camera = sequence.intrinsics
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (50.0, 61.0, 20.5, 30.0)
    content = yaml.safe_load((tmp_path / "odd" / "calibration.yaml").read_text())
    assert content["distortion"]["k1"] == pytest.approx(camera_of_options(options).distortion[0]) != 0


@pytest.mark.parametrize(
    ("noise", "focal", "reach"), [("none", 525, 8), ("kinect", 525, 5), ("d435", 616, 4), ("azure", 504, 5)]
)
def test_every_sensor_has_its_camera_and_range(
    tmp_path: Path, noise: str, focal: float, reach: float
) -> None:
    sequence = open_sequence(render_sequence(tmp_path / noise, replace(SMALL, frames=1, noise=noise)))
    assert sequence.intrinsics.fx == pytest.approx(focal / 10) and sequence.depth_max == reach
    assert (sequence.frame(0).depth > 0).mean() > 0.4


def test_effects_change_colours_only() -> None:
    scene = build_scene("bathroom", 3)
    plain, toned = (list(iter_frames(scene, replace(SMALL, effects=e))) for e in ("none", "strong"))
    for a, b in zip(plain, toned, strict=True):
        assert np.abs(a.rgb.astype(int) - b.rgb).mean() > 2
        assert np.array_equal(a.depth, b.depth) and np.array_equal(a.label, b.label)


def test_a_covered_lens_sees_nothing() -> None:
    options = replace(SMALL, path="cover", frames=24, fps=6.0)
    frames = list(iter_frames(build_scene("bathroom", 3), options))
    dark = np.array([f.rgb.max() == 0 for f in frames])
    assert 5 <= dark.sum() <= 7 and not dark[:3].any()
    for frame, covered in zip(frames, dark, strict=True):
        assert (
            covered == (frame.depth.max() == 0) == (frame.label.max() == 0) == (frame.true_depth.max() == 0)
        )


def test_a_round_trip_takes_as_many_frames_as_it_needs() -> None:
    take = plan_take(build_scene("bathroom", 3), replace(SMALL, path="loop", frames=0))
    assert len(take.poses) > 10 and np.linalg.norm(take.poses[-1, :3, 3] - take.poses[0, :3, 3]) < 0.35


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frames": 0}, "frames is 0; expected at least 1"),
        ({"noise": "lidar"}, "expected one of: none, kinect, d435, azure"),
        ({"effects": "odd"}, "expected one of: none, mild, strong"),
        ({"moving": "dog"}, "expected one of: none, chair, door, ball, person"),
        ({"intrinsics": (0.0, 60.0, 30.0, 20.0)}, "positive fx and fy"),
        ({"distortion": True, "renderer": "pyrender"}, "expected warp"),
    ],
)
def test_bad_options_are_named(change: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(SMALL, **change).check()
