"""States: what a part carries from frame to frame, as arrays and plain values by name."""

from typing import Any


def with_prefix(prefix: str, state: dict[str, Any]) -> dict[str, Any]:
    """The state with a prefix before every name."""
    return {prefix + name: value for name, value in state.items()}


def part_of(state: dict[str, Any], prefix: str) -> dict[str, Any]:
    """The values whose names begin with a prefix, without it."""
    return {name.removeprefix(prefix): a for name, a in state.items() if name.startswith(prefix)}
