"""Configurations of data sets: complete, loadable by name and by file, flags before them, mistakes named."""

import dataclasses
import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import tyro

from dsmap.config_file import fill
from dsmap.errors import InputError
from dsmap.fusion.config import MapConfig
from dsmap.tools.cli import run
from dsmap.tools.commands.map import Args, defaults
from dsmap.tools.mapping.start import map_config
from dsmap.tools.support.presets import load_preset, preset_names

REPOSITORY = Path(__file__).parents[2]
PLAIN = Args(Path("SEQ"), Path("RUN"))
CALL = ["SEQ", "--out", "RUN"]
NOT_COMPUTED = {
    *("path", "out", "config", "overwrite", "resume", "localize_in", "extend", "checkpoint_every"),
    *("device", "engine", "start", "stop", "pictures", "save_probabilities"),  # where and how much, not what
    *("weights", "label_noise", "label_noise_kind", "seed", "intrinsics", "depth_scale"),  # of one recording
    *("color_topic", "depth_topic", "pose_convention", "label_map"),  # of one recording, too
    *("loops", "label_fusion", "segment_every"),  # short for loop.mode, labels.rule, labels.every
}


def parsed(*flags: str) -> Args:
    argv = [*CALL, *flags]
    return tyro.cli(Args, args=argv, default=defaults(argv))


def test_the_default_configuration_states_every_parameter():
    values = load_preset("default")
    expected = {f.name for f in dataclasses.fields(Args)} - NOT_COMPUTED
    assert set(values) == expected
    for name in expected:
        own = getattr(PLAIN, name)
        if dataclasses.is_dataclass(own):
            assert set(values[name]) == {f.name for f in dataclasses.fields(own)}, name
    assert fill(PLAIN, values, "default") == PLAIN, "default.yaml says what the code does"
    groups = {f.name for f in dataclasses.fields(MapConfig)}
    assert {"loops" if g == "loop" else g for g in expected} >= groups - {"device"}, (
        "a parameter without a flag"
    )


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
    assert args.depth_max == 4.0 and isinstance(args.depth_max, float)
    assert (args.track.w_rgb, args.track.max_rms, args.track.iterations) == (0.3, 0.01, (3, 2, 1))
    assert args.loop.mode == "off" and args.labels.every == 5
    assert args.surfels == PLAIN.surfels and parsed() == PLAIN


@pytest.mark.parametrize(
    ("flags", "calibrated", "expected"), [((), None, 4.0), ((), 8.0, 8.0), (("--depth-max", "2.5"), 8.0, 2.5)]
)
def test_depth_reaches_as_far_as_the_flag_the_calibration_or_a_kinect_says(flags, calibrated, expected):
    sequence: Any = SimpleNamespace(depth_max=calibrated, readout_s=0.01)
    assert map_config(parsed(*flags), sequence).depth_max == expected


def test_rows_are_read_as_fast_as_the_flag_or_the_calibration_says():
    sequence: Any = SimpleNamespace(depth_max=None, readout_s=0.026)
    assert map_config(parsed(), sequence).readout_s == 0.026
    assert map_config(parsed("--readout-s", "0"), sequence).readout_s == 0.0
    with pytest.raises(InputError, match="readout_s is 26.0; expected seconds"):
        map_config(parsed("--readout-s", "26"), sequence)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("colour: 1", "unknown parameter 'colour'; expected one of"),
        ("track: {w_rbg: 0.2}", "track: unknown parameter 'w_rbg'"),
        ("track: 3", "track: found 3; expected parameters by name"),
        ("track: {w_rgb: much}", "track: w_rgb is 'much'; expected a number"),
        ("track: {iterations: [3, x]}", "iterations is 'x'; expected a whole number"),
        ("undistort: 1", "undistort is 1; expected true or false"),
        ("loop: {mode: sometimes}", "mode is 'sometimes'; expected one of on, local, global, off"),
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
