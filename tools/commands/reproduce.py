"""`dsmap reproduce`: makes the figures that README and docs state again, and says whether they hold."""

import importlib.util
import shlex
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import tyro

from dsmap.errors import InputError
from dsmap.tools.support.figures import FigureSet, Measured, load_entries, number_at

_OVERWRITES = ("map", "render-scene")
"""Commands that want --overwrite before they replace what is there."""


@dataclass
class Args:
    names: tyro.conf.Positional[list[str]] = field(default_factory=list)
    """Which figures (see --list), or `all`."""
    list: bool = False
    """Only say which figures there are and what they need."""
    data: Path | None = None
    """Folder that holds the recordings by the names that --list gives."""
    out: Path = Path("reproduced")
    """Folder for sequences, runs and scores; one folder a name."""
    overwrite: bool = False
    """Replace what an earlier call left in --out."""
    figures: Path | None = None
    """Another list of figures than dsmap's own."""


def main(args: Args) -> int:
    """Run the commands of the chosen figures; exit code 1 if a statement does not hold."""
    entries = load_entries(args.figures)
    if args.list:
        print("\n".join(described(entry) for entry in entries))
        return 0
    chosen = choose(entries, args.names)
    rows: list[str] = []
    held = True
    for entry in chosen:
        reason = missing(entry, args.data)
        if reason:
            rows.append(f"{entry.name}: skipped: {reason}")
            continue
        for measured in reproduce(entry, args):
            rows.append(f"{entry.name}: {compared(measured)}")
            held &= measured.same
    print("\n" + "\n".join(rows))
    return 0 if held else 1


def choose(entries: list[FigureSet], names: list[str]) -> list[FigureSet]:
    """The entries of the given names, in the list's order.

    Raises:
        InputError: no name, or one that is not there.
    """
    known = [entry.name for entry in entries]
    for name in names or [""]:
        if name not in (*known, "all"):
            raise InputError(f"figure {name!r}: not there; expected `all` or some of {', '.join(known)}")
    return [entry for entry in entries if "all" in names or entry.name in names]


def missing(entry: FigureSet, data: Path | None) -> str:
    """What an entry lacks here, in a sentence; empty if nothing."""
    for folder, source in entry.needs.items():
        if data is None:
            return f"needs --data DIR with {folder} in it ({source})"
        if not (data / folder).exists():
            return f"{data / folder} is not there ({source})"
    for package in entry.packages:
        if importlib.util.find_spec(package) is None:
            return f"needs the Python package {package}"
    return ""


def reproduce(entry: FigureSet, args: Args) -> list[Measured]:
    """Run the commands of an entry for all its cases and read its figures.

    Raises:
        InputError: a command failed, or a score is not there.
    """
    measured = [Measured(figure, []) for figure in entry.figures]
    for case in entry.cases():
        parts = [f"{key}-{value}" for key, value in case.items()]
        out = args.out / entry.name / "_".join(parts) if parts else args.out / entry.name
        if out.exists() and any(out.iterdir()) and not args.overwrite:
            raise InputError(f"{out} exists and is not empty; expected another --out, or --overwrite")
        out.mkdir(parents=True, exist_ok=True)
        for command in entry.commands:
            run_command(
                command.format(data=shlex.quote(str(args.data)), out=shlex.quote(str(out)), **case),
                args.overwrite,
            )
        for one in measured:
            value = number_at(out / one.figure.file, one.figure.key)
            over = number_at(out / one.figure.file, one.figure.over) if one.figure.over else 1.0
            one.values.append(value / over * one.figure.scale)
    return measured


def run_command(command: str, overwrite: bool) -> None:
    """Run one dsmap command in a process of its own, so that speed and memory are those of a user's call."""
    words = shlex.split(command)
    if overwrite and words[0] in _OVERWRITES:
        words.append("--overwrite")
    print(f"\n$ dsmap {shlex.join(words)}", flush=True)
    done = subprocess.run([sys.executable, "-m", "dsmap.tools.cli", *words])
    if done.returncode:
        raise InputError(f"`dsmap {shlex.join(words)}` failed with exit code {done.returncode}")


def compared(measured: Measured) -> str:
    """Stated against measured, in a line."""
    figure, value = measured.figure, measured.value
    unit = f" {figure.unit}" if figure.unit else ""
    spread = ""
    if len(measured.values) > 1:
        low, high = min(measured.values), max(measured.values)
        spread = f" ({figure.of} of {len(measured.values)}: {low:.4g} to {high:.4g})"
    verdict = "holds" if measured.same else "DIFFERS"
    stated = f"stated {figure.stated:g}{unit} +- {figure.tolerance:g}"
    return f"{figure.what}: {stated}, measured {value:.4g}{unit}{spread}: {verdict}"


def described(entry: FigureSet) -> str:
    """An entry for --list."""
    cases = len(entry.cases())
    lines = [f"{entry.name}  ({entry.where})" + (f", {cases} cases" if cases > 1 else "")]
    lines += [f"    {f.what}: {f.stated:g} {f.unit}".rstrip() for f in entry.figures]
    lines += [f"    $ dsmap {command}" for command in entry.commands]
    lines += [f"    needs {folder}: {source}" for folder, source in entry.needs.items()]
    lines += [f"    needs the Python package {package}" for package in entry.packages]
    return "\n".join(lines)
