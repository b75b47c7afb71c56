"""`dsmap map` that is killed, goes on, starts in a saved map: as a user calls it."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import loop_room
import numpy as np
import pytest
from corner_frames import record
from safetensors.numpy import load_file

from dsmap.fusion.runs.read_run import load_run
from dsmap.sequences import SequenceWriter
from dsmap.tools.cli import run

FLAGS = ["--segmenter", "labels", "--label-noise", "0.2", "--device", "cpu", "--no-pictures"]


def tensors(folder: Path) -> dict[str, np.ndarray]:
    """All that a checkpoint holds but milliseconds."""
    arrays = load_file(folder / "checkpoint.safetensors")
    return {name: array for name, array in arrays.items() if not name.startswith("state.clock.")}


def assert_same_runs(a: Path, b: Path) -> None:
    ours, theirs = tensors(a), tensors(b)
    assert ours.keys() == theirs.keys()
    for name in ours:
        np.testing.assert_array_equal(ours[name], theirs[name], err_msg=name)
    for name in ("map.ply", "labels.ply", "trajectory.txt", "loops.json"):
        assert (a / name).read_bytes() == (b / name).read_bytes(), name


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    """84 frames, one of them damaged."""
    path = record(tmp_path_factory.mktemp("resume") / "room", repeat=3)
    damaged = sorted((path / "depth").iterdir())[7]
    damaged.write_bytes(damaged.read_bytes()[:100])
    return path


@pytest.fixture(scope="module")
def straight(recording) -> Path:
    """The run that was never interrupted."""
    out = recording.parent / "straight"
    assert run("map", [str(recording), "--out", str(out), *FLAGS]) == 0
    return out


def _hears_hangups() -> None:
    """Also where nohup runs the tests."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def interrupted(recording: Path, out: Path, number: signal.Signals, *flags: str) -> int:
    """Start a run in a process of its own, send it a signal after 40 frames; its exit code."""
    argv = [sys.executable, "-m", "dsmap.tools.cli", "map", str(recording), "--out", str(out), *FLAGS, *flags]
    with subprocess.Popen(
        argv, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, preexec_fn=_hears_hangups
    ) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if "frame 40" in line:
                process.send_signal(number)
                break
        process.stderr.read()
    return process.returncode


def test_killed_and_resumed_equals_straight(recording, straight, tmp_path, capsys):
    out = tmp_path / "run"
    assert interrupted(recording, out, signal.SIGKILL, "--checkpoint-every", "3") == -signal.SIGKILL
    done = len(load_run(out).times)
    assert done >= 39 and done % 3 == 0, "what was written before the kill is whole"
    left = out / ".checkpoint.99.tmp.safetensors"
    left.write_text("what the killed process was writing")
    assert run("map", [str(recording), "--out", str(out), "--resume"]) == 0
    assert f"going on at frame {done} of 84" in capsys.readouterr().out
    assert_same_runs(out, straight)
    assert not left.exists()
    stats = json.loads((out / "stats.json").read_text())
    assert stats["tracking"] == json.loads((straight / "stats.json").read_text())["tracking"]
    assert stats["tracking"]["skipped_frames"] == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_stopped_and_resumed_equals_straight(recording, straight, tmp_path, number):
    out = tmp_path / "run"
    assert interrupted(recording, out, number) == 128 + number
    assert len(load_run(out).times) < 84 and (out / "map.ply").exists()
    assert run("map", ["--out", str(out), "--resume", "--pictures"]) == 0, "the run knows its recording"
    assert_same_runs(out, straight)
    assert (out / "pictures" / "trajectory.png").exists()


def test_a_part_goes_on_further(recording, straight, tmp_path):
    out = tmp_path / "run"
    assert run("map", [str(recording), "--out", str(out), *FLAGS, "--stop", "30"]) == 0
    assert run("map", [str(recording), "--out", str(out), "--resume", "--stop", "84"]) == 0
    assert_same_runs(out, straight)
    before = tensors(out)
    assert run("map", [str(recording), "--out", str(out), "--resume"]) == 0, "nothing left to do"
    for name, array in tensors(out).items():
        np.testing.assert_array_equal(before[name], array, err_msg=name)


