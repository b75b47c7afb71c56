"""`kill -9` at random moments, again and again until the work is done: the result is that of a run left alone.

DSMAP_KILLS=34 is the whole of it for each command; the moments are drawn from a fixed seed.
"""

import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from corner_frames import record
from safetensors.numpy import load_file
from tiny_training import coloured_rectangles, weights_hash

KILLS = int(os.environ.get("DSMAP_KILLS", "4"))
pytestmark = pytest.mark.slow


def dsmap(*words: str, **options) -> subprocess.Popen:
    command = [sys.executable, "-m", "dsmap.tools.entry", *words]
    return subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        **options,
    )


def members(session: int) -> list[int]:
    """Processes of a session that still run."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            found.append(int(stat.parent.name))
    return found


def left_alone(*words: str) -> float:
    """Run a command to its end; the seconds it took."""
    began = time.monotonic()
    process = dsmap(*words)
    error = process.communicate()[1]
    assert process.returncode == 0, error
    return time.monotonic() - began


def killed_until_done(
    command: Callable[[], list[str]], seconds: float, seed: int, out: Path
) -> tuple[int, int]:
    """Start a command, kill it, start it again, ...; after KILLS kills it may end. Returns kills and lives.

    Args:
        command: the words of the next start.
        seconds: how long it takes when left alone; a life is killed at a random moment of it.
        out: what is done when a life ends by itself before its time: it is begun again in another folder.
    """
    rng = np.random.default_rng(seed)
    kills = lives = 0
    while True:
        process, lives = dsmap(*command()), lives + 1
        session = process.pid
        life = rng.uniform(0, 1.1 * seconds) if kills < KILLS else None
        try:
            error = process.communicate(timeout=life)[1]
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.communicate()
            kills += 1
            wait_for_the_end_of(session)
            continue
        assert process.returncode == 0, error
        wait_for_the_end_of(session)  # Python's own helper ends a moment later
        if kills >= KILLS:
            return kills, lives
        out.rename(out.with_name(f"{out.name}-{lives}"))


def wait_for_the_end_of(session: int) -> None:
    for _ in range(600):
        if not members(session):
            return
        time.sleep(0.1)
    raise AssertionError(f"workers of {session} live on: {members(session)}")


def files(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def assert_same(folders: list[Path], straight: Path, but: Callable[[str], bool]) -> None:
    """Equal files, by name and content; those of `but` hold seconds and need only be there."""
    whole = files(straight)
    for folder in folders:
        found = files(folder)
        assert found.keys() == whole.keys(), "no file is left over or missing"
        assert not [name for name in whole if not but(name) and found[name] != whole[name]], folder


def test_map(tmp_path):
    recording = record(tmp_path / "room", repeat=2)
    flags = ["--segmenter", "labels", "--device", "cpu", "--no-pictures", "--checkpoint-every", "3"]
    seconds = left_alone("map", str(recording), "--out", str(tmp_path / "straight"), *flags)
    out = tmp_path / "run"

    def command() -> list[str]:
        again = "--resume" if (out / "checkpoint.safetensors").exists() else "--overwrite"
        return ["map", str(recording), "--out", str(out), *flags, again]

    print(killed_until_done(command, seconds, 1, out))
    runs = [out, *tmp_path.glob("run-*")]
    timed = ("stats.json", "config.yaml", "checkpoint.safetensors")
    assert_same(runs, tmp_path / "straight", lambda name: name in timed)
    ours, theirs = (load_file(f / "checkpoint.safetensors") for f in (out, tmp_path / "straight"))
    assert ours.keys() == theirs.keys()
    for name in ours:
        if not name.startswith("state.clock."):
            np.testing.assert_array_equal(ours[name], theirs[name], err_msg=name)


def test_train(tmp_path):
    pytest.importorskip("torch")
    data, val = coloured_rectangles(tmp_path / "data"), coloured_rectangles(tmp_path / "val", 2, 1)
    small = shlex.split("--steps 12 --batch 4 --size 64 64 --warmup 2 --ema 0.5 --validate-every 3 --no-log")
    net = shlex.split("--net.layers 2 --net.growth 4 --net.widths 8 8 8 8 --net.stem-convs 1")

    def command(out: Path) -> list[str]:
        more = ["--resume"] if (out / "checkpoint.safetensors").exists() else []
        return ["train", "--data", str(data), "--val", str(val), "--out", str(out), *small, *net, *more]

    seconds = left_alone(*command(tmp_path / "straight"))
    out = tmp_path / "run"
    print(killed_until_done(lambda: command(out), seconds, 2, out))
    for folder in (out, *tmp_path.glob("run-*")):
        assert files(folder).keys() == files(tmp_path / "straight").keys()
        assert weights_hash(folder / "best.safetensors") == weights_hash(
            tmp_path / "straight/best.safetensors"
        )


def test_render_scene(tmp_path):
    flags = shlex.split("--scene bedroom --count 3 --frames 2 --size 64x48 --path views --seed 40 --jobs 2")
    seconds = left_alone("render-scene", str(tmp_path / "straight"), *flags)
    out = tmp_path / "run"
    print(killed_until_done(lambda: ["render-scene", str(out), *flags], seconds, 3, out))
    named = ("CARD.md", "dataset.json")  # hold the command
    assert_same([out, *tmp_path.glob("run-*")], tmp_path / "straight", lambda name: name in named)
