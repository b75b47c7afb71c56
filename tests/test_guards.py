"""Nothing changes when code only moves: maps, trajectories and rooms bit for bit; what earlier versions wrote opens."""

import os
import subprocess
import sys

import guards
import numpy as np
import pytest
from guards import ALL_FRAMES, MAPS, OLD_FRAMES, SEEDS

from dsmap.fusion.runs.read_run import load_run
from dsmap.sim_scenes.rooms.build import SCENES
from dsmap.tools.cli import run


@pytest.fixture
def stated():
    """Stated hashes, where they hold."""
    stated = guards.stated()
    if stated["machine"] != guards.machine():
        pytest.skip(f"the hashes were made on {stated['machine']}, this is {guards.machine()}")
    return stated


@pytest.mark.parametrize("name", ["labelled", "rolling", "given", "lost"])
def test_maps_are_the_same_bit_for_bit(stated, name):
    assert guards.hash_of_map(MAPS[name]()) == stated["maps"][name]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["loop", "moving"])
def test_long_maps_are_the_same_bit_for_bit(stated, name):
    assert guards.hash_of_map(MAPS[name]()) == stated["maps"][name]


@pytest.mark.parametrize("kind", ["bathroom", "corridor"])
def test_rooms_are_the_same_bit_for_bit(stated, kind):
    assert guards.hash_of_room(kind, SEEDS[0]) == stated["rooms"][f"{kind} {SEEDS[0]}"]


@pytest.mark.slow
@pytest.mark.parametrize("kind", SCENES)
def test_all_rooms_are_the_same_bit_for_bit(stated, kind):
    for seed in SEEDS:
        assert guards.hash_of_room(kind, seed) == stated["rooms"][f"{kind} {seed}"]


@pytest.mark.slow
def test_hashes_do_not_depend_on_the_number_of_threads():
    code = "import guards; print({n: guards.hash_of_map(make()) for n, make in guards.MAPS.items()})"
    answers = set()
    for threads in ("1", "2", "5"):
        names = ("DSMAP_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
        environment = {**os.environ, **dict.fromkeys(names, threads)}
        done = subprocess.run(
            [sys.executable, "-c", code],
            env=environment,
            cwd=guards.KEPT.parent,
            capture_output=True,
            text=True,
        )
        answers.add(done.stdout)
    assert len(answers) == 1 and "labelled" in answers.pop()


@pytest.fixture(scope="module")
def old_run(tmp_path_factory):
    """A RUN that dsmap 0.1 wrote before its files moved, and its recording."""
    folder = tmp_path_factory.mktemp("old")
    return guards.unpack_old_run(folder), guards.record_small(folder / "recording")


def test_an_old_run_opens_in_view_and_evaluate(old_run, tmp_path):
    path, recording = old_run
    assert len(load_run(path).times) == OLD_FRAMES
    assert run("view", [str(path), "--png", str(tmp_path / "pictures")]) == 0
    assert (tmp_path / "pictures" / "map_colour.png").exists()
    assert run("evaluate", [str(path), "--reference", str(recording)]) == 0


def test_an_old_checkpoint_resumes(old_run, tmp_path):
    path, recording = old_run
    argv = ["--out", str(path), "--resume", "--stop", str(ALL_FRAMES)]
    assert run("map", [str(recording), *argv]) == 0
    later = load_run(path)
    assert len(later.times) == ALL_FRAMES and later.tracked.all()
    new = tmp_path / "new"
    flags = ["--segmenter", "labels", "--label-noise", "0.2", "--device", "cpu", "--no-pictures"]
    assert run("map", [str(recording), "--out", str(new), *flags]) == 0
    # Its first frames were rounded by an earlier dsmap: a pixel more within a gate is 0.4 mm to so small a camera.
    np.testing.assert_allclose(later.poses, load_run(new).poses, atol=1e-3)


def test_shipped_weights_load():
    pytest.importorskip("torch")
    from dsmap.dsnet.checkpoint import SHIPPED, load_weights

    for name in [name for name, path in SHIPPED.items() if path.exists()]:
        model, _ = load_weights(name, None)
        assert sum(p.numel() for p in model.parameters()) > 1000
