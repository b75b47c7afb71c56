"""Ranges of parameters, declared once, beside each: `width: Annotated[int, Range(8, 640)] = 80`.

They are checked wherever a value comes from: the command line, a configuration file, a checkpoint, Python.
"""

import dataclasses
import functools
import math
import typing
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

from dsmap.errors import InputError
from dsmap.plain import brief


@dataclass(frozen=True)
class Range:
    """What a number, or each number of a tuple, may be."""

    low: float
    high: float
    above: bool = False
    """Whether the least value is excluded."""
    length: int | None = None
    """How many numbers a tuple holds; None: any."""

    def has(self, value: float) -> bool:
        """Whether a number lies within; NaN does not."""
        return self.low <= value <= self.high and not (self.above and value == self.low)

    def __str__(self) -> str:
        each = "" if self.length is None else f"{self.length} numbers, each "
        if self.above:
            return f"{each}above {self.low:,g} and at most {self.high:,.15g}"
        return f"{each}{self.low:,.15g} to {self.high:,.15g}"


Share = Annotated[float, Range(0, 1)]
"""Of something: a fraction, a probability."""
Metres = Annotated[float, Range(0, 100)]
Degrees = Annotated[float, Range(0, 180)]
Every = Annotated[int, Range(1, 1_000_000)]
"""Something is done in every n-th frame."""
Frames = Annotated[int, Range(0, 1_000_000_000)]
"""A number of frames."""
Seed = Annotated[int, Range(0, 2**32 - 1)]
Scale = Annotated[float, Range(0, 1e9, above=True)]
"""Stored units per metre."""
Side = Annotated[int, Range(1, 16_384)]
"""Pixels."""


def check_ranges(config: Any, spell: Callable[[str], str], prefix: str = "") -> None:
    """Refuse parameters of a dataclass, and of those in it, that are out of their ranges.

    Args:
        spell: a parameter's name, groups with a dot, as the message should name it.

    Raises:
        InputError: names the parameter, the value and the range.
    """
    for name, hint in hints_of(type(config)).items():
        value = getattr(config, name)
        if dataclasses.is_dataclass(value):
            is_group = not any(getattr(extra, "name", None) == "" for extra in typing.get_args(hint)[1:])
            check_ranges(value, spell, f"{prefix}{name}." if is_group else prefix)
        else:
            check_value(value, hint, spell(prefix + name))


def check_value(value: Any, hint: Any, name: str) -> None:
    """Refuse one value that is out of the range of its type hint, or no finite number. Raises InputError."""
    allowed = range_of(hint)
    length = allowed.length if allowed is not None and isinstance(value, tuple) else None
    if length is not None and len(value) != length:
        raise InputError(f"{name} is {brief(value)}; expected {allowed}")
    for one in value if isinstance(value, tuple) else (value,):
        if isinstance(one, bool) or not isinstance(one, int | float):
            continue
        if allowed is not None and not allowed.has(one):
            raise InputError(f"{name} is {brief(value)}; expected {allowed}")
        if isinstance(one, float) and not math.isfinite(one):
            raise InputError(f"{name} is {brief(value)}; expected a finite number")


def range_of(hint: Any) -> Range | None:
    """The range that an annotation declares, also inside `... | None` and `tuple[...]`."""
    extras = typing.get_args(hint)[1:] if typing.get_origin(hint) is Annotated else ()
    found = next((extra for extra in extras if isinstance(extra, Range)), None)
    return found or next((r for part in typing.get_args(hint) if (r := range_of(part)) is not None), None)


@functools.cache
def hints_of(kind: type) -> dict[str, Any]:
    """The annotations of a dataclass's fields with their ranges."""
    hints = typing.get_type_hints(kind, include_extras=True)
    return {field.name: hints[field.name] for field in dataclasses.fields(kind)}


def as_flag(name: str) -> str:
    """A parameter's name as the command line has it."""
    return "--" + name.replace("_", "-")
