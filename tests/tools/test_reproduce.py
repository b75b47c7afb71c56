"""`dsmap reproduce`: the shipped list fits the commands; statements hold or do not; missing data is said."""

import importlib
import re
import shlex
import subprocess
from pathlib import Path

import pytest
import tyro
import yaml
from corner_frames import record

from dsmap.errors import InputError
from dsmap.tools.cli import COMMANDS, run
from dsmap.tools.commands import reproduce
from dsmap.tools.commands.reproduce import missing
from dsmap.tools.support.figures import Figure, Measured, load_entries, number_at

ENTRIES = load_entries()


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_shipped_commands_can_be_parsed(entry, tmp_path):
    for command in entry.commands:
        words = shlex.split(command.format(data=tmp_path, out=tmp_path, **entry.cases()[0]))
        try:
            module = importlib.import_module(COMMANDS[words[0]][0])
        except ModuleNotFoundError as error:
            pytest.skip(f"{words[0]} needs {error.name}")
        module.parse(words[1:]) if hasattr(module, "parse") else tyro.cli(module.Args, args=words[1:])
    for figure in entry.figures:
        assert figure.what and figure.key and figure.tolerance >= 0
        assert any(f"{{out}}/{figure.file.split('/')[0]}" in command for command in entry.commands)


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_the_page_states_what_the_list_states(entry):
    page = (Path(__file__).resolve().parents[2] / entry.where.split(",")[0]).read_text()
    for figure in entry.figures:
        if figure.unit and figure.stated not in (0, 100):  # those are said in words
            value = rf"(?<![\d.]){figure.stated:g}0?(?![\d.]*\d)"
            assert re.search(value, page), (
                f"{figure.what}: {figure.stated:g} {figure.unit} is not in {entry.where}"
            )


def test_the_list_and_the_names(capsys):
    assert run("reproduce", ["--list"]) == 0
    printed = capsys.readouterr().out
    assert all(entry.name in printed for entry in ENTRIES) and "needs tum_fr1_xyz_10s" in printed
    assert (
        run("reproduce", ["moon"]) == 2
        and "figure 'moon': not there; expected `all`" in capsys.readouterr().err
    )
    assert run("reproduce", []) == 2


def listed(tmp_path, **changes):
    """A list with one entry about a toy recording."""
    entry = {
        "name": "toy", "where": "here", "needs": {"toy": "make one"}, "each": {"n": [1, 2]},
        "commands": ["map {data}/toy --out {out}/run --segmenter none --no-pictures --stop {n}5", "evaluate {out}/run"],
        "figures": [{"what": "frames", "file": "run/metrics.json", "key": "map.frames", "of": "sum", "stated": 40}],
    } | changes  # fmt: skip
    path = tmp_path / "figures.yaml"
    path.write_text(yaml.safe_dump({"entries": [entry]}))
    return path


def test_a_statement_holds_or_does_not(tmp_path, capfd, monkeypatch):
    def here(argv: list[str]) -> subprocess.CompletedProcess:
        return subprocess.CompletedProcess(argv, run(argv[3], argv[4:]))

    monkeypatch.setattr(reproduce.subprocess, "run", here)  # a process a command costs seconds
    record(tmp_path / "toy", repeat=2)
    call = [
        "toy",
        "--data",
        str(tmp_path),
        "--out",
        str(tmp_path / "out"),
        "--figures",
        str(listed(tmp_path)),
    ]
    assert run("reproduce", call) == 0
    assert "toy: frames: stated 40 +- 0, measured 40 (sum of 2: 15 to 25): holds" in capfd.readouterr().out
    assert run("reproduce", call) == 2 and "--overwrite" in capfd.readouterr().err, (
        "nothing is replaced unasked"
    )
    monkeypatch.undo()
    one = listed(tmp_path, each={}, commands=["evaluate {out}/n-1/run --out {out}/scores.json"], figures=[
        {"what": "frames", "file": "scores.json", "key": "map.frames", "stated": 12, "tolerance": 2}
    ])  # fmt: skip
    assert run("reproduce", [*call, "--overwrite", "--figures", str(one)]) == 1
    assert "measured 15: DIFFERS" in capfd.readouterr().out
    bad = listed(tmp_path, each={}, commands=["evaluate {out}/nowhere"])
    assert run("reproduce", [*call, "--overwrite", "--figures", str(bad)]) == 2
    assert "failed with exit code 2" in capfd.readouterr().err


def test_what_is_missing_is_said(tmp_path, capsys):
    call = ["toy", "--figures", str(listed(tmp_path))]
    assert run("reproduce", call) == 0
    assert "toy: skipped: needs --data DIR with toy in it (make one)" in capsys.readouterr().out
    assert run("reproduce", [*call, "--data", str(tmp_path / "no")]) == 0
    assert "toy is not there (make one)" in capsys.readouterr().out
    entry = load_entries(listed(tmp_path, needs={}, packages=["no_such_package"]))[0]
    assert missing(entry, None) == "needs the Python package no_such_package"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"colour": 1}, "unknown parameter 'colour'"),
        ({"figures": []}, "'toy': no figures"),
        ({"figures": [{"stated": "much"}]}, "stated is 'much'; expected a number"),
        ({"commands": "map"}, "commands is 'map'; expected a list"),
        ({"needs": ["a"]}, "expected names with values"),
    ],
)
def test_mistakes_in_a_list_are_named(tmp_path, changes, message):
    with pytest.raises(InputError, match=message):
        load_entries(listed(tmp_path, **changes))


def test_numbers_of_several_cases(tmp_path):
    values = [3.0, 1.0, 2.0]
    for of, expected in (("median", 2), ("mean", 2), ("max", 3), ("min", 1), ("sum", 6)):
        assert Measured(Figure(of=of), values).value == expected
    (tmp_path / "s.json").write_text(
        '{"a": {"100": 1.5, "b": null}, "c": {"x": {"ok": true}, "y": {"ok": true}}, "l": [3, 4]}'
    )
    assert number_at(tmp_path / "s.json", "a.100") == 1.5
    assert number_at(tmp_path / "s.json", "c.*.ok") == 2
    assert number_at(tmp_path / "s.json", "l.1") == 4
    for key in ("l.2", "a.b", "a.*", "c.*.no", "a.c", "a"):
        with pytest.raises(InputError, match=f"at {key}; expected a number"):
            number_at(tmp_path / "s.json", key)
