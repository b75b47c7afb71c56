"""Launching: recorded launches, threads that stand aside, threads that are held up."""

import gc
import os
import sys
import threading
import weakref

import numpy as np
import pytest
import warp as wp

from dsmap.kernels import launch
from dsmap.kernels.index_map import render_index
from dsmap.kernels.launch import Slice, launch_rows, record_rows, step_aside
from dsmap.tools.twins import scene as random_scene

SHAPE = (300, 200)
"""Large enough for several slices."""


@wp.kernel
def _number(s: Slice, factor: float, out: wp.array2d(dtype=float)):
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, out.shape[1], s.step):
        out[y, x] += factor * float(y * out.shape[1] + x)


@pytest.fixture(autouse=True)
def three_threads(monkeypatch):
    monkeypatch.setenv("DSMAP_THREADS", "3")


def numbers() -> np.ndarray:
    return np.arange(SHAPE[0] * SHAPE[1], dtype=np.float32).reshape(SHAPE)


def test_a_recorded_launch_runs_again_with_a_changed_input():
    out = wp.zeros(SHAPE, dtype=float, device="cpu")
    again = record_rows(_number, *SHAPE, [1.0], [out], "cpu")
    assert not out.numpy().any(), "recording runs nothing"
    again()
    again.change(0, 2.0)
    again()
    np.testing.assert_array_equal(out.numpy(), 3 * numbers())


def test_what_is_remembered_of_a_launch_keeps_no_map_alive():
    T = random_scene.pose(1)
    surfels = random_scene.surfel_map(T, 300, 1)
    index = wp.empty((random_scene.CAMERA.height, random_scene.CAMERA.width), dtype=wp.int32, device="cpu")
    render_index(surfels, random_scene.CAMERA, T, max_depth=3.0, index=index)
    position = weakref.ref(surfels.position)
    del surfels
    gc.collect()
    assert position() is None


def test_a_launch_does_not_wait_for_threads_that_are_held_up():
    held, out = threading.Event(), wp.zeros(SHAPE, dtype=float, device="cpu")
    giving_up = threading.Timer(30, held.set)
    giving_up.start()
    for _ in range(launch._pool()._max_workers):
        launch._pool().submit(held.wait)
    launch_rows(_number, *SHAPE, [1.0], [out], "cpu")
    assert not held.is_set(), "the launch waited for a pool that had other work"
    held.set()
    giving_up.cancel()
    np.testing.assert_array_equal(out.numpy(), numbers())


def test_a_thread_that_steps_aside_launches_alone_and_only_that_thread():
    out, told = wp.zeros(SHAPE, dtype=float, device="cpu"), {}

    def work() -> None:
        step_aside()
        launch_rows(_number, *SHAPE, [1.0], [out], "cpu")
        told["threads"] = launch._threads_here()
        if sys.platform == "linux":
            told["priority"] = os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    before = os.getpriority(os.PRIO_PROCESS, 0)
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert told == {"threads": 1} | ({"priority": 19} if sys.platform == "linux" else {})
    assert (launch._threads_here(), os.getpriority(os.PRIO_PROCESS, 0)) == (3, before)
    np.testing.assert_array_equal(out.numpy(), numbers())
