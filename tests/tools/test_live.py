"""`dsmap live`: the newest frame is mapped, the page gets differences, whoever asks is heard; nothing waits."""

import shutil
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from browser import browser, free_port, wait
from corner_frames import FRAMES, config, record

from dsmap.errors import InputError
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.runs.map_live import Controls, map_live
from dsmap.fusion.runs.newest_frame import NewestFrame
from dsmap.fusion.runs.read_run import load_run
from dsmap.fusion.runs.replay import Replay
from dsmap.sequences import open_sequence
from dsmap.tools import cli
from dsmap.tools.live.shown_map import SHOWN_CELL_M, ShownMap, ShownPoints
from dsmap.tools.twins.corner import INTRINSICS


def points(count: int, seed: int = 0, spread: float = 1.0, label: int = 1) -> ShownPoints:
    rng = np.random.default_rng(seed)
    position = rng.uniform(-spread, spread, (count, 3)).astype(np.float32)
    return ShownPoints(
        position, rng.integers(0, 255, (count, 3), dtype=np.uint8), np.full(count, label, np.uint8)
    )


def everything(shown: ShownMap) -> np.ndarray:
    return np.concatenate([part.position for part in shown.chunks.values()])


def test_a_cell_holds_its_newest_point():
    shown = ShownMap()
    old, new = points(500), points(500, label=2)
    shown.add(old)
    shown.add(new)
    keys = {tuple(k) for k in np.floor(old.position / SHOWN_CELL_M).astype(int).tolist()}
    assert len(shown) == len(keys)
    assert all((part.label == 2).all() for part in shown.chunks.values())


def test_what_is_taken_is_bounded_and_nothing_is_lost():
    shown, page = ShownMap(), {}
    for k in range(6):
        shown.add(points(3000, seed=k))
        before = sum(shown.changed.values())
        for chunk, part in shown.take(2000):
            page[chunk] = part
        assert sum(shown.changed.values()) < before
    while shown.changed:
        taken = shown.take(2000)
        assert sum(len(part or ()) for _, part in taken[:-1]) < 2000, "the last one may go over it"
        page.update(taken)
    sent = np.concatenate([part.position for part in page.values()])
    assert np.array_equal(np.unique(sent, axis=0), np.unique(everything(shown), axis=0))


def test_the_whole_map_replaces_what_is_gone():
    shown = ShownMap()
    shown.add(points(2000))
    shown.take(10**9)
    kept = points(2000)
    near = ShownPoints(*(a[kept.position[:, 0] < 0.3] for a in (kept.position, kept.colour, kept.label)))
    shown.replace(near)
    assert (
        np.array_equal(np.unique(everything(shown), axis=0), np.unique(near.position, axis=0))
        or len(shown) < 2000
    )
    taken = dict(shown.take(10**9))
    gone = [chunk for chunk in taken if chunk not in shown.chunks]
    assert gone and all(taken[chunk] is None for chunk in gone)
    assert all(chunk[0] >= -1 for chunk in taken), "chunks that stayed the same are not sent"
    shown.replace(near)
    assert not shown.changed, "nothing changed"


def test_too_many_points_make_larger_cells():
    shown = ShownMap(most=2000)
    shown.add(points(20_000, spread=0.3))
    assert len(shown) <= 2000 and shown.cell > SHOWN_CELL_M
    assert set(shown.changed) == set(shown.chunks)


def test_the_newest_frame_is_taken():
    given, more = threading.Event(), threading.Event()

    def camera():
        yield from FRAMES[:4]
        given.set()
        more.wait(10)
        yield FRAMES[4]
        raise InputError("unplugged")

    newest = NewestFrame(camera())
    assert given.wait(10)
    arrived = newest.take(1)
    assert arrived is not None and arrived.frame is FRAMES[3] and newest.dropped == 3
    assert newest.take(0) is None and not newest.ended
    more.set()
    assert newest.take(10).frame is FRAMES[4]  # type: ignore[union-attr]
    with pytest.raises(InputError, match="unplugged"):
        newest.take(10)


def test_a_recording_comes_at_its_own_speed(tmp_path, monkeypatch):
    clock = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: clock[0])
    monkeypatch.setattr("dsmap.fusion.runs.replay.time.sleep", lambda s: clock.__setitem__(0, clock[0] + s))
    sequence = open_sequence(record(tmp_path / "corner"))
    seen = []
    for frame in Replay(sequence, 2.0).frames():
        seen.append((frame.time, clock[0] - 100))
        clock[0] += 0.005  # somebody looks at it
    stamps, times = np.array(seen).T
    assert len(seen) == len(FRAMES) and np.allclose(times, stamps / 2, atol=1e-6)


def test_what_is_overdue_is_not_even_decoded(tmp_path, monkeypatch):
    clock = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: clock[0])
    monkeypatch.setattr("dsmap.fusion.runs.replay.time.sleep", lambda s: clock.__setitem__(0, clock[0] + s))
    sequence = open_sequence(record(tmp_path / "corner"))
    decode, decoded = sequence.frame, []

    def slow(i):
        decoded.append(i)
        clock[0] += 0.075  # three frames' time at 30 Hz
        return decode(i)

    monkeypatch.setattr(sequence, "frame", slow)
    replay = Replay(sequence)
    ages = [clock[0] - replay.seen_at(frame) for frame in replay.frames()]
    assert max(ages) <= 0.075 + 1 / 30 + 1e-6, "it does not fall behind"
    assert len(ages) + replay.left_out == len(FRAMES) and replay.left_out >= 7
    assert decoded[0] == 0 and decoded == sorted(set(decoded))


