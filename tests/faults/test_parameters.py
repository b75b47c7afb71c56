"""Every parameter of every command declares its range beside itself, and is held to it wherever it comes from."""

import dataclasses
import importlib
import math
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from dsmap.config_file import fill
from dsmap.errors import InputError
from dsmap.fusion.config import MapConfig
from dsmap.ranges import as_flag, check_ranges, check_value, hints_of, range_of
from dsmap.tools.cli import COMMANDS, run

ODD = (0, -1, math.nan, math.inf, -math.inf, 1e308, 10**20, -(10**20), 0.5)
WORDS = ("0", "-1", "nan", "inf", "1e308", "", "12345678901234567890", "text")


def numeric(kind: type, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Name and annotation of every parameter that holds numbers, groups with a dot."""
    for name, hint in hints_of(kind).items():
        extras = typing.get_args(hint)[1:] if typing.get_origin(hint) is typing.Annotated else ()
        inner = typing.get_args(hint)[0] if extras else hint
        if dataclasses.is_dataclass(inner):
            is_group = not any(getattr(extra, "name", None) == "" for extra in extras)
            yield from numeric(inner, f"{prefix}{name}." if is_group else prefix)
        elif {"int", "float"} & set(str(inner).replace("'", " ").replace("[", " ").replace(",", " ").split()):
            yield prefix + name, hint


def parameters() -> list[tuple[str, str, Any]]:
    """Command, parameter and annotation of all numbers of the command line."""
    return [
        (command, name, hint)
        for command, (module, _) in COMMANDS.items()
        for name, hint in numeric(importlib.import_module(module).Args)
    ]


def test_every_number_declares_its_range_and_is_held_to_it():
    found = parameters()
    assert len(found) > 150
    assert [f"{command} {name}" for command, name, hint in found if range_of(hint) is None] == []
    for command, name, hint in found:
        allowed = range_of(hint)
        assert allowed is not None
        for value in ODD:
            values = value if allowed.length is None else (value,) * allowed.length
            if allowed.has(value):
                check_value(values, hint, name)
                continue
            with pytest.raises(InputError) as error:
                check_value(values, hint, as_flag(name))
            assert as_flag(name) in str(error.value) and str(allowed) in str(error.value), (command, name)
        if allowed.length is not None:
            with pytest.raises(InputError, match="expected"):
                check_value((), hint, name)


def test_defaults_are_within_their_ranges_and_mapping_checks_them():
    check_ranges(MapConfig(), str)
    config = dataclasses.replace(MapConfig(), track=dataclasses.replace(MapConfig().track, predict_every=0))
    with pytest.raises(InputError, match=r"track\.predict_every is 0; expected 1 to 1,000,000"):
        check_ranges(config, str)
    with pytest.raises(
        InputError, match=r"mine\.yaml: track: iterations is \(6,\); expected 3 numbers, each 0 to 1,000"
    ):
        fill(MapConfig(), {"track": {"iterations": [6]}}, "mine.yaml")
    with pytest.raises(InputError, match=r"mine\.yaml: depth_max is nan; expected above 0"):
        fill(MapConfig(), {"depth_max": math.nan}, "mine.yaml")


def test_the_command_line_names_option_value_and_range(capsys):
    assert run("map", ["x", "--out", "y", "--surfels.clean-every", "0"]) == 2
    assert "--surfels.clean-every is 0; expected 1 to 1,000,000" in capsys.readouterr().err
    assert run("view", ["x", "--max-points", "-3"]) == 2
    assert "--max-points is -3; expected 1 to 1,000,000,000" in capsys.readouterr().err
    assert run("map", ["x", "--out", "y", "--size", "99999999x99999999"]) == 2
    assert "expected" in capsys.readouterr().err


@pytest.mark.slow
def test_every_flag_at_odd_values_ends_with_a_sentence(capsys, tmp_path: Path, monkeypatch):
    """Parsed, never run: the commands' own work begins after the ranges."""
    for command, name, _ in parameters():
        module = importlib.import_module(COMMANDS[command][0])
        monkeypatch.setattr(module, "main", lambda args: 0)
        for word in WORDS:
            code: Any
            try:
                code = run(command, [*needed(module.Args), as_flag(name), *([word] if word else [])])
            except SystemExit as end:  # tyro's: no such number
                code = end.code
            said = capsys.readouterr().err
            assert code in (0, 2) and "Traceback" not in said, (command, name, word)
            assert code == 0 or said.strip(), (command, name, word)


def needed(kind: type) -> list[str]:
    """Words for what a command cannot do without."""
    words = []
    for field in dataclasses.fields(kind):
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            hint = str(hints_of(kind)[field.name])
            value = typing.get_args(typing.get_type_hints(kind)[field.name])
            word = str(value[0]) if "Literal" in hint else "x"
            words += (
                [word]
                if "Positional" in hint or "positional" in hint.lower()
                else [as_flag(field.name), word]
            )
    return words
