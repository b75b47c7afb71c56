"""Launching kernels over rows of an image or over surfels, on every core of a CPU or on CUDA.

Warp runs a CPU launch on one thread but releases the GIL, so a launch is cut into slices that a thread
pool runs side by side. A kernel written for this module takes a `Slice` as its FIRST argument:

    row, lane = wp.tid()                      # image kernel, see launch_rows
    y = s.first + s.stride * row
    for x in range(lane, width, s.step): ...

    block = s.first + s.stride * wp.tid()                # list kernel, see launch_items
    for i in range(block * s.step, wp.min((block + 1) * s.step, s.count)): ...

    first = first_surfel(s, blocks, wp.tid())            # surfel kernel, see launch_blocks
    for i in range(first, wp.min(first + s.step, s.count)): ...

On the CPU one thread does a whole row (or a block of surfels), because a Warp CPU thread costs about 4 ns;
on CUDA one thread does one pixel (or one surfel). CPU atomics are not atomic across slices: a kernel
writes only its own rows or items, or a buffer of its own slice (`s.index`) that is merged by an
operation which does not depend on order (min, or a sum in row order). So results never depend on the
number of cores.
"""

import copy
import functools
import os
import sys
import threading
import weakref
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import warp as wp

from dsmap.cores import usable_cores

CPU_BLOCK = 2048
"""Entries that one CPU thread of `launch_items` walks through."""
BLOCK = wp.constant(256)
"""Consecutive surfels that are walked together or not at all (see kernels/culling.py)."""
_SMALL = 20_000
"""Below this many pixels or surfels a second thread costs more than it saves."""


@wp.struct
class Slice:
    """Which part of a launch a kernel invocation belongs to."""

    index: wp.int32  # number of the slice: 0 .. num_slices - 1
    first: wp.int32  # first row or block of the slice
    stride: (
        wp.int32
    )  # from one row or block of the slice to its next: slices interleave, so that none is idle early
    step: wp.int32  # launch_rows: lanes a row; launch_items, launch_blocks: entries or surfels a thread
    count: wp.int32  # rows or entries of the whole launch; launch_blocks: surfels of the map


def num_threads() -> int:
    """CPU threads that a launch uses: `DSMAP_THREADS`, or the cores this process may run on."""
    return int(os.environ.get("DSMAP_THREADS", 0)) or usable_cores()


@functools.cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=num_threads(), thread_name_prefix="dsmap-launch")


_here = threading.local()


def step_aside() -> None:
    """From now on the calling thread runs its launches alone and, on Linux, only where the cores have nothing else to
    do: for work that another thread will want later. It cannot be taken back."""
    _here.alone = True
    if sys.platform == "linux":  # elsewhere a priority is that of the whole process
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 19)


def _threads_here() -> int:
    return 1 if getattr(_here, "alone", False) else num_threads()


def together(first: Callable[[], Any], second: Callable[[], Any], device: Any) -> tuple[Any, Any]:
    """The results of two functions that launch no kernels; on a CPU the second runs beside the first."""
    if wp.get_device(device).is_cuda or _threads_here() == 1:
        return first(), second()
    waiting = _pool().submit(second)
    return first(), waiting.result()


def num_slices(device: Any) -> int:
    """How many slices a launch on `device` has at most: the size of a per-slice buffer's first axis."""
    return 1 if wp.get_device(device).is_cuda else num_threads()