class _Slow:
    """Gives each frame when the last one was mapped."""

    def __init__(self):
        self.mapped = threading.Semaphore(1)

    def frames(self):
        for frame in FRAMES:
            self.mapped.acquire(timeout=60)
            yield frame


def test_live_maps_as_map_does_and_obeys():
    mapper, camera, controls, saved = Mapper(config(device="cpu"), INTRINSICS), _Slow(), Controls(), []

    def watch(moment):
        if mapper.time == 5:
            controls.save.set()
        camera.mapped.release()

    newest = NewestFrame(camera.frames())
    assert map_live(mapper, newest, controls, watch, lambda: saved.append(mapper.time)) == len(FRAMES)
    assert saved == [5]
    straight = Mapper(config(device="cpu"), INTRINSICS)
    for frame in FRAMES:
        straight.step(frame)
    assert np.array_equal(straight.trajectory.poses, mapper.trajectory.poses)


def test_stop_ends_it():
    mapper, camera, controls = Mapper(config(device="cpu"), INTRINSICS), _Slow(), Controls()

    def watch(moment):
        if mapper.time == 3:
            controls.stop.set()
        camera.mapped.release()

    assert map_live(mapper, NewestFrame(camera.frames()), controls, watch, lambda: None) == 3


def test_the_command_writes_a_run(tmp_path, capsys):
    path, out = record(tmp_path / "corner"), tmp_path / "run"
    argv = ["--replay", str(path), "--out", str(out), "--no-view", "--device", "cpu", "--segmenter", "labels"]
    assert cli.run("live", [*argv, "--speed", "0.5"]) == 0
    run = load_run(out)
    assert 1 <= len(run.times) <= len(FRAMES) and run.tracked.any() and run.surfels.count > 1000
    assert run.settings["sequence"]["path"] == str(path)
    said = capsys.readouterr().out
    assert "dropped" in said and f"written to {out}" in said
    assert cli.run("live", argv) == 2, "it is there already"


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        ([], "expected one source"),
        (["realsense", "--replay", "x"], "expected one source"),
        (["webcam"], "webcam: no such source"),
        (["nowhere:camera"], "nowhere:camera cannot be loaded"),
        (["dsmap.fusion.runs.map_live:Controls"], "returned Controls; expected something with `intrinsics`"),
        (["record3d", "--poses", "given"], "expected --poses track"),
        (["record3d", "--size", "64x48"], "--size is for --replay"),
    ],
)
def test_wrong_sources_are_one_sentence(tmp_path, capsys, argv, message):
    assert cli.run("live", [*argv, "--out", str(tmp_path / "run"), "--no-view"]) == 2
    said = capsys.readouterr().err
    assert message in said and said.count("\n") == 1


def test_the_page_shows_the_map_without_holding_it_up(tmp_path):
    pytest.importorskip("viser")
    from dsmap.tools.live import page as live_page

    controls = Controls()
    page = live_page.LivePage("127.0.0.1", free_port(), "test", controls)
    try:
        mapper, camera = Mapper(config(device="cpu"), INTRINSICS), _Slow()

        def watch(moment):
            page.show(mapper, moment)
            page._idle.wait(30)
            page._last = 0.0  # whatever the clock says
            camera.mapped.release()

        map_live(mapper, NewestFrame(camera.frames()), controls, watch, lambda: None)
        assert page.updates == len(FRAMES) == len(page.delays)
        assert len(page._shown) > 1000 and page._nodes.keys() <= page._shown.chunks.keys()
        assert f"frame {FRAMES[-1].index}: tracked" in page._figures.content
    finally:
        page.close()


@pytest.mark.slow
def test_live_in_a_headless_browser(tmp_path):
    """Two pages at once, one of them opened anew; updates come, buttons work, the run is written."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        pytest.skip("no chromium on this machine (Debian: apt-get install chromium)")
    pytest.importorskip("viser")
    from dsmap.tools.live.page import LivePage

    controls, mapper = Controls(), Mapper(config(device="cpu"), INTRINSICS)
    page = LivePage("127.0.0.1", free_port(), "test", controls)

    def camera():
        for k in range(100_000):
            frame = FRAMES[k % 14] if k // 14 % 2 == 0 else FRAMES[13 - k % 14]
            time.sleep(1 / 30)
            yield frame

    frames = NewestFrame(camera())
    work = threading.Thread(
        target=map_live, args=(mapper, frames, controls, lambda m: page.show(mapper, m), lambda: None)
    )
    work.start()
    try:
        with browser(chromium, _new(tmp_path / "one"), page.address) as first:
            wait(lambda: "tracked" in first.text() or None)
            with browser(chromium, _new(tmp_path / "two"), page.address) as second:
                wait(lambda: "tracked" in second.text() or None)
            before = page.updates
            wait(lambda: page.updates > before + 5 or None)
            with browser(chromium, _new(tmp_path / "three"), page.address) as again:
                wait(lambda: "tracked" in again.text() or None)
                again.press("Stop")
                wait(lambda: controls.stop.is_set() or None)
    finally:
        controls.stop.set()
        work.join(30)
        page.close()
    assert not work.is_alive() and mapper.tracked_frames > 10


def _new(folder: Path) -> Path:
    folder.mkdir()
    return folder
