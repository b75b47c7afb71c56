"""Damage to the values of YAML and JSON."""

import json
import re
from pathlib import Path
from typing import Any

import yaml
from damage_common import VALUES, NotApplicable, Rng, write
from damage_text import text_of


def _places(content: Any, at: tuple = ()) -> list[tuple]:
    """Every place in nested lists and dicts."""
    found = [at]
    items = (
        content.items()
        if isinstance(content, dict)
        else enumerate(content)
        if isinstance(content, list)
        else ()
    )
    for key, value in list(items)[:60]:
        found += _places(value, (*at, key))
    return found


def _set(content: Any, at: tuple, value: Any) -> Any:
    if not at:
        return value
    inner = content
    for key in at[:-1]:
        inner = inner[key]
    inner[at[-1]] = value
    return content


def _get(content: Any, at: tuple) -> Any:
    for key in at:
        content = content[key]
    return content


def damaged_values(rng: Rng, content: Any) -> Any:
    """Plain values with one of them of another kind, lost, nested, or exchanged with another."""
    places = _places(content)
    at = places[int(rng.integers(len(places)))]
    other = places[int(rng.integers(len(places)))]
    match int(rng.integers(9)):
        case 0 | 1 | 2 | 3:
            return _set(content, at, VALUES[int(rng.integers(len(VALUES)))])
        case 4:
            if at and isinstance(holder := _get(content, at[:-1]), dict):
                del holder[at[-1]]
            return content
        case 5:
            holder = _get(content, at)
            if isinstance(holder, dict):
                holder[str(rng.choice(["unknown", "", "__class__", "name", "0"]))] = 1
            return content
        case 6:
            value = _get(content, at)
            return _set(content, at, [value])
        case 7:
            deep: Any = 1
            for _ in range(int(rng.choice([60, 3000]))):
                deep = [deep] if rng.random() < 0.5 else {"a": deep}
            return _set(content, at, deep)
        case _:
            if at[: len(other)] == other or other[: len(at)] == at:
                raise NotApplicable
            a, b = _get(content, at), _get(content, other)
            return _set(_set(content, at, b), other, a)


def values(rng: Rng, path: Path) -> None:
    """One value of a YAML or JSON file is of another kind."""
    text = text_of(path)
    if path.suffix.lower() in (".json", ".gltf"):
        write(path, json_text(damaged_values(rng, json.loads(text))))
    elif path.suffix.lower() in (".yaml", ".yml"):
        write(path, json_text(damaged_values(rng, yaml.safe_load(text))))  # JSON is YAML
    else:
        raise NotApplicable


def json_text(content: Any) -> str:
    """JSON with NaN, numbers of 400 digits and any depth."""
    import sys

    limit, digits = sys.getrecursionlimit(), sys.get_int_max_str_digits()
    sys.setrecursionlimit(20_000)
    sys.set_int_max_str_digits(0)
    try:
        return json.dumps(content)
    finally:
        sys.setrecursionlimit(limit)
        sys.set_int_max_str_digits(digits)


def yaml_text(rng: Rng, path: Path) -> None:
    """What only YAML can do: bombs of aliases, dates, tags, doubled keys, several documents."""
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise NotApplicable
    text = text_of(path)
    keys = [line for line in text.split("\n") if re.match(r"\w+:\s*\S", line)]
    key = keys[int(rng.integers(len(keys)))] if keys else "a: 1"
    name = key.split(":")[0]
    bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
        f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 9)
    )
    added = [
        bomb, bomb + f"{name}: *a8\n", f"{name}: 2020-01-01\n", f"{name}: 2020-01-01 10:00:00\n", f"{name}: !!python/object/apply:os.system [true]\n",
        f"{name}: !!binary aGVsbG8=\n", f"{name}: !!set {{a, b}}\n", f"{name}: 1:30:00\n", f"{name}: 0b11\n", f"{name}: .nan\n", f"{name}: -.inf\n",
        key + "\n", f"{name}: 9999\n", "---\nb: 1\n", f"{name}: {'9' * 5000}\n", f"{name}: {'[' * 3000}{']' * 3000}\n", f"? [{name}, 1]\n: 2\n", f"{name}: &x [*x]\n",
        f"1: 2\n{name}: ~\n", "<<: {a: 1}\n", f"{name}: 2020-99-99\n", f"{name}: !!timestamp x\n", f"{name}: !!int x\n", f"{name}: !!float ''\n", f"{name}: 1e400\n",
    ]  # fmt: skip
    extra = added[int(rng.integers(len(added)))]
    if rng.random() < 0.5 and keys:
        text = text.replace(key + "\n", "", 1)
    write(path, text + "\n" + extra)
