"""Configurations as plain values: a dataclass of parameters from the nested dict of a YAML or JSON file."""

import ast
import dataclasses
import inspect
import itertools
import textwrap
import types
import typing
from pathlib import Path
from typing import Any, Literal, TypeVar

from dsmap.errors import InputError
from dsmap.plain import brief
from dsmap.ranges import check_value, hints_of

_T = TypeVar("_T")


def fill(default: _T, values: dict[str, Any], where: str, strict: bool = True) -> _T:
    """A copy of a dataclass with the given values; absent fields keep theirs.

    Args:
        default: an instance of a dataclass, whose fields may be dataclasses themselves.
        values: nested dict of plain values, by field name.
        where: the file, or whatever messages should name.
        strict: False passes over parameters that are not known: those of a map that an older dsmap saved.

    Raises:
        InputError: an unknown parameter, or a value of the wrong type or out of its range.
    """
    if not isinstance(values, dict):
        raise InputError(f"{where}: found {brief(values)}; expected parameters by name")
    names = [field.name for field in dataclasses.fields(default)]  # type: ignore[arg-type]
    hints, ranges = typing.get_type_hints(type(default)), hints_of(type(default))
    changes = {}
    for name, value in values.items():
        if name not in names:
            if not strict:
                continue
            raise InputError(f"{where}: unknown parameter {brief(name)}; expected one of {', '.join(names)}")
        old = getattr(default, name)
        if dataclasses.is_dataclass(old):
            changes[name] = fill(old, value, f"{where}: {name}", strict)
        else:
            changes[name] = _checked(value, hints[name], f"{where}: {name}")
            check_value(changes[name], ranges[name], f"{where}: {name}")
    return dataclasses.replace(default, **changes)  # type: ignore[type-var]


def merged_values(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """Nested dicts, those of `over` first."""
    out = dict(base)
    for key, value in over.items():
        old = out.get(key)
        out[key] = merged_values(old, value) if isinstance(old, dict) and isinstance(value, dict) else value
    return out


def _checked(value: Any, hint: Any, where: str) -> Any:
    """The value as the type wants it (lists become tuples, whole numbers floats)."""
    for option in typing.get_args(hint) if is_union(hint) else (hint,):
        fits, converted = _fitted(value, option, where)
        if fits:
            return converted
    raise InputError(f"{where} is {brief(value)}; expected {_describe(hint)}")


def _fitted(value: Any, hint: Any, where: str) -> tuple[bool, Any]:
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if hint is Any:
        return True, value
    if hint in (None, type(None)):
        return value is None, None
    if origin is Literal:
        if isinstance(value, bool) and not any(isinstance(a, bool) for a in arguments):
            value = "on" if value else "off"  # YAML reads a bare on or off as a truth value
        return value in arguments, value
    if origin is tuple:
        if not isinstance(value, list | tuple):
            return False, None
        return True, tuple(_checked(v, arguments[0], where) for v in value)
    if origin in (dict, list):
        return isinstance(value, origin), value
    if hint is float:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        return number, float(value) if number else None
    if hint is int:
        return isinstance(value, int) and not isinstance(value, bool), value
    if hint is Path:
        return isinstance(value, str | Path), Path(value) if isinstance(value, str | Path) else None
    return isinstance(value, hint), value


def is_union(hint: Any) -> bool:
    """Whether a type is one of several."""
    return typing.get_origin(hint) in (typing.Union, types.UnionType)


def _describe(hint: Any) -> str:
    if is_union(hint):
        return " or ".join(_describe(option) for option in typing.get_args(hint))
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is Literal:
        return "one of " + ", ".join(str(a) for a in arguments)
    if origin is tuple:
        return f"a list of {_describe(arguments[0])}"
    if hint in (None, type(None)):
        return "nothing"
    if origin in (dict, list):
        return "names with values" if origin is dict else "a list"
    names = {float: "a number", int: "a whole number", bool: "true or false", str: "text", Path: "a path"}
    return names.get(hint, str(hint))


def field_docs(kind: type) -> dict[str, str]:
    """Field name to the docstring under it, as one paragraph, of a dataclass written in a file."""
    body = ast.parse(textwrap.dedent(inspect.getsource(kind))).body[0]
    docs: dict[str, str] = {}
    assert isinstance(body, ast.ClassDef)
    for field, below in itertools.pairwise(body.body):
        if not isinstance(field, ast.AnnAssign) or not isinstance(field.target, ast.Name):
            continue
        if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
            docs[field.target.id] = " ".join(str(below.value.value).split())
    return docs
