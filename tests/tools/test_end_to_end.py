"""The commands as a user calls them, on a small ray-cast recording: outputs, errors, Ctrl-C."""

import json
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import shared_data
from corner_frames import FRAMES, record

from dsmap.fusion.runs.read_run import load_run
from dsmap.tools.cli import COMMANDS, run, usage

GUIDE = Path(__file__).parents[2] / "docs" / "guide" / "output.md"
MAP = ["--segmenter", "labels", "--device", "cpu"]


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    return record(tmp_path_factory.mktemp("recording") / "room")


def test_map_then_evaluate(recording, tmp_path, capsys):
    out = tmp_path / "run"
    assert run("map", [str(recording), "--out", str(out), "--save-probabilities", *MAP]) == 0
    files = {p.relative_to(out).as_posix() for p in out.rglob("*") if p.is_file()}
    expected = {
        *("map.ply", "labels.ply", "trajectory.txt", "config.yaml", "stats.json", "classes.json"),
        *("checkpoint.safetensors", "pictures/map_colour.png", "pictures/map_label.png"),
        *("pictures/map_confidence.png", "pictures/trajectory.png", "pictures/strip.png"),
    }
    assert expected <= files and not any(".tmp" in name for name in files)
    stats = json.loads((out / "stats.json").read_text())
    assert stats["tracking"]["tracked_fraction"] == 1.0 and stats["map"]["frames"] == len(FRAMES)
    assert stats["map"]["bytes_per_surfel"] is None or stats["map"]["surfels"] > 0
    assert len(np.loadtxt(out / "trajectory.txt")) == len(FRAMES)
    assert run("evaluate", [str(out), "--reference", str(recording)]) == 0
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["trajectory"]["ate_rmse_m"] < 0.01
    assert metrics["semantics"]["map_only"]["pixel_acc"] > 0.8
    assert metrics["surface"]["accuracy_mean_m"] is None and metrics["surface"]["reason"], (
        "this recording has no mesh"
    )
    assert "ATE" in capsys.readouterr().out.replace("ate", "ATE")


def test_an_existing_run_is_kept(recording, tmp_path, capsys):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "mine.txt").write_text("keep")
    assert run("map", [str(recording), "--out", str(tmp_path / "run"), *MAP]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert [p.name for p in (tmp_path / "run").iterdir()] == ["mine.txt"]


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--size", "wide"], "WIDTHxHEIGHT"),
        (["--intrinsics", "1,2,3"], "fx,fy,cx,cy"),
        (["--depth-max", "0.1"], "depth range"),
        (["--segment-every", "0"], "keyframes"),
        (["--segmenter", "magic"], "module:factory"),
        (["--segmenter", "nowhere:factory"], "cannot be loaded"),
        (["--label-noise", "7"], "expected 0 to 1"),
        (["--start", "99"], "no frame between"),
    ],
)
def test_wrong_flags_are_one_clear_sentence(recording, tmp_path, capsys, flags, message):
    argv = [str(recording), "--out", str(tmp_path / "run"), *MAP, *flags]
    assert run("map", argv) == 2
    error = capsys.readouterr().err
    assert message in error and "Traceback" not in error and error.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_an_unwritable_folder_is_noticed_before_mapping(recording, tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    assert run("map", [str(recording), "--out", str(tmp_path / "file" / "run"), *MAP]) == 2
    assert "cannot be written" in capsys.readouterr().err


def test_damaged_frames_are_skipped_and_counted(tmp_path, capsys):
    path = record(tmp_path / "room")
    depth = sorted((path / "depth").iterdir())
    depth[4].write_bytes(depth[4].read_bytes()[:200])
    depth[7].unlink()
    depth[-1].write_bytes(b"")
    out = tmp_path / "run"
    assert run("map", [str(path), "--out", str(out), "--no-pictures", *MAP]) == 0
    stats = json.loads((out / "stats.json").read_text())["tracking"]
    assert stats["skipped_frames"] == 3 and stats["lost_frames"] == 3
    assert len(np.loadtxt(out / "trajectory.txt")) == len(FRAMES), (
        "a skipped frame keeps its line, the last one, too"
    )
    assert depth[4].name in capsys.readouterr().out


def test_ctrl_c_leaves_a_whole_run(tmp_path):
    path, out = record(tmp_path / "room", repeat=40), tmp_path / "run"
    argv = [
        sys.executable,
        "-m",
        "dsmap.tools.cli",
        "map",
        str(path),
        "--out",
        str(out),
        *MAP,
        "--no-pictures",
    ]
    with subprocess.Popen(argv, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if "frame 20" in line:
                process.send_signal(signal.SIGINT)
                break
        rest = process.stderr.read()
    assert process.returncode == 130 and "Traceback" not in rest
    loaded = load_run(out)
    assert loaded is not None and 20 <= len(np.loadtxt(out / "trajectory.txt")) < 40 * 2 * len(FRAMES)


def test_the_program_explains_itself():
    text = usage()
    assert all(name in text for name in COMMANDS)
    program = [sys.executable, "-m", "dsmap.tools.cli"]
    assert text.index("\nuse:") < text.index("  map ") < text.index("\ndevelop:") < text.index("  bench ")
    unknown = subprocess.run([*program, "fly"], capture_output=True, text=True)
    assert unknown.returncode == 2 and "unknown command 'fly'" in unknown.stderr


@pytest.mark.parametrize("words", [["--help"], ["map", "--help"]])
def test_a_closed_pipe_ends_quietly(words):
    program = [sys.executable, "-m", "dsmap.tools.cli", *words]
    with subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == ""


def test_the_example_of_the_guide_runs(recording, tmp_path, monkeypatch):
    blocks = re.findall(r"```python\n(.*?)```", GUIDE.read_text(), flags=re.DOTALL)
    assert len(blocks) == 1
    monkeypatch.chdir(tmp_path)
    (tmp_path / "recording").symlink_to(recording)
    scope: dict = {}
    exec(blocks[0], scope)
    assert len(scope["positions"]) == len(scope["labels"]) == len(scope["probabilities"]) > 1000
    assert (tmp_path / "runs" / "mine" / "map.ply").exists()


@pytest.mark.slow
def test_fr1_is_tracked_whole(tmp_path):
    path = shared_data() / "tum_fr1_xyz_10s"
    out = tmp_path / "run"
    argv = [str(path), "--out", str(out), "--size", "320x240", "--segmenter", "none", "--no-pictures"]
    assert run("map", argv) == 0 and run("evaluate", [str(out), "--reference", str(path)]) == 0
    trajectory = json.loads((out / "metrics.json").read_text())["trajectory"]
    assert trajectory["tracked_fraction"] == 1.0
    assert trajectory["ate_rmse_m"] < 0.02, "Open3D's dense SLAM has 2.34 cm here"
