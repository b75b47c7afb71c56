"""An experiment is a table of cells: each is computed once, and kept beside what it was computed with."""

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dsmap import plain
from dsmap.errors import InputError
from dsmap.files import as_read_back, atomic_path, write_json

ExperimentReport = Callable[[str], None]
"""Takes a line for people."""


@dataclass(frozen=True)
class Cell:
    """One training run or measurement of an experiment."""

    name: str
    """Also its folder's."""
    settings: dict[str, Any]
    """Everything that the result depends on, as JSON has it."""
    run: Callable[[Path], dict]
    """Folder to result, as JSON has it; goes on where it was interrupted."""


def run_cells(cells: Sequence[Cell], out: Path, report: ExperimentReport = print) -> dict[str, dict]:
    """The results of all cells, by name; a cell that is in `out` already is not computed again.

    Raises:
        InputError: `out` holds a cell of the same name and other settings.
    """
    results = {}
    for number, cell in enumerate(cells, 1):
        file = out / cell.name / "cell.json"
        settings = as_read_back(cell.settings)
        if file.exists():
            stored = read_cell(file)
            if stored.get("settings") != settings:
                changed = _changed(stored.get("settings"), settings)
                raise InputError(
                    f"{file}: computed with {changed}; expected the same settings or a new --out"
                )
            results[cell.name] = stored["result"]
            report(f"[{number}/{len(cells)}] {cell.name}: there already")
            continue
        report(f"[{number}/{len(cells)}] {cell.name}")
        results[cell.name] = cell.run(out / cell.name)
        write_json(file, {"settings": settings, "result": results[cell.name]})
    return results


def _changed(stored: Any, settings: dict) -> str:
    if not isinstance(stored, dict):
        return repr(stored)
    names = [name for name in settings | stored if stored.get(name) != settings.get(name)]
    return ", ".join(f"{name} {stored.get(name)} (now {settings.get(name)})" for name in names)


def read_cell(file: Path) -> dict:
    """A JSON file of ours.

    Raises:
        InputError: it is damaged.
    """
    return plain.read_json(file, "JSON of an experiment (delete it to compute it again)")


def write_table(out: Path, columns: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """`table.csv` and `table.md` of the same rows; the latter's text."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([columns, *rows])
    head = [f"| {' | '.join(map(str, row))} |" for row in (columns, ["---"] * len(columns))]
    markdown = "\n".join(head + [f"| {' | '.join(map(str, row))} |" for row in rows]) + "\n"
    for name, content in (("table.csv", text.getvalue()), ("table.md", markdown)):
        with atomic_path(out / name) as temporary:
            temporary.write_text(content, encoding="utf-8")
    return markdown
