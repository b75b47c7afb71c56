"""Data sets of many scenes: planned, rendered by processes, resumed after a killed worker, described."""

import json
import os
import signal
import threading
from dataclasses import asdict
from multiprocessing import active_children
from pathlib import Path

import numpy as np
import pytest

from dsmap.classes import NUM_CLASSES
from dsmap.errors import InputError, InputWarning
from dsmap.sequences import open_sequence
from dsmap.sim_scenes.recording.dataset import (
    Task,
    kind_of,
    plan,
    remove_partials,
    run_local,
    run_ray,
    unfinished,
)
from dsmap.sim_scenes.recording.dataset_card import shares, write_card
from dsmap.sim_scenes.recording.record import RenderOptions
from dsmap.sim_scenes.rooms.build import MIX
from dsmap.tools import cli

TINY = RenderOptions(scene="mix", seed=40, frames=2, width=64, height=48, path="views")


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below a folder by its relative name."""
    return {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}


def test_a_longer_plan_begins_like_a_shorter_one(tmp_path: Path) -> None:
    short, long = plan(tmp_path, TINY, 5), plan(tmp_path, TINY, 60)
    assert long[:5] == short
    assert len({task.folder for task in long}) == 60
    assert {task.options.scene for task in plan(tmp_path, TINY, 300)} == set(MIX)
    with pytest.raises(InputError, match="count is 0"):
        plan(tmp_path, TINY, 0)


def test_the_mix_has_its_shares() -> None:
    kinds = [kind_of(seed) for seed in range(2000)]
    total = sum(MIX.values())
    for kind, share in MIX.items():
        assert kinds.count(kind) / 2000 == pytest.approx(share / total, abs=0.04)


def _kill_first_worker(out: Path, killed: list[int], stop: threading.Event) -> None:
    """Kill a worker process once one of them is in the middle of a scene."""
    while not stop.wait(0.005):
        if any(out.glob(".*.part/rgb/*.png")) and active_children():
            pid = active_children()[0].pid
            assert pid is not None
            os.kill(pid, signal.SIGKILL)
            killed.append(pid)
            return


@pytest.mark.slow
def test_a_killed_worker_costs_nothing_but_its_own_scene(tmp_path: Path) -> None:
    # One kind of room, so that the two data sets take seconds; single worker, so that the victim is at work.
    base = RenderOptions(scene="bedroom", seed=40, frames=3, width=64, height=48, path="views")
    tasks, killed, stop, done = plan(tmp_path / "set", base, 2), [], threading.Event(), []
    (tmp_path / "set").mkdir()
    hunter = threading.Thread(target=_kill_first_worker, args=(tmp_path / "set", killed, stop))
    hunter.start()
    try:
        run_local(tasks, 1, done.append)
    finally:
        stop.set()
        hunter.join()
    assert killed, "no worker was caught at work"
    assert sorted(done) == [task.folder for task in tasks]
    assert not list((tmp_path / "set").glob(".*")), "a partial scene was left behind"
    assert unfinished(tasks) == []
    for task in tasks:
        assert len(open_sequence(task.folder)) == 3

    pixels = write_card(tmp_path / "set", tasks, "dsmap render-scene")
    assert pixels.sum() == 2 * 3 * 64 * 48
    label = np.concatenate([f.label for t in tasks for f in open_sequence(t.folder) if f.label is not None])
    np.testing.assert_array_equal(pixels, np.bincount(label.ravel(), minlength=NUM_CLASSES))
    assert shares(pixels).sum() == pytest.approx(1)
    card = (tmp_path / "set/CARD.md").read_text()
    assert "6 labelled frames of 2 scenes, seeds 40 to 41" in card and "bedroom: 2 scenes" in card
    scenes = json.loads((tmp_path / "set/dataset.json").read_text())["scenes"]
    assert [scene["seed"] for scene in scenes] == [40, 41]

    # A rendered scene does not depend on which process made it, or when.
    again = plan(tmp_path / "again", base, 1)
    (tmp_path / "again").mkdir()
    run_local(again, 1, done.append)
    assert contents(again[0].folder) == contents(tasks[0].folder)


def test_a_folder_holds_one_kind_of_recording(tmp_path: Path) -> None:
    tasks = plan(tmp_path, TINY, 2)
    tasks[0].folder.mkdir()
    with pytest.raises(InputError, match=r"scene\.json: not readable"):
        unfinished(tasks)
    (tasks[0].folder / "scene.json").write_text(
        json.dumps({"options": {**vars(tasks[0].options), "frames": 9}})
    )
    with pytest.raises(InputError, match="frames is 9, expected 2"):
        unfinished(tasks)
    arguments = [str(tmp_path), "--scene", "mix", "--seed", "40", "--frames", "2", "--size", "64x48"]
    assert cli.run("render-scene", [*arguments, "--path", "views", "--count", "2"]) == 2
    assert cli.run("render-scene", arguments) == 2  # a mix needs a count


@pytest.mark.slow
def test_ray_renders_the_same_scenes(tmp_path: Path) -> None:
    pytest.importorskip("ray")
    base = RenderOptions(scene="bedroom", seed=40, frames=2, width=64, height=48, path="views")
    done: list[Path] = []
    run_ray(plan(tmp_path / "ray", base, 2), "local", done.append)
    (local,) = plan(tmp_path / "local", base, 1)
    (tmp_path / "local").mkdir()
    run_local([local], 1, done.append)
    assert len(done) == 3
    assert contents(tmp_path / "ray" / local.folder.name) == contents(local.folder)
    with pytest.raises(InputError, match="nobody answers there"):
        run_ray([Task(tmp_path / "x", base)], "127.0.0.1:1", done.append)


def whole_scene(folder: Path, options: RenderOptions) -> Path:
    """What a finished scene consists of, without a picture in it."""
    folder.mkdir(parents=True)
    for name in ("rgb", "depth", "label", "instance", "groundtruth"):
        lines = [f"{k}.0 {name}/{k}.png" for k in range(options.frames)]
        (folder / f"{name}.txt").write_text("\n".join(["# heading", *lines]) + "\n")
        for k in range(options.frames) if name != "groundtruth" else ():
            (folder / name).mkdir(exist_ok=True)
            (folder / name / f"{k}.png").write_text("picture")
    for name in ("calibration.yaml", "classes.json", "mesh.ply"):
        (folder / name).write_text("there")
    record = {key: value for key, value in asdict(options).items() if key != "jobs"}
    (folder / "scene.json").write_text(json.dumps({"options": record}))
    (folder / "pixels.json").write_text(json.dumps({"frames": options.frames, "pixels": [0] * 14}))
    return folder


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda f: (f / "calibration.yaml").unlink(), "calibration.yaml cannot be read"),
        (lambda f: (f / "mesh.ply").write_text(""), "mesh.ply is empty"),
        (lambda f: (f / "rgb" / "1.png").unlink(), "1.png cannot be read"),
        (lambda f: (f / "depth" / "0.png").write_text(""), "0.png is empty"),
        (lambda f: (f / "label.txt").write_text("0.0 label/0.png\n"), "label.txt has 1 lines for 2 frames"),
        (lambda f: (f / "pixels.json").write_text("{"), "damaged"),
        (lambda f: (f / "pixels.json").unlink(), "pixels.json cannot be read"),
    ],
)
def test_a_scene_that_is_not_whole_is_rendered_again(tmp_path: Path, damage, words: str) -> None:
    tasks = plan(tmp_path, TINY, 2)
    for task in tasks:
        whole_scene(task.folder, task.options)
    assert unfinished(tasks) == []
    damage(tasks[1].folder)
    with pytest.warns(InputWarning, match=f"not whole .*{words}.*rendered again"):
        assert unfinished(tasks) == [tasks[1]]


def test_what_killed_workers_left_is_removed(tmp_path: Path) -> None:
    for name in (".bedroom_000040.123.part", ".bedroom_000041.part", "bedroom_000042", ".cache"):
        (tmp_path / name).mkdir()
    remove_partials(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [".cache", "bedroom_000042"]
