"""The mapper end to end on a small ray-cast room, without a network and without the simulator."""

from pathlib import Path

import numpy as np
import pytest
from corner_frames import FLOOR, FRAMES, WALL, config

from dsmap.classes import CLASS_NAMES
from dsmap.config_file import fill
from dsmap.errors import InputError
from dsmap.frame import Frame, Intrinsics
from dsmap.fusion.config import LabelConfig, MapConfig
from dsmap.fusion.labels.semantics import GroundTruthSegmenter, Schedule
from dsmap.fusion.lie import exp_se3, inverse
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.runs.checkpoint import load_map
from dsmap.fusion.runs.run_folder import save_run
from dsmap.tools.twins.corner import INTRINSICS


def test_tracks_and_fuses():
    mapper = Mapper(config(), INTRINSICS)
    for frame in FRAMES:
        result = mapper.step(frame)
        assert result.tracked, result.reason
        error = inverse(frame.T_world_camera) @ result.T_world_camera
        assert np.linalg.norm(error[:3, 3]) < 6e-3  # a pixel of this small image is 2.5 cm wide at 2.3 m
    surfels = mapper.surfels.numpy()
    pixels = np.count_nonzero(FRAMES[0].depth)
    assert 0.7 * pixels < mapper.surfels.count < 2 * pixels, (
        "new surfels where the view is new, not everywhere again"
    )
    assert (surfels["weight"] > 5).mean() > 0.5
    assert mapper.surfels.nbytes / mapper.surfels.capacity <= 160


def test_given_poses_are_taken_as_they_are():
    mapper = Mapper(config(poses="given"), INTRINSICS)
    for frame in FRAMES[:4]:
        assert (mapper.step(frame).T_world_camera == frame.T_world_camera).all()
    frame = Frame(9, 1.0, FRAMES[0].rgb, FRAMES[0].depth)
    assert not mapper.step(frame).tracked


def test_a_lost_frame_carries_the_last_pose_and_is_not_fused():
    mapper = Mapper(config(), INTRINSICS)
    for frame in FRAMES[:5]:
        mapper.step(frame)
    before = mapper.surfels.count
    pose = mapper.T_world_camera.copy()
    for bad in (np.zeros((72, 96)), np.full((72, 96), np.nan)):
        result = mapper.step(Frame(5, 5 / 30, FRAMES[5].rgb, bad.astype(np.float32)))
        assert not result.tracked and result.reason
    mapper.skip(0.2)
    assert mapper.surfels.count == before
    assert (mapper.trajectory[-1].T_world_camera == pose).all()
    result = mapper.step(FRAMES[6])
    assert result.tracked, "recovers from the last good view"
    assert [p.tracked for p in mapper.trajectory[-4:]] == [False, False, False, True]


def test_wrong_sizes_are_refused():
    mapper = Mapper(config(), INTRINSICS)
    with pytest.raises(InputError, match="96x70.*96x72"):
        mapper.step(Frame(0, 0.0, FRAMES[0].rgb, FRAMES[0].depth[:70]))
    with pytest.raises(InputError, match="too small"):
        Mapper(config(), Intrinsics(16, 16, 10, 10, 8, 8))
    with pytest.raises(InputError, match="CUDA"):
        Mapper(config(device="cuda:0"), INTRINSICS)


@pytest.mark.parametrize("rule", ["bayes", "mean", "geometric"])
def test_labels_survive_corruption(rule):
    segmenter = GroundTruthSegmenter(noise=0.4, seed=1)
    mapper = Mapper(config(poses="given", labels=LabelConfig(rule=rule, every=1)), INTRINSICS, segmenter)
    still = FRAMES[0]
    for i in range(14):
        mapper.step(Frame(i, i / 30, still.rgb, still.depth, still.T_world_camera, still.label))
    surfels = mapper.surfels.numpy()
    p, depth = surfels["position"], surfels["position"][:, 2]
    row = np.rint(INTRINSICS.fy * p[:, 1] / depth + INTRINSICS.cy)
    expected = np.where(row < 40, WALL, FLOOR)
    seen = (surfels["observations"] > 0) & (surfels["t_updated"] - surfels["t_created"] >= 9)
    assert seen.mean() > 0.5
    assert (surfels["label"][seen] == expected[seen]).mean() > 0.97
    probabilities = mapper.probabilities()
    np.testing.assert_allclose(probabilities.sum(axis=1), 1, atol=1e-4)
    of_label = np.take_along_axis(probabilities[seen], surfels["label"][seen, None].astype(int) - 1, axis=1)[
        :, 0
    ]
    assert (of_label >= probabilities[seen].max(axis=1) - 1e-5).all(), "the label is the most probable class"