@functools.lru_cache(maxsize=1024)
def _slices(units: int, count: int, step: int, slices: int) -> list[tuple[Slice, int]]:
    result = []
    for index in range(slices):
        part = Slice()
        part.index, part.first, part.stride, part.step, part.count = index, index, slices, step, count
        result.append((part, (units - index + slices - 1) // slices))
    return result


def launch_rows(
    kernel: Any,
    rows: int,
    width: int,
    inputs: Sequence[Any],
    outputs: Sequence[Any],
    device: Any,
    lanes: int = 0,
) -> None:
    """Launch an image kernel; `width` is the number of columns its threads share.

    `lanes` > 0 fixes the threads a row on every device (for reductions: one partial sum a lane).
    """
    record_rows(kernel, rows, width, inputs, outputs, device, lanes)()


def record_rows(
    kernel: Any,
    rows: int,
    width: int,
    inputs: Sequence[Any],
    outputs: Sequence[Any],
    device: Any,
    lanes: int = 0,
) -> "Recorded":
    """The launch of `launch_rows`, to be run when it is called, as often as it is called."""
    if wp.get_device(device).is_cuda:
        lanes, slices = lanes or width, 1
    else:
        lanes, slices = lanes or 1, _threads_here() if rows * width >= _SMALL else 1
    parts = _slices(rows, rows, lanes, slices)
    return Recorded(kernel, [(part, (n, lanes)) for part, n in parts], inputs, outputs, device)


def launch_items(kernel: Any, count: int, inputs: Sequence[Any], outputs: Sequence[Any], device: Any) -> None:
    """Launch a kernel over a list of `count` entries."""
    if count == 0:
        return
    if wp.get_device(device).is_cuda:
        step, slices = 1, 1
    else:
        step, slices = CPU_BLOCK, _threads_here() if count >= _SMALL else 1
    blocks = (count + step - 1) // step
    Recorded(kernel, _slices(blocks, count, step, slices), inputs, outputs, device)()


@wp.func
def first_surfel(s: Slice, blocks: wp.array(dtype=wp.int32), thread: int) -> int:
    """First of the s.step surfels that a thread of `launch_blocks` walks."""
    at = (s.first + s.stride * thread) * s.step
    return blocks[at // BLOCK] * BLOCK + at % BLOCK


def launch_blocks(
    kernel: Any,
    blocks: wp.array | None,
    count: int,
    inputs: Sequence[Any],
    outputs: Sequence[Any],
    device: Any,
) -> None:
    """Launch a surfel kernel over some blocks of a map of `count` surfels; the blocks become its first input.

    blocks: int32, ascending numbers of blocks (surfels BLOCK * number and on); None walks every surfel.
    """
    if count == 0:
        return
    if blocks is None:
        blocks = all_blocks(count, device)
    surfels = blocks.shape[0] * BLOCK
    if surfels == 0:
        return
    if wp.get_device(device).is_cuda:
        step, slices = 1, 1
    else:
        step, slices = BLOCK, _threads_here() if surfels >= _SMALL else 1
    parts = _slices(surfels // step, count, step, slices)
    Recorded(kernel, parts, [blocks, *inputs], outputs, device)()


def all_blocks(count: int, device: Any) -> wp.array:
    """Numbers of all blocks of a map of `count` surfels, int32, on the device."""
    blocks = (count + BLOCK - 1) // BLOCK
    return _numbers(1 << blocks.bit_length(), wp.get_device(device).alias)[:blocks]


@functools.lru_cache(maxsize=8)
def _numbers(count: int, device: str) -> wp.array:
    return wp.array(np.arange(count, dtype=np.int32), device=device)


_loading = threading.Lock()


@functools.cache
def _load(module: Any, device: str) -> None:
    # Before the slices start: two threads that find a module unloaded would both compile it.
    with _loading:
        module.load(wp.get_device(device))


class Recorded:
    """A launch whose arguments are packed once, for all its slices: that costs about as much as a small kernel."""

    def __init__(
        self,
        kernel: Any,
        parts: Sequence[tuple[Slice, Any]],
        inputs: Sequence,
        outputs: Sequence,
        device: Any,
    ):
        _load(kernel.module, wp.get_device(device).alias)
        part, dim = parts[0]
        arguments = [part, *inputs, *outputs]
        own = _packed(kernel, dim, arguments, device)
        self._held = arguments  # the launches know addresses only
        self._launches = [own, *(_like(own, part, dim) for part, dim in parts[1:])]

    def change(self, position: int, value: Any) -> None:
        """Another value for the input at this position, counted from the first after the slice."""
        self._held[position + 1] = value
        for launch in self._launches:
            launch.set_param_at_index(position + 1, value)

    def __call__(self) -> None:
        """Run it, and on a CPU wait until it is done."""
        waiting = deque(self._launches)
        helpers = [_pool().submit(_work_off, waiting) for _ in self._launches[1:]]
        _work_off(waiting)
        for helper in helpers:
            if not helper.cancel():  # it has begun
                helper.result()


def _work_off(waiting: deque) -> None:
    """Run slices until none is left; a thread that another program holds up leaves its share to the others."""
    while waiting:
        try:
            launch = waiting.popleft()
        except IndexError:  # another thread was quicker
            return
        launch.launch()


def _packed(kernel: Any, dim: Any, arguments: list[Any], device: Any) -> Any:
    """A recorded launch. Packing an argument costs as much as a thousand pixels, and most are what they were when
    this thread launched the kernel last: only the others are packed."""
    kept = _here.__dict__.setdefault("packed", {})
    slot = (kernel, str(device))
    if slot not in kept:
        launch = wp.launch(kernel, dim=dim, inputs=arguments, device=device, record_cmd=True)
        launch.fwd_args = None  # or a map that nobody has any more would be kept until the next launch
    else:
        before, old_dim, old = kept[slot]
        launch = _copy(before)
        if dim != old_dim:
            launch.set_dim(dim)
        for at, (value, was) in enumerate(zip(arguments, old, strict=True)):
            if value is not (was() if type(was) is weakref.ref else was):
                launch.set_param_at_index(at, value)
    known = [_remembered(argument) for argument in arguments]
    kept[slot] = _copy(launch), dim, known  # a copy: `change` changes the launch
    return launch


def _remembered(argument: Any) -> Any:
    """What to compare the next launch's argument with: of arrays and structs, which may hold a whole map, no more than
    a weak reference."""
    try:
        return weakref.ref(argument)
    except TypeError:  # a number
        return argument


def _copy(launch: Any) -> Any:
    other = copy.copy(launch)
    other.params = list(launch.params)
    if launch.params_addr:  # on CUDA: the addresses of the parameters
        other.params_addr = type(launch.params_addr)(*launch.params_addr)
    return other


def _like(launch: Any, part: Slice, dim: Any) -> Any:
    """A recorded CPU launch with another slice and dimension."""
    other = _copy(launch)
    other.set_dim(dim)
    other.set_param_at_index(0, part)
    return other
