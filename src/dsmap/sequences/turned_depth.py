"""Depth in millimetres that is turned left by three bits, as SUN3D and SUN RGB-D store it (SUN3Dsfm, depthRead.m)."""

from collections.abc import Iterable
from dataclasses import replace
from functools import partial

import numpy as np

from dsmap.errors import InputError
from dsmap.sequences.base import Entry
from dsmap.sequences.images import Packed, Source, read_stored

_BITS = 3
_MOST = 0.9
"""Share of the pixels nearer than 8 m, whose low three bits are empty."""
_LEAST_VALUES = 50
"""Different depths from which bits say anything: a drawn plane is at one depth."""


def is_turned(images: Iterable[np.ndarray]) -> bool:
    """Whether depth images as stored hold turned millimetres, all of them that hold enough to tell."""
    told = []
    for stored in images:
        valid = stored[stored > 0] if stored.dtype == np.uint16 else np.empty(0, np.uint16)
        values = np.unique(valid)
        if len(values) >= _LEAST_VALUES:
            told.append(float((valid % (1 << _BITS) == 0).mean()) > _MOST)
    return bool(told) and all(told)


def turned_back(source: Source) -> np.ndarray:
    """Depth [mm], uint16, shape (H, W). Raises InputError: no image of 16 bits and one channel."""
    stored = read_stored(source)
    if stored.dtype != np.uint16 or stored.ndim != 2:
        raise InputError(f"{source}: found no 16-bit image of one channel, expected depth")
    return np.right_shift(stored, _BITS) | np.left_shift(stored, 16 - _BITS)


def with_depth_turned_back(entry: Entry) -> Entry:
    """The entry whose depth is turned back when it is read."""
    return replace(entry, depth=packed(entry.depth))


def packed(source: Source) -> Packed:
    """A depth image that is turned back when it is read."""
    container, name = (
        (source.parent, source.name) if not isinstance(source, Packed) else (source.container, source.name)
    )
    return Packed(container, name, partial(turned_back, source))
