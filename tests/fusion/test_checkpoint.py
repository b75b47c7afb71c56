"""A run that is saved and goes on in another mapper equals one that was never interrupted, bit for bit."""

import dataclasses
import json
import shutil

import loop_room
import numpy as np
import pytest
from corner_frames import FRAMES, config, frames
from loop_room import AWAY, DRIFT
from safetensors import safe_open
from safetensors.numpy import load_file, save_file

from dsmap.errors import InputError, InputWarning
from dsmap.frame import Frame
from dsmap.fusion.config import LabelConfig, MapConfig
from dsmap.fusion.labels.semantics import GroundTruthSegmenter
from dsmap.fusion.lie import inverse
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.runs.checkpoint import FORMAT, load_map, read_metadata, save_map
from dsmap.fusion.runs.resume import mapper_in_saved_map, resumed_mapper
from dsmap.fusion.runs.run_folder import save_run
from dsmap.tensor_files import write_tensors
from dsmap.tools.twins.corner import INTRINSICS


def everything(m: Mapper) -> dict[str, np.ndarray]:
    """All that a mapper holds, as arrays; milliseconds are left out."""
    state = m.state()
    plain = {name: value for name, value in state.items() if not isinstance(value, np.ndarray)}
    out = {n: a for n, a in state.items() if n not in plain and not n.startswith("clock.")}
    out |= {f"surfel.{name}": array for name, array in m.surfels.numpy().items()}
    out["trajectory"] = np.array([p.T_world_camera for p in m.trajectory])
    out["tracked"] = np.array([p.tracked for p in m.trajectory])
    out["plain"] = np.array(json.dumps(plain, sort_keys=True))
    return out


def assert_same(a: Mapper, b: Mapper) -> None:
    ours, theirs = everything(a), everything(b)
    assert ours.keys() == theirs.keys()
    for name in ours:
        np.testing.assert_array_equal(ours[name], theirs[name], err_msg=name)


def reborn(m: Mapper, path, segmenter=None) -> Mapper:
    """The mapper after a trip through a file."""
    save_map(m, path)
    surfels, meta = load_map(path)
    return resumed_mapper(surfels, meta, "checkpoint", m.intrinsics, segmenter)


@pytest.mark.parametrize("stop", [0, 1, 15, 17])
def test_goes_on_bit_for_bit(tmp_path, stop):
    """Noisy labels on keyframes, a dark frame before and after the stop at 17, unreadable frames."""
    labels = LabelConfig(rule="geometric", every=0, keyframe_distance=0.02)
    arc = frames(30)
    for i in (16, 17):
        arc[i] = Frame(i, arc[i].time, arc[i].rgb, 0 * arc[i].depth)

    def begin() -> Mapper:
        return Mapper(config(labels=labels), INTRINSICS, GroundTruthSegmenter(0.3))

    def go_on(m: Mapper, part: list[Frame]) -> None:
        for f in part:
            m.skip(f.time) if f.index == 9 else m.step(f)

    straight = begin()
    go_on(straight, arc)
    first = begin()
    go_on(first, arc[:stop])
    second = reborn(first, tmp_path / "map.safetensors", GroundTruthSegmenter(0.3))
    assert_same(first, second)
    go_on(second, arc[stop:])
    assert straight.tracked_frames == 27
    assert_same(straight, second)


@pytest.mark.parametrize("stop", [5, 40])
def test_goes_on_bit_for_bit_through_a_loop(tmp_path, stop):
    """Saved before and after a loop: keyframes, kept constraints, the active window and its trust come along."""

    def way_back(m: Mapper, first: int, last: int) -> None:
        for k in range(first, last):
            m.step(loop_room.frame(AWAY + k, AWAY - 1 - k))

    straight = loop_room.mapper()
    for step in range(AWAY):
        straight.step(loop_room.frame(step, step))
    loop_room.drift(straight, DRIFT, first=20)
    way_back(straight, 0, stop)
    second = reborn(straight, tmp_path / "map.safetensors")
    for m in (straight, second):
        way_back(m, stop, 46)
    assert straight.loops and len(straight.locator.recovery.ferns) > 3 and len(straight.closer.closed.points)
    assert_same(straight, second)


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """A map of a third of the room, and the mapper that made it."""
    m = loop_room.mapper()
    for step in range(40):
        m.step(loop_room.frame(step, step))
    path = tmp_path_factory.mktemp("saved") / "map.safetensors"
    save_map(m, path)
    return path, m


def start_in(path, frozen: bool) -> Mapper:
    return mapper_in_saved_map(*load_map(path), str(path), loop_room.INTRINSICS, frozen=frozen)


def errors(m: Mapper, steps) -> np.ndarray:
    """Distances [m] of the new frames from where the camera was, in the map's world."""
    T = [inverse(loop_room.pose(0)) @ loop_room.pose(s) for s in steps]
    points = m.trajectory[m.first_frame :]
    return np.array(
        [np.linalg.norm((inverse(t) @ p.T_world_camera)[:3, 3]) for t, p in zip(T, points, strict=True)]
    )


def test_localising_finds_the_camera_and_changes_nothing(saved):
    path, old = saved
    m = start_in(path, frozen=True)
    before = {name: array.copy() for name, array in m.surfels.numpy().items()}
    keyframes = len(m.locator.recovery.ferns)
    steps = [25.3 - 0.7 * i for i in range(20)]
    results = [m.step(loop_room.frame(i, s)) for i, s in enumerate(steps)]
    assert results[0].relocalised or results[1].relocalised
    found = np.array([r.tracked for r in results])
    assert found[2:].all() and errors(m, steps)[found].max() < 0.02
    assert m.surfels.count == old.surfels.count and len(m.locator.recovery.ferns) == keyframes
    for name, array in before.items():
        np.testing.assert_array_equal(array, m.surfels.numpy()[name], err_msg=name)


