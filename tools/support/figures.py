"""The figures that README and docs state, each with the commands that make it: tools/figures.yaml."""

import itertools
import statistics
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, Literal

from dsmap.config_file import fill
from dsmap.errors import InputError
from dsmap.plain import brief, read_json, read_yaml


@dataclass
class Figure:
    """One stated number."""

    what: str = ""
    stated: float = 0.0
    """As the document states it, in `unit`."""
    tolerance: float = 0.0
    """A measured number this near is the same, in `unit`."""
    file: str = ""
    """JSON file that holds the number, in the entry's folder."""
    key: str = ""
    """Where in it: names joined by dots; `*` sums over all names at its place."""
    over: str = ""
    """Key of a number to divide by."""
    unit: str = ""
    scale: float = 1.0
    """The file's number times this is in `unit`."""
    of: Literal["median", "max", "min", "sum", "mean"] = "median"
    """How the numbers of `each` become one."""


@dataclass
class FigureSet:
    """Figures that come out of the same commands."""

    name: str = ""
    where: str = ""
    """Where they are stated."""
    needs: dict[str, str] = field(default_factory=dict)
    """Folders in --data, and how one gets them."""
    packages: tuple[str, ...] = ()
    """Python packages that dsmap does without."""
    each: dict[str, list[Any]] = field(default_factory=dict)
    """Values of {names} in the commands; they run once for every combination."""
    commands: tuple[str, ...] = ()
    """dsmap commands without `dsmap`; {data} and {out} are folders."""
    figures: list[Figure] = field(default_factory=list)

    def cases(self) -> list[dict[str, Any]]:
        """The combinations of `each`."""
        return [
            dict(zip(self.each, values, strict=True)) for values in itertools.product(*self.each.values())
        ]


@dataclass
class Measured:
    """A figure and what came out now."""

    figure: Figure
    values: list[float]
    """One a case, in the figure's unit."""

    @property
    def value(self) -> float:
        """The number to compare."""
        functions: dict[str, Callable[[list[float]], float]] = {
            "median": statistics.median, "mean": statistics.fmean, "max": max, "min": min, "sum": sum
        }  # fmt: skip
        return float(functions[self.figure.of](self.values))

    @property
    def same(self) -> bool:
        """Whether the statement holds."""
        return abs(self.value - self.figure.stated) <= self.figure.tolerance


def load_entries(file: Path | None = None) -> list[FigureSet]:
    """All entries of a list of figures; dsmap's own by default.

    Raises:
        InputError: the list is damaged; names the entry.
    """
    source: Path | Traversable = file or resources.files("dsmap.tools") / "figures.yaml"
    listed = read_yaml(source).get("entries")
    if not isinstance(listed, list):
        raise InputError(f"{source}: found no list of entries; expected `entries:`")
    entries = [_entry(values, str(source)) for values in listed]
    names = [entry.name for entry in entries]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{source}: {', '.join(twice)} is there twice; expected each name once")
    return entries


def number_at(file: Path, key: str) -> float:
    """The number at a dotted key of a JSON file; `*` sums over all names at its place, true counts as 1.

    Raises:
        InputError: there is none.
    """
    value = read_json(file, "scores of dsmap")
    values = [value]
    for name in key.split("."):
        trees = [value if isinstance(value, dict) else _numbered(value) for value in values]
        values = [v for tree in trees for v in (tree.values() if name == "*" else [tree.get(name)])]
    numbers = [float(value) for value in values if isinstance(value, int | float)]
    if len(numbers) < max(len(values), 1):
        wrong = next((value for value in values if not isinstance(value, int | float)), None)
        raise InputError(f"{file}: found {wrong!r} at {key}; expected a number")
    return sum(numbers)


def _numbered(value: Any) -> dict[str, Any]:
    """A list as names with values: "0", "1", ..."""
    if not isinstance(value, list):
        return {}
    return {str(i): item for i, item in enumerate(value)}


def _entry(values: Any, where: str) -> FigureSet:
    if not isinstance(values, dict):
        raise InputError(f"{where}: found {brief(values)} among the entries; expected names and values")
    here = f"{where}: {brief(values.get('name', 'an entry without name'))}"
    plain = {key: value for key, value in values.items() if key != "figures"}
    entry = fill(FigureSet(), plain, here)
    listed = values.get("figures") or []
    if not isinstance(listed, list):
        raise InputError(f"{here}: found figures {brief(listed)}; expected a list")
    entry.figures = [fill(Figure(), figure, here) for figure in listed]
    for name in ("name", "where", "commands", "figures"):
        if not getattr(entry, name):
            raise InputError(f"{here}: no {name}; expected it")
    return entry
