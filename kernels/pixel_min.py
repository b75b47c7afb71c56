"""Choosing one surfel a pixel: a minimum over (value, surfel index) keys that any number of threads agree on.

Every slice of a surfel launch has its own image of 64-bit keys, `value << 32 | index`, because CPU atomics
do not hold across slices; the images are merged by min. On CUDA there is one slice and atomic_min. The
minimum of (value, index) pairs does not depend on the order in which surfels arrive, so neither does the map.
"""

import math
import threading
from typing import Any

import warp as wp

from dsmap.kernels.launch import Slice, launch_rows, num_slices

EMPTY = wp.constant(wp.uint64(0xFFFFFFFFFFFFFFFF))
"""Key of a pixel that no surfel has asked for."""

TAKEN = wp.constant(-2)
"""Index of a pixel that was asked for, but only with values that do not win it."""

_buffers = threading.local()


def scratch(name: str, shape: tuple[int, ...], dtype: Any, device: Any) -> wp.array:
    """An array for in between, which the next call with the same arguments on the same thread gets again."""
    slot = (name, shape, dtype, str(device))
    kept = _buffers.__dict__
    if slot not in kept:
        kept[slot] = wp.empty(shape, dtype=dtype, device=device)
    return kept[slot]


def key_buffer(height: int, width: int, device: Any) -> wp.array:
    """A buffer of EMPTY keys, uint64, shape (slices, H * W): `release` it when every key was taken."""
    slot = ("keys", (num_slices(device), height * width), str(device))
    keys = _buffers.__dict__.pop(slot, None)
    return keys if keys is not None else wp.full(slot[1], EMPTY, dtype=wp.uint64, device=device)


def release(keys: wp.array) -> None:
    """Give back a buffer from `key_buffer` of which `take_key` took every pixel: it is all EMPTY again."""
    _buffers.__dict__["keys", keys.shape, str(keys.device)] = keys


@wp.func
def make_key(value: float, index: int) -> wp.uint64:
    """Key of a surfel; `value` >= 0, whose bits as an integer are ordered as the floats are."""
    return (wp.uint64(wp.cast(value, wp.uint32)) << wp.uint64(32)) | wp.uint64(index)


@wp.func
def key_index(key: wp.uint64) -> int:
    """The surfel of a key that is not EMPTY."""
    return int(key & wp.uint64(0xFFFFFFFF))


@wp.func
def key_value(key: wp.uint64) -> float:
    """The value of a key that is not EMPTY."""
    return wp.cast(wp.uint32(key >> wp.uint64(32)), wp.float32)


@wp.func
def take_key(keys: wp.array2d(dtype=wp.uint64), pixel: int) -> wp.uint64:
    """The least of a pixel's keys, one a slice; they are EMPTY then, for the next use of the buffer."""
    best = keys[0, pixel]
    keys[0, pixel] = EMPTY
    for k in range(1, keys.shape[0]):
        best = wp.min(best, keys[k, pixel])
        keys[k, pixel] = EMPTY
    return best


@wp.kernel
def _merge_rows(s: Slice, limit: float, keys: wp.array2d(dtype=wp.uint64), index: wp.array2d(dtype=wp.int32)):
    row, lane = wp.tid()
    y = s.first + s.stride * row
    width = index.shape[1]
    for x in range(lane, width, s.step):
        best = take_key(keys, y * width + x)
        winner = int(-1)
        if best != EMPTY:
            winner = key_index(best)
            if key_value(best) >= limit:
                winner = TAKEN
        index[y, x] = winner


def merge_keys(keys: wp.array, index: wp.array, limit: float = math.inf) -> None:
    """Merge the slices' keys into the winning surfel of each pixel, and release the buffer.

    index: out, int32, shape (H, W); -1 where no surfel asked, TAKEN where none with a value below `limit` did.
    """
    height, width = index.shape
    launch_rows(_merge_rows, height, width, [limit, keys], [index], index.device)
    release(keys)