def test_what_does_not_fit_is_refused(recording, straight, tmp_path, capsys):
    def refused(*argv: str) -> str:
        assert run("map", list(argv)) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        return error

    out, other = str(straight), record(tmp_path / "other")
    assert "--depth-max is 4.0, but" in refused(str(recording), "--out", out, "--resume", "--depth-max", "4")
    assert "--track.w-rgb is 0.3, but" in refused(
        str(recording), "--out", out, "--resume", "--track.w-rgb", "0.3"
    )
    assert "its stamps are not those" in refused(str(other), "--out", out, "--resume")
    assert "no such file or folder" in refused(str(recording), "--out", str(tmp_path / "no"), "--resume")
    (tmp_path / "early").mkdir()
    assert "first checkpoint" in refused(str(recording), "--out", str(tmp_path / "early"), "--resume")
    assert "--localize-in" in refused(str(recording), "--out", str(tmp_path / "new"), "--extend", *FLAGS)
    looped = ["--localize-in", out, "--out", str(tmp_path / "new"), *FLAGS]
    assert "--poses given" in refused(str(recording), *looped, "--poses", "given")
    assert "--loops off" in refused(str(recording), *looped, "--loops", "off")
    assert "--checkpoint-every" in refused(
        str(recording), "--out", str(tmp_path / "new"), "--checkpoint-every=-1"
    )
    assert not (tmp_path / "new").exists()


def record_steps(path: Path, steps) -> Path:
    """A recording of the closed room from the poses at `steps`."""
    with SequenceWriter(path, loop_room.INTRINSICS, 5000.0, depth_max=6.0) as writer:
        for i, step in enumerate(steps):
            f = loop_room.frame(i, step)
            writer.write(i / 30, f.rgb, f.depth, T_world_camera=f.T_world_camera)
    return path


def test_a_second_recording_in_the_map_of_the_first(tmp_path, capsys):
    first, second = (
        record_steps(tmp_path / "a", range(40)),
        record_steps(tmp_path / "b", np.arange(30, 12, -0.7)),
    )
    plain = ["--segmenter", "none", "--device", "cpu", "--no-pictures"]
    there = tmp_path / "map"
    assert run("map", [str(first), "--out", str(there), *plain]) == 0
    saved = (there / "checkpoint.safetensors").read_bytes()
    for name, more in (("in", []), ("on", ["--extend"])):
        out = tmp_path / name
        assert run("map", [str(second), "--out", str(out), "--localize-in", str(there), *more, *plain]) == 0
        again = load_run(out)
        assert len(again.times) == len(np.loadtxt(out / "trajectory.txt")) == 26
        assert again.tracked.mean() > 0.9
        assert run("evaluate", [str(out), "--reference", str(second)]) == 0
        printed = capsys.readouterr().out
        assert (
            "surfels" in printed
            and json.loads((out / "metrics.json").read_text())["trajectory"]["ate_rmse_m"] < 0.02
        )
    old, kept, grown = (tensors(tmp_path / name)["weight"] for name in ("map", "in", "on"))
    assert len(kept) == len(old) and (kept == old).all()
    assert (grown >= 10).sum() > 1.05 * (old >= 10).sum(), "what was seen again has been confirmed"
    assert (there / "checkpoint.safetensors").read_bytes() == saved, "the saved map itself is only read"


def test_an_extended_map_resumes_too(tmp_path):
    first, second = record_steps(tmp_path / "a", range(20)), record_steps(tmp_path / "b", range(15, 35))
    plain = ["--segmenter", "none", "--device", "cpu", "--no-pictures"]
    assert run("map", [str(first), "--out", str(tmp_path / "map"), *plain]) == 0
    extend = ["--localize-in", str(tmp_path / "map"), "--extend", *plain]
    assert run("map", [str(second), "--out", str(tmp_path / "whole"), *extend]) == 0
    assert run("map", [str(second), "--out", str(tmp_path / "parts"), *extend, "--stop", "9"]) == 0
    assert run("map", [str(second), "--out", str(tmp_path / "parts"), "--resume", "--stop", "20"]) == 0
    assert_same_runs(tmp_path / "whole", tmp_path / "parts")
