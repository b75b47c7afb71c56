"""Configurations of data sets: complete, loadable by name and by file, flags before them, mistakes named."""

import dataclasses
import re
import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from dsmap.errors import InputError
from dsmap.fusion.config import MapConfig
from dsmap.tools.cli import run
from dsmap.tools.commands.map import parse
from dsmap.tools.mapping.help import FIRST, help_text
from dsmap.tools.mapping.options import Args, options_of, with_values
from dsmap.tools.mapping.presets import load_preset, preset_names

REPOSITORY = Path(__file__).parents[2]
PLAIN = Args(Path("SEQ"), Path("RUN"))
CALL = ["SEQ", "--out", "RUN"]


def parsed(*flags: str) -> Args:
    return parse([*CALL, *flags])


def test_the_shipped_default_configuration_is_the_one_that_is_written(tmp_path, capsys):
    assert run("map", ["--write-config", str(tmp_path / "default.yaml")]) == 0
    shipped = REPOSITORY / "tools" / "configs" / "default.yaml"
    assert (tmp_path / "default.yaml").read_text() == shipped.read_text(), (
        "after a change of parameters: dsmap map --write-config tools/configs/default.yaml --overwrite"
    )
    assert run("map", ["--write-config", str(tmp_path / "default.yaml")]) == 2
    assert "exists" in capsys.readouterr().err


def test_the_default_configuration_states_every_parameter():
    values = load_preset("default")
    assert set(values) >= {f.name for f in dataclasses.fields(MapConfig)} - {"device"}
    for name, own in vars(PLAIN.map).items():
        if dataclasses.is_dataclass(own):
            assert set(values[name]) == {f.name for f in dataclasses.fields(own)}, name
    assert with_values(PLAIN, values, "default") == PLAIN


def test_what_is_written_is_read_back(tmp_path):
    flags = ("--track.w-rgb", "0.3", "--loops", "off", "--label-noise", "0.2", "--size", "320x240")
    assert run("map", [*flags, "--config", "tum_fr1", f"--write-config={tmp_path / 'mine.yaml'}"]) == 0
    again = parsed("--config", str(tmp_path / "mine.yaml"))
    assert again == dataclasses.replace(parsed(*flags, "--config", "tum_fr1"), config=again.config)


def test_the_help_shows_every_option_once_and_each_stands_alone():
    heads = re.findall(r"^  (?:--[^ ]+ [^ ]+, )?(--[^ \n]+)", help_text(PLAIN), re.MULTILINE)
    expected = []
    for option in options_of(PLAIN):
        assert option.doc.endswith(".") and not option.doc.startswith("...") and option.doc[-3:] != "...", (
            option.name
        )
        group, dot, name = option.flag.removeprefix("--").rpartition(".")
        off = option.hint is bool and option.value
        expected.append(f"--{group}{dot}{'no-' if off else ''}{name}")
    expected.remove("--path")
    assert sorted(heads) == sorted(expected)
    assert heads[: len(FIRST)] == ["--" + name.replace("_", "-") for name in FIRST] and len(FIRST) == 10


@pytest.mark.parametrize(
    ("short", "long"),
    [
        (("--loops", "off"), ("--loops.mode", "off")),
        (
            ("--loop.mode=global", "--loop.max-drift", "0.1"),
            ("--loops.mode", "global", "--loops.max_drift=0.1"),
        ),
        (("--segment-every", "keyframes"), ("--labels.every", "0")),
        (("--segment_every=3", "--label-fusion", "mean"), ("--labels.every=3", "--labels.rule=mean")),
    ],
)
def test_short_and_older_flags_stand_for_the_long_ones(short, long):
    assert parsed(*short) == parsed(*long)


@pytest.mark.parametrize(
    ("older", "today"),
    [
        ("loop: {mode: off, retry: 4}", "loops: {mode: 'off', retry: 4}"),
        ("loop: {retry: 4}\nloops: off", "loops: {mode: off, retry: 4}"),
        ("loops: null\nlabel_fusion: null\nsegment_every: null", "extends: default"),
        ("label_fusion: bayes\nsegment_every: keyframes", "labels: {rule: bayes, every: 0}"),
    ],
)
def test_older_files_are_read(tmp_path, older, today):
    (tmp_path / "older.yaml").write_text(older)
    (tmp_path / "today.yaml").write_text(today)
    old, new = (parsed("--config", str(tmp_path / f"{name}.yaml")) for name in ("older", "today"))
    assert old.map == new.map and old.spec == new.spec


@pytest.mark.parametrize("name", preset_names())
def test_every_configuration_loads(name):
    assert parsed("--config", name).config == name


