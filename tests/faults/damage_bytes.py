"""Damage to the bytes of any file."""

import os
import struct
from pathlib import Path

import numpy as np
from damage_common import NotApplicable, Rng, read, span, write


def flip_bits(rng: Rng, path: Path) -> None:
    data = read(path)
    for _ in range(int(rng.integers(1, 9))):
        data[span(rng, len(data))[0]] ^= 1 << int(rng.integers(8))
    write(path, data)


def random_bytes(rng: Rng, path: Path) -> None:
    data = read(path)
    a, b = span(rng, len(data), 64)
    data[a:b] = rng.bytes(b - a)
    write(path, data)


def truncate(rng: Rng, path: Path) -> None:
    data = read(path)
    write(path, data[: int(rng.integers(len(data)))])


def truncate_a_little(rng: Rng, path: Path) -> None:
    data = read(path)
    write(path, data[: -int(rng.integers(1, 9))])


def zero_run(rng: Rng, path: Path) -> None:
    data = read(path)
    a, b = span(rng, len(data))
    data[a:b] = bytes(b - a)
    write(path, data)


def ones_run(rng: Rng, path: Path) -> None:
    data = read(path)
    a, b = span(rng, len(data), 16)
    data[a:b] = b"\xff" * (b - a)
    write(path, data)


def insert(rng: Rng, path: Path) -> None:
    data = read(path)
    a = span(rng, len(data))[0]
    data[a:a] = rng.bytes(int(rng.integers(1, 200)))
    write(path, data)


def delete_run(rng: Rng, path: Path) -> None:
    data = read(path)
    a, b = span(rng, len(data))
    del data[a:b]
    write(path, data)


def repeat_run(rng: Rng, path: Path) -> None:
    data = read(path)
    a, b = span(rng, len(data))
    data[b:b] = data[a:b] * int(rng.integers(1, 6))
    write(path, data)


def swap_runs(rng: Rng, path: Path) -> None:
    data = read(path)
    (a, b), (c, _) = sorted((span(rng, len(data)), span(rng, len(data))))
    size = min(b - a, len(data) - c, c - a)
    data[a : a + size], data[c : c + size] = data[c : c + size], data[a : a + size]
    write(path, data)


def number_in_header(rng: Rng, path: Path) -> None:
    """A 16, 32 or 64 bit number in the first 200 bytes is one that lengths should not be."""
    data = read(path)
    code = str(rng.choice(["<H", ">H", "<I", ">I", "<Q", ">Q"]))
    size = struct.calcsize(code)
    if len(data) < size + 1:
        raise NotApplicable
    at = int(rng.integers(min(200, len(data) - size)))
    top = 2 ** (8 * size)
    value = int(rng.choice(np.array([0, 1, top // 2 - 1, top // 2, top - 1, 0x7FFFFFF, 60000], object)))
    data[at : at + size] = struct.pack(code, value % top)
    write(path, data)


def empty(rng: Rng, path: Path) -> None:
    write(path, b"")


def noise(rng: Rng, path: Path) -> None:
    write(path, rng.bytes(int(rng.integers(1, 5000))))


def append(rng: Rng, path: Path) -> None:
    write(path, read(path) + rng.bytes(int(rng.integers(1, 3000))))


def sparse(rng: Rng, path: Path) -> None:
    """What was there, then holes up to 3 GB."""
    os.truncate(path, 3 << 30)
