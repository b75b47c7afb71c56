"""What all kinds of damage share."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Rng = np.random.Generator
Kind = Callable[[Rng, Path], None]


class NotApplicable(Exception):
    """This kind does nothing to such a file."""


TEXT = (
    ".txt",
    ".yaml",
    ".yml",
    ".json",
    ".csv",
    ".tsv",
    ".log",
    ".obj",
    ".mtl",
    ".xml",
    ".cfg",
    ".gltf",
    ".pincam",
    ".traj",
)
NUMBERS = (
    "nan",
    "inf",
    "-inf",
    "-1",
    "0",
    "1e308",
    "-1e308",
    "1e-308",
    "12345678901234567890",
    "9" * 400,
    "",
    "0x10",
    "1_000",
    "1,5",
    "١٢",
    "--1",
    "1e",
    "true",
    "None",
    "2020-01-01",
    "1e12",
    "-0.0",
)
VALUES: tuple[Any, ...] = (
    None, True, False, -1, 0, 0.5, float("nan"), float("inf"), float("-inf"), 1e308, -1e308, 10**20, -(10**20), 10**400,
    "", "text", "☃\u202e", "../../etc", "/dev/zero", "a" * 5000, "\0", [], {}, [1], [[]], {"a": 1}, [0] * 3000, [1, 2, 3, 4, 5, 6, 7, 8, 9],
    {"": None}, "nan", "1", 1, 2, 3, 1e-30,
)  # fmt: skip


def read(path: Path) -> bytearray:
    data = bytearray(path.read_bytes())
    if not data:
        raise NotApplicable
    return data


def write(path: Path, data: bytes | bytearray | str) -> None:
    path.unlink()
    path.write_bytes(data.encode("utf-8", "surrogatepass") if isinstance(data, str) else bytes(data))


def span(rng: Rng, size: int, most: int = 400) -> tuple[int, int]:
    """A stretch of bytes; one in three lies in the first 256, where headers are."""
    begin = int(rng.integers(min(size, 256))) if rng.random() < 0.34 else int(rng.integers(size))
    return begin, min(size, begin + 1 + int(rng.integers(most)))
