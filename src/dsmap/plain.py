"""Plain values of YAML and JSON: one reader for all files, which bounds size, depth, digits and aliases.

Refused are doubled keys (of which one would silently win) and whole numbers beyond 64 bits. A date is the text that
it is.
"""

import json
import reprlib
from collections.abc import Hashable
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import yaml

from dsmap.errors import InputError
from dsmap.limits import MAX_DEPTH, MAX_TEXT_BYTES, MAX_VALUES, MAX_VALUES_BYTES
from dsmap.reading import read_bytes, reason

_WORDS = reprlib.Repr()
_WORDS.maxstring = _WORDS.maxother = _WORDS.maxlong = 60


def brief(value: Any) -> str:
    """A value from outside for a message: its `repr`, cut short whatever it is."""
    return _WORDS.repr(value)


def read_yaml(file: Path | Traversable) -> dict[str, Any]:
    """A YAML file of named values; an empty file has none.

    Raises:
        InputError: it cannot be read, or it is something else.
    """
    content = parse_yaml(_text(file, "YAML", MAX_VALUES_BYTES), file)
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise InputError(f"{file}: found {type(content).__name__}; expected parameters by name")
    odd = next((key for key in content if not isinstance(key, str)), None)
    if odd is not None:
        raise InputError(f"{file}: found the name {brief(odd)}; expected parameters by name")
    return content


def parse_yaml(text: str, where: Any) -> Any:
    """The values of a YAML text.

    Args:
        where: the file, for messages.

    Raises:
        InputError: no YAML, doubled keys, or larger, deeper or with more aliases than such a file may be.
    """
    try:
        _check_events(text, where)
        return yaml.load(text, _Loader)
    except yaml.MarkedYAMLError as error:
        line = f" in line {error.problem_mark.line + 1}" if error.problem_mark is not None else ""
        raise InputError(f"{where}: not readable as YAML ({error.problem}{line})") from error
    except (
        yaml.YAMLError,
        ValueError,
        TypeError,
        RecursionError,
        OverflowError,
        AttributeError,
        LookupError,
    ) as error:
        raise InputError(f"{where}: not readable as YAML ({reason(error)})") from error


def read_json(file: Path, expected: str = "JSON") -> Any:
    """The values of a JSON file. Raises InputError where it cannot be read (see `parse_json`)."""
    return parse_json(_text(file, expected, MAX_TEXT_BYTES), file, expected)


def parse_json(text: str | bytes, where: Any, expected: str = "JSON") -> Any:
    """The values of a JSON text.

    Raises:
        InputError: no JSON, doubled names, numbers of more than 64 bits, or nested too deeply.
    """
    try:
        content = json.loads(text, object_pairs_hook=_named_once, parse_int=_whole)
        _check_depth(content)
        return content
    except (ValueError, RecursionError, MemoryError) as error:
        raise InputError(f"{where}: not readable as JSON ({reason(error)}), expected {expected}") from error


def _text(file: Path | Traversable, expected: str, most: int) -> str:
    data = read_bytes(file, expected, most) if isinstance(file, Path) else file.read_bytes()
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{file}: not readable as {expected} ({reason(error)})") from error


def _named_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        seen: set[str] = set()
        twice = next(name for name, _ in pairs if name in seen or seen.add(name))  # type: ignore[func-returns-value]
        raise ValueError(f"the name {brief(twice)} is there twice")
    return found


def _whole(text: str) -> int:
    if len(text) > 20 or not -(2**63) <= (number := int(text)) < 2**64:
        raise ValueError(f"a whole number of {len(text)} digits")
    return number


def _check_depth(content: Any) -> None:
    """Level by level, so that depth costs no recursion."""
    level = [content]
    for _ in range(MAX_DEPTH):
        level = [
            value for holder in level for value in (holder.values() if isinstance(holder, dict) else holder)
            if isinstance(value, dict | list)
        ] if level and isinstance(level[0], dict | list) else []  # fmt: skip
        if not level:
            return
    raise ValueError(f"nested more than {MAX_DEPTH} deep")


def _check_events(text: str, where: Any) -> None:
    """Depth, and the number of values with aliases counted where they stand; the parser itself does not recurse."""
    depth, total = 0, 0
    sizes: dict[str, int] = {}
    open_anchors: list[tuple[str | None, int]] = []
    for event in yaml.parse(text, _Loader):
        total += 1
        if isinstance(event, yaml.AliasEvent):
            if any(name == event.anchor for name, _ in open_anchors):
                raise ValueError(f"the alias {event.anchor!r} holds itself")
            total += sizes.get(event.anchor, 0)
        elif isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            open_anchors.append((event.anchor, total))
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
            name, before = open_anchors.pop()
            if name is not None:
                sizes[name] = total - before
        if depth > MAX_DEPTH:
            raise ValueError(f"nested more than {MAX_DEPTH} deep")
        if total > MAX_VALUES:
            raise ValueError(f"more than {MAX_VALUES:,} values")


class _Loader(yaml.SafeLoader):
    """Dates stay text; keys are there once; whole numbers have at most 64 bits."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Hashable, Any]:
        seen = set()
        for key_node, _ in node.value:
            if key_node.tag == "tag:yaml.org,2002:merge":
                continue
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, Hashable) and key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"{brief(key)} is there twice", key_node.start_mark
                )
            if isinstance(key, Hashable):
                seen.add(key)
        return super().construct_mapping(node, deep)

    def construct_yaml_int(self, node: Any) -> int:
        if len(node.value) > 70 or not -(2**63) <= (value := super().construct_yaml_int(node)) < 2**64:
            raise yaml.constructor.ConstructorError(
                None, None, f"a whole number of {len(node.value)} digits", node.start_mark
            )
        return value


_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_yaml_int)
_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in found if tag != "tag:yaml.org,2002:timestamp"]
    for first, found in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
