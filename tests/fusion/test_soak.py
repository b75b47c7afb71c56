"""2,000 frames in one room, seen again and again: the map stops growing, and so do memory and a frame's cost."""

import os
from pathlib import Path

import loop_room
import numpy as np
import pytest

from dsmap.frame import Frame, Intrinsics
from dsmap.fusion.config import MapConfig
from dsmap.fusion.lie import exp_se3
from dsmap.fusion.mapper import Mapper
from dsmap.kernels.camera import make_camera
from dsmap.kernels.launch import BLOCK
from dsmap.metrics import ate_rmse

TURN = 125
"""Frames a turn: the camera does not come back to the very same pixels."""


def wobbling_frame(index: int, rng: np.random.Generator) -> Frame:
    """A camera turning about 2.9 degrees a frame, up and down and in and out a little, with depth noise."""
    sway = exp_se3(
        np.array([0, 0.1 * np.sin(index / 37), 0.1 * np.sin(index / 53), 0.05 * np.sin(index / 29), 0, 0])
    )
    T = loop_room.pose(index * 120 / TURN) @ sway
    rgb, depth = loop_room.look(T)
    noisy = depth + rng.normal(0, 0.0012, depth.shape) * depth**2
    return Frame(index, index / 30, rgb, noisy.astype(np.float32), T)


def resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="resident memory is read from Linux' /proc")
def test_a_long_run_in_one_place_is_flat():
    frames = int(os.environ.get("DSMAP_SOAK_FRAMES", 2000))
    mapper = loop_room.mapper(window=60)
    rng = np.random.default_rng(0)
    given, poses, alive, rows, walked, memory = [], [], [], [], [], []
    for index in range(frames):
        frame = wobbling_frame(index, rng)
        result = mapper.step(frame)
        assert result.tracked, f"frame {index}: {result.reason}"
        given.append(frame.T_world_camera)
        poses.append(result.T_world_camera)
        rows.append(mapper.surfels.count)
        walked.append(len(mapper.model.integrator.visible) * BLOCK)
        if index % TURN == TURN - 1:
            alive.append(int((mapper.surfels.numpy()["weight"] > 0).sum()))
            memory.append(resident_bytes())
    turns = len(alive)
    report = (
        f"alive a turn {alive}, rows {rows[::TURN]}, walked {walked[::TURN]}, MiB {[m >> 20 for m in memory]}"
    )
    print(report, f"ATE {ate_rmse(np.array(poses), np.array(given)) * 100:.2f} cm, {len(mapper.loops)} loops")
    early, late = slice(2 * TURN, 4 * TURN), slice((turns - 2) * TURN, turns * TURN)
    assert max(alive[turns // 2 :]) < 1.1 * alive[3], "the surfels of a room that is known are there already"
    assert max(rows) < 1.4 * max(alive), "dead surfels are compacted away"
    assert np.median(walked[late]) < 1.25 * np.median(walked[early]), (
        "a frame walks no more surfels than before"
    )
    assert memory[-1] - memory[turns // 2] < 8 << 20, "no memory for a surface that is known"
    assert ate_rmse(np.array(poses), np.array(given)) < 0.03


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="resident memory is read from Linux' /proc")
def test_a_frame_leaves_nothing_in_memory_but_its_pose():
    """The frames are made before: the process holds nothing that grows but the mapper. DSMAP_SOAK_FRAMES=20000
    is the whole of it: 5 MB over 18,000 frames."""
    frames = int(os.environ.get("DSMAP_SOAK_FRAMES", 4000))
    intrinsics, rng = Intrinsics(96, 72, 82.5, 82.5, 47.5, 35.5), np.random.default_rng(0)
    seen = []
    for step in range(1000):
        T = loop_room.pose(step) @ exp_se3(
            np.array([0, 0.1 * np.sin(step / 37), 0.1 * np.sin(step / 53), 0, 0, 0])
        )
        rgb, depth = loop_room.look(T, camera=make_camera(intrinsics))
        depth += (rng.normal(0, 0.0012, depth.shape) * depth**2).astype(np.float32)
        seen.append((rgb, depth))
    mapper = Mapper(MapConfig(depth_max=6.0), intrinsics)
    memory = np.full(frames // 100 + 1, 1)
    for index in range(frames):
        there_and_back = index % 1998
        result = mapper.step(Frame(index, index / 30, *seen[min(there_and_back, 1998 - there_and_back)]))
        assert result.tracked, f"frame {index}: {result.reason}"
        if index % 100 == 99:
            memory[index // 100] = resident_bytes()
            if index % 1000 == 999:
                print(
                    index + 1,
                    f"{memory[index // 100] / 2**20:.2f} MiB, {mapper.surfels.count} surfels",
                    flush=True,
                )
    settled = memory[19 : frames // 100]
    assert settled.max() - settled[0] < 5e6
