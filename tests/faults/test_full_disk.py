"""Every write fails once, at every point: nothing that was whole is damaged, and what is missing is said."""

import collections
import itertools
import json
import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest
from corner_frames import FRAMES, config, record
from faulty_disk import FAULTS, FaultyDisk
from safetensors.numpy import load_file

from dsmap.errors import InputWarning, WriteError
from dsmap.fusion.labels.semantics import GroundTruthSegmenter
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.runs import map_recording
from dsmap.fusion.runs.run_folder import save_run
from dsmap.sequences import open_sequence
from dsmap.tensor_files import write_tensors
from dsmap.tools.cli import run
from dsmap.tools.twins.corner import INTRINSICS


def contents(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.fixture(scope="module")
def two_runs(tmp_path_factory) -> tuple[Mapper, Path, Path]:
    """A mapper, the folder of an earlier run of it, and that of now."""
    folder = tmp_path_factory.mktemp("runs")
    mapper = Mapper(config(poses="given"), INTRINSICS, GroundTruthSegmenter())
    for name, frames in (("old", FRAMES[:1]), ("new", FRAMES[1:3])):
        for frame in frames:
            mapper.step(frame)
        save_run(mapper, folder / name)
    return mapper, folder / "old", folder / "new"


@pytest.mark.parametrize("stays", [False, True])
@pytest.mark.parametrize("kind", FAULTS)
def test_each_file_of_a_run_is_the_old_one_or_the_new_one(two_runs, tmp_path, kind, stays):
    mapper, old, new = two_runs
    before, after = contents(old), contents(new)
    for at in itertools.count(1):
        target = tmp_path / str(at)
        shutil.copytree(old, target)
        disk = FaultyDisk(target, at, kind, stays)
        with disk.in_use():
            try:
                save_run(mapper, target)
            except WriteError as error:
                missing = set(error.files)
            else:
                break
        found = contents(target)
        assert found.keys() == before.keys(), "nothing half-written is left"
        stale = {name for name in found if found[name] != after[name]}
        assert stale <= missing and all(found[name] == before[name] for name in missing), disk.failed
        assert len(missing) == 1 or stays
    assert at > 20, "every write had its turn"


def test_tensors_are_read_back_as_they_were(tmp_path):
    rng = np.random.default_rng(0)
    arrays = {
        "bytes": np.arange(3, dtype=np.uint8), "wide": rng.normal(size=(2, 3)), "empty": np.zeros((0, 4), np.float32),
        "turned": rng.normal(size=(3, 5)).astype(np.float32).T, "flags": np.array([True, False]),
        "number": np.array(7, np.int64), "half": np.ones(3, np.float16),
    }  # fmt: skip
    write_tensors(tmp_path / "a.safetensors", arrays, {"format": "é"})
    found = load_file(tmp_path / "a.safetensors")
    assert found.keys() == arrays.keys()
    for name, array in arrays.items():
        assert found[name].dtype == array.dtype and found[name].shape == array.shape
        np.testing.assert_array_equal(found[name], array)


def test_a_failed_checkpoint_is_warned_of_and_mapping_goes_on(tmp_path):
    sequence = open_sequence(record(tmp_path / "room"), stop=8)
    tried = []

    def save(state: map_recording.RunState) -> None:
        tried.append(state.done)
        raise WriteError("cannot write it: No space left on device")

    state = map_recording.RunState(Mapper(config(), sequence.intrinsics), save)
    with pytest.warns(InputWarning, match="no checkpoint after frame 6 .*No space left.*goes on"):
        assert map_recording.map_recording(state, sequence, checkpoint_every=3) == 0
    assert tried == [6] and state.done == 8 and state.mapper.tracked_frames == 8, (
        "no checkpoint of a start in doubt"
    )


@pytest.mark.slow
def test_a_command_whose_nth_write_fails_can_be_resumed(tmp_path, capsys):
    recording = record(tmp_path / "room", repeat=2)  # 56 frames
    flags = [
        "--segmenter",
        "labels",
        "--device",
        "cpu",
        "--no-pictures",
        "--size",
        "64x48",
        "--stop",
        "40",
        "--checkpoint-every",
        "10",
    ]

    def mapped(out: Path, *more: str) -> int:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", InputWarning)
            return run("map", [str(recording), "--out", str(out), *flags, *more])

    straight = FaultyDisk(tmp_path / "straight")
    with straight.in_use():
        assert mapped(tmp_path / "straight") == 0
    assert straight.count > 60
    whole = contents(tmp_path / "straight")
    codes = collections.Counter()
    for at in range(1, straight.count + 1):
        out = tmp_path / "run"
        shutil.rmtree(out, ignore_errors=True)
        disk = FaultyDisk(out, at, list(FAULTS)[at % 3])
        capsys.readouterr()
        with disk.in_use():
            code = mapped(out)
        said = capsys.readouterr().err
        assert "Traceback" not in said and disk.failed, at
        if code:
            assert code == 2 and ("not written" in said or "cannot be written" in said), (at, said)
            assert not [name for name in contents(out) if ".tmp" in name] if out.exists() else True
        again = ["--resume"] if (out / "checkpoint.safetensors").exists() else ["--overwrite"]
        assert mapped(out, *again) == 0, (at, disk.failed)
        ours = contents(out)
        same = {
            "map.ply",
            "labels.ply",
            "trajectory.txt",
            "trajectory_status.txt",
            "loops.json",
            "classes.json",
        }
        assert {n for n in ours if ours[n] != whole[n]} <= set(whole) - same, (at, disk.failed)
        ours_stats, theirs = (json.loads(c["stats.json"])["tracking"] for c in (ours, whole))
        assert ours_stats == theirs
        codes[code] += 1
    print(
        f"{straight.count} writes, each failed once; exit codes {dict(codes)}; all equal after they went on"
    )
