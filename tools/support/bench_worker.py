"""One run of one system for `dsmap bench`, in a process of its own: `python -m dsmap.tools.support.bench_worker`.

A process of its own gives every run the same number of threads, a cold start and its own peak memory.
"""

import dataclasses
import json
import os
import resource
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dsmap.errors import InputError
from dsmap.files import write_json
from dsmap.fusion.evaluate.timing import Timing, time_mapper
from dsmap.metrics import ate_rmse
from dsmap.sequences import Sequence, open_sequence
from dsmap.tools.mapping.options import Args, with_values
from dsmap.tools.mapping.presets import load_preset
from dsmap.tools.mapping.segmenters import make_segmenter
from dsmap.tools.mapping.start import torch_device


@dataclass
class Request:
    """What to run."""

    system: str
    """`dsmap` or `open3d`."""
    path: str
    size: tuple[int, int] | None
    frames: int | None
    stride: int
    intrinsics: tuple[float, float, float, float] | None
    depth_scale: float | None
    depth_max: float
    threads: int
    device: str
    config: str | None = None
    """Of dsmap: as `dsmap map --config` takes it."""
    segmenter: str = "none"
    undistort: bool = True


def map_args(request: Request) -> Args:
    """What `dsmap map` would be told.

    Raises:
        InputError: no such configuration, or one with what has no place in it.
    """
    args = Args(Path(request.path), Path("RUN"))
    if request.config is not None:
        args = with_values(args, load_preset(request.config), f"--config {request.config}")
    changes: dict[str, Any] = {"undistort": request.undistort and args.undistort}
    changes["spec"] = dataclasses.replace(args.spec, kind=request.segmenter)
    return dataclasses.replace(args, map=dataclasses.replace(args.map, device=request.device), **changes)


def opened(request: Request) -> Sequence:
    """The recording, as both systems get it.

    Raises:
        InputError: it cannot be read.
    """
    return open_sequence(
        request.path, intrinsics=request.intrinsics, depth_scale=request.depth_scale, size=request.size,
        stop=None if request.frames is None else request.frames * request.stride, stride=request.stride,
        undistort=map_args(request).undistort,
    )  # fmt: skip


def measured(request: Request) -> dict:
    """Load the frames, run the system, and sum up.

    Raises:
        InputError: the recording cannot be read.
    """
    start = time.perf_counter()
    sequence = opened(request)
    frames = list(sequence)
    if not frames:
        raise InputError(f"{request.path}: none of its {len(sequence)} frames can be read")
    if request.system == "open3d":
        from dsmap.tools.support.bench_peer import time_open3d

        timing = time_open3d(frames, sequence.intrinsics, sequence.depth_scale, request.depth_max)
    else:
        args = map_args(request)
        config = dataclasses.replace(args.map, depth_max=request.depth_max).resolved_for(sequence)
        segmenter = make_segmenter(args.spec, torch_device(config.device))
        timing = time_mapper(frames, sequence.intrinsics, config, segmenter)
    wall_s = time.perf_counter() - start
    return summary(timing, [frame.T_world_camera for frame in frames], wall_s)


def summary(timing: Timing, references: list[np.ndarray | None], wall_s: float) -> dict:
    """Speed, accuracy and memory of a run as plain numbers.

    Args:
        references: given pose of every frame, or None.
        wall_s: seconds from opening the recording to the last pose.
    """
    pairs = [(T, given) for T, given in zip(timing.poses, references, strict=True) if given is not None]
    ate = None
    if len(pairs) >= 3:
        estimated, given = (np.array(side) for side in zip(*pairs, strict=True))
        ate = ate_rmse(estimated, given)
    return {
        "fps": timing.fps,
        "wall_fps": len(timing.frame_ms) / wall_s,
        "wall_s": wall_s,
        "frames": len(timing.frame_ms),
        "tracked_frames": sum(timing.tracked),
        "ate_rmse_m": ate,
        "peak_rss_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
        "frame_ms": {
            "median": float(np.median(timing.frame_ms)),
            "p95": float(np.percentile(timing.frame_ms, 95)),
        },
        "latency_ms": float(np.median(timing.latency_ms)) if timing.latency_ms else None,
        "stages_ms": timing.stages(),
    }


def main(request_file: str, result_file: str) -> int:
    """Read a request, write a result, both JSON; a problem with the input becomes {"error": sentence}."""
    values = json.loads(Path(request_file).read_text())
    request = Request(**values)
    cores = sorted(os.sched_getaffinity(0))[: request.threads]
    os.sched_setaffinity(0, cores)
    try:
        result = measured(dataclasses.replace(request, size=request.size and tuple(request.size)))
    except InputError as error:
        result = {"error": str(error)}
    write_json(result_file, result)
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