def test_corruption_has_the_stated_share_and_kind():
    label = np.full((120, 160), WALL, np.uint8)
    for kind in ("pixels", "blobs"):
        wrong = GroundTruthSegmenter(0.4, kind).corrupt(label, 3) != label
        assert abs(wrong.mean() - 0.4) < (0.01 if kind == "pixels" else 0.08)
    again = GroundTruthSegmenter(0.4, "blobs").corrupt(label, 3)
    assert (again == GroundTruthSegmenter(0.4, "blobs").corrupt(label, 3)).all()
    assert (again != GroundTruthSegmenter(0.4, "blobs").corrupt(label, 4)).any(), "drawn anew each frame"
    chair, sofa = CLASS_NAMES.index("chair"), CLASS_NAMES.index("sofa")
    confused = GroundTruthSegmenter(0.4, "confusion").corrupt(np.full((99, 99), chair, np.uint8), 0)
    assert set(np.unique(confused)) == {chair, sofa} and abs((confused == sofa).mean() - 0.4) < 0.03
    assert GroundTruthSegmenter()(Frame(0, 0.0, FRAMES[0].rgb, FRAMES[0].depth)) is None


def test_schedule():
    every = Schedule(LabelConfig(every=3))
    assert [every.due(np.eye(4)) for _ in range(7)] == [True, False, False, True, False, False, True]
    keyframes = Schedule(LabelConfig(every=0, keyframe_distance=0.1))
    along = [exp_se3(np.array([0.04 * i, 0, 0, 0, 0, 0])) for i in range(7)]
    assert [keyframes.due(T) for T in along] == [True, False, False, True, False, False, True]


def test_checkpoint_round_trip(tmp_path):
    mapper = Mapper(config(poses="given"), INTRINSICS, GroundTruthSegmenter())
    for frame in FRAMES[:3]:
        mapper.step(frame)
    save_run(mapper, tmp_path)
    surfels, meta = load_map(tmp_path / "checkpoint.safetensors")
    for name, array in mapper.surfels.numpy().items():
        np.testing.assert_array_equal(surfels.numpy()[name], array)
    assert meta["config"] == mapper.config and meta["time"] == 3
    assert meta["poses"].shape == (3, 4, 4) and meta["tracked"].all()
    assert {f.name for f in tmp_path.iterdir()} == {
        "map.ply", "labels.ply", "trajectory.txt", "trajectory_status.txt",
        "loops.json", "classes.json", "objects.json", "scene_graph.json", "checkpoint.safetensors",
    }  # fmt: skip


def test_foreign_checkpoints_are_refused(tmp_path):
    from safetensors.numpy import save_file

    foreign, text = tmp_path / "foreign.safetensors", tmp_path / "text.safetensors"
    save_file({"weight": np.zeros(3, np.float32)}, foreign)
    text.write_text("not a checkpoint")
    for path, message in ((foreign, "not stated"), (text, "damaged"), (tmp_path / "none", "no such file")):
        with pytest.raises(InputError, match=message):
            load_map(path)
    with pytest.raises(InputError, match="unknown parameter 'colour'"):
        fill(MapConfig(), {"colour": 1}, "configuration")


def test_results_do_not_depend_on_the_number_of_threads(tmp_path):
    """Bit equality of a whole run with one slice and with three (each in its own process: the pool is cached)."""
    import os
    import subprocess
    import sys

    program = (
        f"import sys, numpy as np; sys.path[:0] = {[str(Path(__file__).parent), *sys.path]!r}\n"
        "from dsmap.kernels import launch; launch._SMALL = 100\n"
        "from test_mapper import *\n"
        "m = Mapper(config(), INTRINSICS, GroundTruthSegmenter(0.2))\n"
        "[m.step(f) for f in FRAMES[:5]]\n"
        "np.savez(sys.argv[1], **m.surfels.numpy(), pose=m.T_world_camera)\n"
    )
    saved = []
    for threads in ("1", "3"):
        path, env = tmp_path / f"{threads}.npz", os.environ | {"DSMAP_THREADS": threads}
        subprocess.run([sys.executable, "-c", program, str(path)], check=True, env=env)
        saved.append(np.load(path))
    for name in saved[0].files:
        np.testing.assert_array_equal(saved[0][name], saved[1][name], err_msg=name)