def test_localising_says_lost_where_the_map_ends(saved):
    m = start_in(saved[0], frozen=True)
    results = [m.step(loop_room.frame(i, 80)) for i in range(3)]
    assert not any(r.tracked for r in results) and "not found" in results[0].reason


def test_extending_goes_on_in_the_same_world(saved, tmp_path):
    path, old = saved
    m = start_in(path, frozen=False)
    steps = [30 + i for i in range(30)]
    results = [m.step(loop_room.frame(i, s)) for i, s in enumerate(steps)]
    found = np.array([r.tracked for r in results])
    assert found[2:].all() and errors(m, steps)[found].max() < 0.03
    assert m.first_frame == 40 and len(m.trajectory) == 70
    assert m.surfels.count > 1.2 * old.surfels.count and len(m.locator.recovery.ferns) > len(
        old.locator.recovery.ferns
    )
    save_run(m, tmp_path)
    times = np.loadtxt(tmp_path / "trajectory.txt")[:, 0]
    assert len(times) == 30 and times[0] == 0, "the trajectory is that of the new recording"
    assert_same(m, reborn(m, tmp_path / "again.safetensors"))


def test_maps_without_keyframes_and_other_cameras_are_refused(saved, tmp_path):
    m = Mapper(config(poses="given"), INTRINSICS)
    m.step(FRAMES[0])
    save_map(m, tmp_path / "map.safetensors")
    surfels, meta = load_map(tmp_path / "map.safetensors")
    with pytest.raises(InputError, match="no keyframes"):
        mapper_in_saved_map(surfels, meta, "there", INTRINSICS, config=config())
    surfels, meta = load_map(saved[0])
    wide = dataclasses.replace(loop_room.INTRINSICS, height=48)
    with pytest.raises(InputError, match="same aspect ratio"):
        mapper_in_saved_map(surfels, meta, "there", wide)


def rewritten(path, out, metadata=(), tensors=()):
    """A copy of a checkpoint with other metadata and tensors (None takes one out), and a checksum that fits."""
    with safe_open(path, framework="np") as file:
        old = file.metadata()
    texts = {k: v for k, v in (old | dict(metadata)).items() if v is not None}
    arrays = {k: v for k, v in (load_file(path) | dict(tensors)).items() if v is not None}
    write_tensors(out, arrays, texts)
    return out


def test_checksums_are_held_against_what_is_there(saved, tmp_path):
    path, whole = saved[0], saved[0].read_bytes()
    bad = tmp_path / "bad.safetensors"
    rng = np.random.default_rng(0)
    for at in rng.integers(8, len(whole), 30):  # a bit of header, words or tensors
        bad.write_bytes(whole[:at] + bytes([whole[at] ^ 1 << int(rng.integers(8))]) + whole[at + 1 :])
        with pytest.raises(InputError, match=r"bad\.safetensors"):
            load_map(bad)
    with safe_open(path, framework="np") as file:
        words = file.metadata()
    arrays = load_file(path)
    save_file(arrays, bad, metadata={k: v for k, v in words.items() if k != "checksum"})
    with pytest.raises(InputError, match="checksum is missing"):
        load_map(bad)
    older = {**words, "format": "dsmap.map/2"}
    del older["checksum"]
    save_file(arrays, bad, metadata=older)
    with pytest.warns(InputWarning, match="without a checksum"):
        assert load_map(bad)[0].count == len(arrays["position"])


def test_foreign_older_and_damaged_checkpoints_are_refused(saved, tmp_path):
    path = saved[0]
    cut = tmp_path / "cut.safetensors"
    cut.write_bytes(path.read_bytes()[:-1000])
    shutil.copy(path, tmp_path / "whole.safetensors")
    bad = [
        (cut, "damaged"),
        (rewritten(path, tmp_path / "a", {"format": "dsmap.map/1"}), f"'dsmap.map/1'; expected '{FORMAT}'"),
        (rewritten(path, tmp_path / "b", {"state": None}), "damaged metadata"),
        (rewritten(path, tmp_path / "c", {"config": "{"}), "damaged metadata"),
        (rewritten(path, tmp_path / "d", {"config": '{"depth_max": "far"}'}), "depth_max is 'far'"),
        (rewritten(path, tmp_path / "e", (), {"weight": None}), "tensors weight are missing"),
        (rewritten(path, tmp_path / "f", (), {"weight": np.zeros(3, np.float32)}), "weight has float32"),
        (rewritten(path, tmp_path / "g", (), {"label": np.zeros((3, 2), np.int64)}), "label has int64"),
    ]
    for file, message in bad:
        with pytest.raises(InputError, match=message):
            load_map(file)
    for name in ("state.ferns.codes", "state.view.normal", "state.T_world_camera", "state.closed.times"):
        surfels, meta = load_map(rewritten(path, tmp_path / "h", (), {name: None}))
        with pytest.raises(InputError, match="does not fit"):
            resumed_mapper(surfels, meta, "h", loop_room.INTRINSICS)
    older = rewritten(path, tmp_path / "i", {"config": '{"relocalise": {"once": 1}, "depth_max": 5.0}'})
    assert load_map(older)[1]["config"] == MapConfig(depth_max=5.0), "a parameter that is gone is passed over"
    assert read_metadata(tmp_path / "whole.safetensors")["time"] == 40
