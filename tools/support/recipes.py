"""Recipes: trainings of several stages in one YAML file, each stage the options of `dsmap train`."""

import contextlib
import io
import re
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

from dsmap.config_file import merged_values
from dsmap.errors import InputError
from dsmap.plain import brief, read_yaml
from dsmap.ranges import as_flag, check_ranges

_OPTIONS = ("about", "places", "stages", "average")
"""Keys of a recipe that are no options of a stage."""


@dataclass(frozen=True)
class Stage:
    """One stage of a recipe."""

    name: str
    argv: list[str]
    """Options of `dsmap train` but `--out`, `--init`, `--resume`, `--device` and `--workers`."""


@dataclass(frozen=True)
class Recipe:
    """Stages one after the other."""

    stages: list[Stage]
    average: int = 1
    """The finished weights are the mean of so many last stages' weights."""


def load_recipe(name: str, places: tuple[str, ...] = ()) -> Recipe:
    """The stages of a recipe, and what becomes of their weights.

    Args:
        name: a YAML file, or the name of a recipe that comes with dsmap.
        places: NAME=PATH of the data that the recipe calls `${NAME}`.

    Raises:
        InputError: no such recipe, no stages, a place that is not given, or an average of stages that are not there.
    """
    folder = resources.files("dsmap.tools") / "recipes"
    path = Path(name)
    if not path.is_file():
        shipped = sorted(file.name.removesuffix(".yaml") for file in folder.iterdir())
        if name not in shipped:
            raise InputError(
                f"--recipe {name}: no such file, expected a YAML file or one of {', '.join(shipped)}"
            )
    recipe = read_yaml(path if path.is_file() else folder / f"{name}.yaml")
    stages = recipe.get("stages")
    if not isinstance(stages, list) or not stages or not all(isinstance(stage, dict) for stage in stages):
        raise InputError(f"--recipe {name}: expected `stages`, a list of options of dsmap train")
    if any("=" not in place for place in places):
        raise InputError(f"--places: found {' '.join(places)}, expected NAME=PATH")
    stated = recipe.get("places") or {}
    if not isinstance(stated, dict):
        raise InputError(f"--recipe {name}: found places {brief(stated)}, expected names and paths")
    known = {**stated, **dict(place.split("=", 1) for place in places)}
    common = {key: value for key, value in recipe.items() if key not in _OPTIONS}
    result = []
    for number, stage in enumerate(stages, start=1):
        options = merged_values(common, stage)
        title = str(options.pop("name", "stage"))
        if not re.fullmatch(r"[\w][\w.-]{0,60}", title):
            raise InputError(
                f"--recipe {name}: stage {number} is named {title[:80]!r}, expected letters, digits, dots and dashes: "
                "it becomes a folder"
            )
        label = f"{number}-{title}"
        try:
            argv = [Template(word).substitute(known) for word in words(options)]
        except (KeyError, ValueError) as error:
            raise InputError(
                f"--recipe {name}: place {error} is not given, expected --places NAME=PATH"
            ) from error
        result.append(Stage(label, argv))
    count = recipe.get("average", 1)
    if not isinstance(count, int) or isinstance(count, bool) or not 1 <= count <= len(result):
        raise InputError(
            f"--recipe {name}: found average {brief(count)}, expected how many of its {len(result)} stages"
        )
    return Recipe(result, count)


def words(options: dict[str, Any], prefix: str = "--") -> list[str]:
    """Options by name as the words of a command line; nested ones as `--net.geometry`."""
    found = []
    for key, value in options.items():
        flag = prefix + str(key).replace("_", "-")
        if isinstance(value, dict):
            found += words(value, flag + ".")
        elif isinstance(value, bool):
            base, _, last = flag.rpartition(".")
            off = f"{base}.no-{last}" if base else f"--no-{flag[2:]}"
            found.append(flag if value else off)
        elif isinstance(value, list):
            found += [flag, *map(str, value)]
        else:
            found += [flag, str(value)]
    return found


def parse_stage(stage: Stage, args_type: type, out: Path) -> Any:
    """The stage's options as an object of `args_type`.

    Raises:
        InputError: options that `dsmap train` does not have, or wrong values.
    """
    import tyro

    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
            args = tyro.cli(args_type, args=[*stage.argv, "--out", str(out)])
        check_ranges(args, lambda name: f"recipe: stage {stage.name}: {as_flag(name)}")
        return args
    except SystemExit as error:
        text = " ".join(re.sub(r"[^\x20-\x7e]+", " ", said.getvalue()).split())
        raise InputError(f"recipe: stage {stage.name}: {text[:300]}") from error
