"""Rendered rolling shutter: every row is what a camera would see that was there at that row's time."""

import numpy as np
import pytest

from dsmap.errors import InputError
from dsmap.sequences import open_sequence

pytest.importorskip("mujoco_warp")
from dsmap.sim_scenes.camera_paths.row_poses import RowPoses
from dsmap.sim_scenes.recording.open_scene import open_scene
from dsmap.sim_scenes.recording.options import RenderOptions, plan_take
from dsmap.sim_scenes.recording.record import iter_frames, render_sequence
from dsmap.sim_scenes.render.open_renderer import open_renderer

OPTIONS = RenderOptions(scene="office", seed=3, frames=12, width=64, height=48, path="fast", readout_s=0.026)


@pytest.fixture(scope="module")
def scene():
    return open_scene(OPTIONS)


def test_rows_are_those_of_still_images_at_their_times(scene):
    take = plan_take(scene, OPTIONS)
    assert take.rows is not None
    path = take.rows[0]
    rows = path.rows(6, 48, 0.026)
    np.testing.assert_allclose(path.at(np.arange(12) / 30), take.poses, atol=1e-9)
    turned = np.rad2deg(np.arccos((np.trace(rows[0, :3, :3].T @ rows[-1, :3, :3]) - 1) / 2))
    assert turned > 1, "it turns while it is read"
    rolled = open_renderer("warp", take.scene, take.camera, rolling=True)(rows)
    still = open_renderer("warp", take.scene, take.camera)
    for row in (0, 17, 47):
        image = still(rows[row])
        off = np.abs(rolled.depth[row] - image.depth[row])
        assert np.median(off) < 1e-3 and np.mean(rolled.part[row] == image.part[row]) > 0.9, f"row {row}"
    image = still(rows[24])
    assert np.median(np.abs(rolled.depth[0] - image.depth[0])) > 5e-3


def test_poses_of_a_recording_are_those_of_its_depth_and_the_calibration_says_so(scene, tmp_path):
    options = RenderOptions(
        scene="office", seed=3, frames=4, width=32, height=32, readout_s=0.02, depth_readout_s=0.03,
        depth_offset_s=0.01,
    )  # fmt: skip
    render_sequence(tmp_path / "rec", options)
    sequence = open_sequence(tmp_path / "rec")
    assert sequence.readout_s == 0.03 and sequence.calibration.depth_time_offset_s == 0.01
    take = plan_take(open_scene(options), options)
    path = RowPoses(take.poses, 30.0, "walk")
    for k in range(4):
        entry = sequence.entries[k]
        assert entry.pose_time == pytest.approx(k / 30 + 0.01, abs=1e-5)
        np.testing.assert_allclose(entry.T_world_camera, path.at(np.array([k / 30 + 0.01]))[0], atol=1e-5)


def test_what_cannot_roll_is_refused(scene):
    for change in ({"path": "views"}, {"path": "jump"}, {"frames": 1}):
        with pytest.raises(InputError, match="follow one another"):
            plan_take(scene, RenderOptions(**{"readout_s": 0.026, "frames": 4} | change))
    with pytest.raises(InputError, match="expected warp"):
        next(iter_frames(scene, RenderOptions(readout_s=0.026, renderer="mujoco")))
