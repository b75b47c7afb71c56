"""What a run leaves behind: the RUN folder of `dsmap map`, which Python users write with `save_run`."""

import dataclasses
import resource
from pathlib import Path
from typing import Any

from dsmap.classes import write_classes
from dsmap.files import all_that_fits, atomic_path, write_json
from dsmap.fusion.exports.ply import write_ply
from dsmap.fusion.exports.trajectory import write_trajectory
from dsmap.fusion.loops.record import record_values
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.objects.files import remove_objects, write_objects
from dsmap.fusion.objects.segments import set_segments
from dsmap.fusion.runs.checkpoint import save_map
from dsmap.fusion.stage_clock import WARM_UP
from dsmap.fusion.trajectory import TrajectoryPoint, at_colour_stamps

CHECKPOINT = "checkpoint.safetensors"
"""Name of the checkpoint in a RUN folder."""


def save_run(
    mapper: Mapper,
    run_dir: Path | str,
    *,
    with_probabilities: bool = False,
    objects: bool = True,
    checkpoint: bool = True,
) -> None:
    """Write map.ply, labels.ply, trajectory.txt and its status, loops.json, classes.json, objects.json,
    scene_graph.json, checkpoint.safetensors.

    Every file is whole or absent: each is written under a temporary name and renamed. Trajectory and loops
    are those of this recording; frames of an earlier one, whose map it started in, have negative numbers.
    With `objects` the surfels get their segments, too.

    Raises:
        WriteError: after all that could be written was; names what was not.
    """
    run_dir = Path(run_dir)
    scene = mapper.objects() if objects else None
    if scene is not None:
        set_segments(mapper.surfels, scene.segment)
    else:
        remove_objects(run_dir)
    surfels = mapper.surfels.numpy()
    probabilities = mapper.probabilities() if with_probabilities else None
    points = _points(mapper)
    stamps = [point.time for point in points]
    with all_that_fits(run_dir) as attempt:
        # The small ones first: on a disk that is nearly full they fit.
        rows = list(zip(stamps, at_colour_stamps(points), strict=True))
        attempt(write_trajectory, run_dir / "trajectory.txt", rows)
        attempt(_write_status, run_dir / "trajectory_status.txt", points)
        attempt(write_json, run_dir / "loops.json", {"loops": _loops(mapper)}, indent=2)
        attempt(write_classes, run_dir / "classes.json")
        if scene is not None:
            attempt(write_objects, run_dir, scene)
        attempt(write_ply, run_dir / "map.ply", surfels, probabilities=probabilities, up=mapper.up)
        attempt(write_ply, run_dir / "labels.ply", surfels, colour="label", up=mapper.up)
        if checkpoint:
            attempt(save_map, mapper, run_dir / CHECKPOINT)


def config_values(mapper: Mapper) -> dict[str, Any]:
    """The parameters of a run as plain values."""
    return dataclasses.asdict(mapper.config)


def statistics(mapper: Mapper, skipped: int, wall_s: float) -> dict[str, Any]:
    """The content of stats.json: the paper's Table 3 numbers, tracking counts, speed and memory.

    fps is that of mapping alone: no decoding, no first WARM_UP frames; wall_s is everything.
    """
    points, surfels = _points(mapper), mapper.surfels
    frames, tracked = len(points), sum(point.tracked for point in points)
    weight, loops = surfels.numpy()["weight"], _loops(mapper)
    living = int((weight > 0).sum())
    stages = {name: stage.mean_ms for name, stage in mapper.stages.items()}
    busy_ms = sum(stage.counted_ms for stage in mapper.stages.values())
    begun = frames - mapper.begins_at  # those before were timed with the map that was given up
    counted = max(begun - WARM_UP, 0) or begun
    return {
        "map": {
            "frames": frames,
            "surfels": living,
            "stable_surfels": int((weight >= mapper.config.stable_weight).sum()),
            "graph_nodes": loops[-1]["nodes"] if loops else 0,
            "local_loops": sum(loop["kind"] == "local" for loop in loops),
            "global_loops": sum(loop["kind"] == "global" for loop in loops),
            "keyframes": len(mapper.locator.recovery.ferns),
            "bytes_per_surfel": surfels.nbytes / living if living else None,
        },
        "tracking": {
            "tracked_frames": tracked,
            "lost_frames": frames - tracked,
            "skipped_frames": skipped,
            "lost_start_frames": mapper.begins_at,
            "tracked_fraction": tracked / frames if frames else 0.0,
        },
        "speed": {
            "fps": counted / busy_ms * 1e3 if busy_ms else None,
            "stages_ms": stages,
            "wall_s": wall_s,
            "peak_rss_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
        },
    }


def _write_status(path: Path, points: list[TrajectoryPoint]) -> None:
    """A line for each of trajectory.txt: the pose of a lost frame is the last that was tracked."""
    lines = [f"{point.time:.6f} {'tracked' if point.tracked else 'lost'}" for point in points]
    with atomic_path(path) as file:
        file.write_text("\n".join(["# timestamp tracked|lost", *lines]) + "\n")


def _points(mapper: Mapper) -> list[TrajectoryPoint]:
    """The frames of this recording."""
    return mapper.trajectory[mapper.first_frame :]


def _loops(mapper: Mapper) -> list[dict[str, Any]]:
    """The loops that this recording closed, with its own frame numbers."""
    loops = [record_values(record) for record in mapper.loops if record.frame >= mapper.first_frame]
    shift = {"frame", "frame_destination"}
    return [{k: v - mapper.first_frame if k in shift else v for k, v in loop.items()} for loop in loops]
