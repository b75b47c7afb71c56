"""`dsmap bench`: what is timed and what is left out, the tables, the file, and bad input. The peer is optional."""

import json
import time

import numpy as np
import pytest
from corner_frames import FRAMES

from dsmap.errors import InputError
from dsmap.fusion.config import MapConfig
from dsmap.fusion.evaluate.timing import Timing, time_steps
from dsmap.sequences import SequenceWriter
from dsmap.tools.commands.bench import Args, main, summarise, thread_counts
from dsmap.tools.support.bench_worker import Request, map_args, measured, summary
from dsmap.tools.twins.corner import INTRINSICS


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench") / "room"
    with SequenceWriter(folder, INTRINSICS) as writer:
        for frame in FRAMES:
            writer.write(frame.time, frame.rgb, frame.depth, T_world_camera=frame.T_world_camera)
    return folder


def request(recording, **changes) -> Request:
    values = {
        "system": "dsmap", "path": str(recording), "size": None, "frames": None, "stride": 1,
        "intrinsics": None, "depth_scale": None, "depth_max": 6.0, "threads": 1, "device": "cpu",
    }  # fmt: skip
    return Request(**{**values, **changes})


def test_first_frames_are_left_out():
    timing = Timing(frame_ms=[1000.0] * 5 + [20.0, 30.0], stages_ms={"track": [900.0] * 5 + [10.0, 20.0]})
    assert timing.fps == pytest.approx(40)
    assert timing.stages() == {"track": {"mean": 15.0, "median": 15.0}}
    assert Timing(frame_ms=[100.0, 300.0]).fps == pytest.approx(5), "too short to leave anything out"


def test_every_step_is_timed():
    timing = time_steps([0.02, 0.0], lambda frame: (time.sleep(frame), (np.eye(4), frame > 0))[1])
    assert timing.frame_ms[0] >= 20 > timing.frame_ms[1]
    assert timing.tracked == [True, False]
    assert len(timing.poses) == 2


def test_summary_counts_only_frames_with_a_reference():
    poses = [np.eye(4) for _ in range(8)]
    for i, pose in enumerate(poses):
        pose[:3, 3] = [i, i**2, 0]
    timing = Timing([10.0] * 8, poses, [True] * 7 + [False])
    values = summary(timing, [None, *poses[1:]], wall_s=2.0)
    assert values["ate_rmse_m"] == pytest.approx(0, abs=1e-9)
    assert values["tracked_frames"] == 7
    assert values["wall_fps"] == pytest.approx(4)
    assert summary(timing, [None] * 8, wall_s=2.0)["ate_rmse_m"] is None


def test_ratio_is_of_the_medians():
    def runs(*speeds):
        return [{"fps": v, "wall_fps": v, "peak_rss_bytes": 1, "ate_rmse_m": None} for v in speeds]

    values = summarise({"dsmap": runs(10, 30, 12), "open3d": runs(6, 1, 8)})
    assert values["speed_ratio"] == pytest.approx(2)
    assert values["dsmap"]["ate_rmse_m"] is None


def test_worker_maps_the_recording(recording):
    result = measured(request(recording, frames=8))
    assert result["frames"] == result["tracked_frames"] == 8
    assert result["ate_rmse_m"] < 0.01
    assert {"preprocess", "track", "associate", "fuse", "predict"} <= set(result["stages_ms"])
    assert result["fps"] > 0
    assert result["peak_rss_bytes"] > 1e6


def test_command_writes_tables_and_file(recording, tmp_path, capsys):
    args = Args(
        recording, runs=1, size="80x60", frames=8, threads="1,2", depth_max=6.0, out=tmp_path / "b.json"
    )
    assert main(args) == 0
    text = capsys.readouterr().out
    for words in (
        "8 frames of 80x60, 1 threads",
        "frames/s",
        "ATE [cm]",
        "8/8",
        "preprocess",
        "whole frame",
        "times the first",
    ):
        assert words in text, words
    report = json.loads((tmp_path / "b.json").read_text())
    assert len(report["runs"]["dsmap"]) == 1
    assert report["setup"]["size"] == [80, 60]
    assert report["summary"]["dsmap"]["fps"] > 0
    assert "speed_ratio" not in report["summary"]
    assert [row["threads"] for row in report["scaling"]] == [1, 2] and report["setup"]["threads"] == 2
    assert all(row["tracked_frames"] == 8 and row["ate_rmse_m"] < 0.02 for row in report["scaling"])


def test_the_worker_takes_what_map_takes(recording, tmp_path):
    preset = tmp_path / "mine.yaml"
    preset.write_text("undistort: false\ntrack:\n  view_width: 160\nsurfels:\n  resolution: 0.004\n")
    args = map_args(request(recording, config=str(preset), segmenter="labels"))
    assert not args.undistort and args.map.track.view_width == 160 and args.map.surfels.resolution == 0.004
    assert args.spec.kind == "labels" and map_args(request(recording)).spec.kind == "none"
    assert map_args(request(recording)).map.surfels == MapConfig().surfels
    with pytest.raises(InputError, match="no such configuration"):
        map_args(request(recording, config="nowhere"))


@pytest.mark.parametrize("words", ["0", "two", "1,,2", "-1", "4096"])
def test_odd_numbers_of_threads_are_refused(words):
    with pytest.raises(InputError, match="--threads is"):
        thread_counts(words)


def test_bad_input(recording, tmp_path):
    with pytest.raises(InputError, match="--runs is 0"):
        main(Args(recording, runs=0))
    with pytest.raises(InputError, match="expected a recording's folder"):
        main(Args(tmp_path / "missing"))
    for frame in (recording / "rgb").iterdir():
        damaged = tmp_path / "rgb" / frame.name
        damaged.parent.mkdir(exist_ok=True)
        damaged.write_bytes(b"\x89PNG broken")
    for name in ("depth", "rgb.txt", "depth.txt", "calibration.yaml"):
        (tmp_path / name).symlink_to(recording / name)
    with pytest.raises(InputError, match="rgb"):
        main(Args(tmp_path, runs=1, out=tmp_path / "b.json"))
    assert not (tmp_path / "b.json").exists()


def test_open3d_missing_is_named(recording, monkeypatch, tmp_path):
    from dsmap.tools.support import bench_peer

    (tmp_path / "open3d.py").write_text("raise OSError('libusb-1.0.so.0: cannot open shared object file')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(InputError, match=r"libusb-1\.0\.so\.0.*apt-get install libusb-1\.0-0 libgomp1"):
        bench_peer.check_open3d()


@pytest.mark.slow
def test_peer_runs_on_the_same_frames(recording, tmp_path, capsys):
    pytest.importorskip("open3d", reason="Open3D or a library it needs is not here", exc_type=ImportError)
    args = Args(recording, peer="open3d", runs=1, frames=8, depth_max=6.0, out=tmp_path / "b.json")
    assert main(args) == 0
    report = json.loads((tmp_path / "b.json").read_text())
    peer = report["runs"]["open3d"][0]
    assert peer["frames"] == 8
    assert peer["ate_rmse_m"] < 0.05
    assert report["summary"]["speed_ratio"] > 0
    assert "times Open3D's frames per second" in capsys.readouterr().out
