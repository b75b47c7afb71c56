"""Asking the memory of a CPU for a row before it is read; on CUDA other threads hide the wait, and this does nothing.

Kernels that go through an image and read the surfel of each pixel wait for memory most of their time: a CPU
foresees neither the address nor, past a branch that noise decides, that there will be one.
"""

from typing import Any

import warp as wp

AHEAD = wp.constant(16)
"""Pixels between asking and reading."""


@wp.func_native(
    """
#if !defined(__CUDA_ARCH__)
    if (i >= 0)
        __builtin_prefetch(array.data + i);
#endif
"""
)
def fetch_early(array: wp.array(dtype=Any), i: int):
    """Row i of a contiguous array will be read soon; nothing happens where i < 0."""