def test_configurations_come_with_the_wheel():
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())
    assert "configs/*.yaml" in project["tool"]["setuptools"]["package-data"]["dsmap.tools"]
    assert {"default", "tum_fr1", "seven_scenes", "redwood_livingroom", "rendered"} <= set(preset_names())


def test_flags_come_before_the_file_and_the_file_before_defaults(tmp_path):
    base, own = tmp_path / "base.yaml", tmp_path / "own.yaml"
    base.write_text(
        "depth_max: 4\nloop: {mode: on}\ntrack: {w_rgb: 0.2, iterations: [3, 2, 1]}\nlabels: {every: 5}\n"
    )
    own.write_text("extends: base.yaml\ntrack: {max_rms: 0.01}\nloop: {mode: off}\n")
    args = parsed(f"--config={own}", "--track.w-rgb", "0.3")
    config = args.map
    assert config.depth_max == 4.0 and isinstance(config.depth_max, float)
    assert (config.track.w_rgb, config.track.max_rms, config.track.iterations) == (0.3, 0.01, (3, 2, 1))
    assert config.loops.mode == "off" and config.labels.every == 5
    assert config.surfels == PLAIN.map.surfels and parsed() == PLAIN


@pytest.mark.parametrize(
    ("flags", "calibrated", "expected"), [((), None, 4.0), ((), 8.0, 8.0), (("--depth-max", "2.5"), 8.0, 2.5)]
)
def test_depth_reaches_as_far_as_the_flag_the_calibration_or_a_kinect_says(flags, calibrated, expected):
    sequence: Any = SimpleNamespace(depth_max=calibrated, readout_s=0.01, frame_rate=None)
    assert parsed(*flags).map.resolved_for(sequence).depth_max == expected


def test_rows_are_read_as_fast_as_the_flag_or_the_calibration_says():
    sequence: Any = SimpleNamespace(depth_max=None, readout_s=0.026, frame_rate=None)
    assert parsed().map.resolved_for(sequence).readout_s == 0.026
    assert parsed("--readout-s", "0").map.resolved_for(sequence).readout_s == 0.0
    with pytest.raises(InputError, match="readout_s is 26.0; expected seconds"):
        parsed("--readout-s", "26").map.resolved_for(sequence)


@pytest.mark.parametrize(
    ("flags", "rate", "expected"),
    [
        ((), None, 10.0),
        ((), 60.0, 10.0),
        ((), 29.97, 10.0),
        ((), 15.0, 5.0),
        ((), 6.0, 2.0),
        ((), 1.0, 2.0),
        (("--surfels.stable-weight", "7"), 6.0, 7.0),
    ],
)
def test_surfels_are_stable_after_fewer_measurements_where_frames_are_fewer(flags, rate, expected):
    sequence: Any = SimpleNamespace(depth_max=None, readout_s=0.0, frame_rate=rate)
    config = parsed(*flags).map
    assert config.resolved_for(sequence).stable_weight == expected
    assert config.stable_weight == (7.0 if flags else 10.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("colour: 1", "unknown parameter 'colour'; expected one of"),
        ("track: {w_rbg: 0.2}", "track: unknown parameter 'w_rbg'"),
        ("track: 3", "track: found 3; expected parameters by name"),
        ("track: {w_rgb: much}", "track: w_rgb is 'much'; expected a number"),
        ("track: {iterations: [3, x]}", "iterations is 'x'; expected a whole number"),
        ("undistort: 1", "undistort is 1; expected true or false"),
        ("loops: {mode: sometimes}", "mode is 'sometimes'; expected one of on, local, global, off"),
        ("depth_max: [3]", r"depth_max is \[3\]; expected a number or nothing"),
        ("out: there", "'out' has no place in a configuration"),
        ("extends: nowhere", "no such configuration; expected a YAML file or one of default"),
        ("extends: [default]", "extends is"),
        ("extends: mine.yaml", "extends itself"),
        ("- 3", "found list; expected parameters by name"),
        ("track: {", "not readable as YAML"),
    ],
)
def test_mistakes_are_named(tmp_path, text, message):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        parsed("--config", str(path))


def test_the_command_refuses_unknown_names(tmp_path, capsys):
    assert run("map", [str(tmp_path), "--out", str(tmp_path / "run"), "--config", "mars"]) == 2
    assert "--config mars" in capsys.readouterr().err
    picture = tmp_path / "picture.png"
    picture.write_bytes(b"\x89PNG")
    assert run("map", [str(tmp_path), "--out", str(tmp_path / "run"), "--config", str(picture)]) == 2
    assert "no YAML" in capsys.readouterr().err
