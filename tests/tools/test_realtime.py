"""`dsmap map --realtime`: a recording at its own speed, as a user calls it."""

import json
from pathlib import Path

import pytest
from corner_frames import FRAMES, record

from dsmap.fusion.runs.map_realtime import size_that_keeps_up
from dsmap.fusion.runs.read_run import load_run
from dsmap.sequences import open_sequence
from dsmap.tools.cli import run

FLAGS = ["--segmenter", "labels", "--device", "cpu", "--no-pictures", "--realtime"]


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    """14 frames, one of them damaged."""
    path = record(tmp_path_factory.mktemp("realtime") / "corner")
    damaged = sorted((path / "depth").iterdir())[9]
    damaged.write_bytes(damaged.read_bytes()[:100])
    return path


def test_every_frame_is_mapped_or_counted_as_dropped(recording, tmp_path, capsys):
    out = tmp_path / "run"
    with pytest.warns(Warning, match="left out"):
        assert run("map", [str(recording), "--out", str(out), *FLAGS]) == 0
    stats, said = json.loads((out / "stats.json").read_text()), capsys.readouterr().out
    told = stats["realtime"]
    assert told["mapped_frames"] + told["dropped_frames"] == len(FRAMES) - 1
    assert stats["tracking"]["skipped_frames"] == 1
    assert stats["map"]["frames"] == told["mapped_frames"] == len(load_run(out).times)
    assert told["latency_ms"]["median"] <= told["latency_ms"]["p95"]
    assert told["size"] == [96, 72] and told["labelled_frames"] >= 1
    assert "latency " in said and "chosen: 96x72" in said


def test_what_it_dropped_cannot_be_gone_on_with(recording, tmp_path, capsys):
    out = tmp_path / "run"
    for flags in (["--checkpoint-every", "5"], []):
        if not flags:
            with pytest.warns(Warning, match="left out"):
                run("map", [str(recording), "--out", str(out), *FLAGS])
            flags = ["--resume"]
        assert run("map", [str(recording), "--out", str(out), *FLAGS, *flags]) == 2
        assert "a camera does not wait" in capsys.readouterr().err


class _Clocked:
    """Stands for a machine on which a step takes a given time a pixel."""

    def __init__(self, ms_a_pixel: float):
        self.ms_a_pixel, self.seen = ms_a_pixel, []

    def __call__(self, mapper, frames) -> tuple[float, float]:
        sizes = [(frame.rgb.shape[1], frame.rgb.shape[0]) for frame, _ in zip(frames, range(2), strict=False)]
        self.seen.append(sizes[0])
        assert mapper.config.labels.every > 0, "labels are tried, too"
        return sizes[0][0] * sizes[0][1] * self.ms_a_pixel / 1e3, 0.0


@pytest.mark.parametrize(
    "ms_a_pixel, expected", [(1e-5, (640, 480)), (1.6e-4, (480, 360)), (1.0, (320, 240))]
)
def test_the_size_is_what_the_machine_can_do(recording, monkeypatch, ms_a_pixel, expected):
    from dsmap.fusion.config import MapConfig

    large, machine = open_sequence(recording).resized((640, 480)), _Clocked(ms_a_pixel)
    monkeypatch.setattr("dsmap.fusion.runs.map_realtime.trial", machine)
    assert size_that_keeps_up(large, MapConfig(depth_max=6.0), None) == expected
    assert machine.seen == [(640, 480), (480, 360)][: len(machine.seen)]
