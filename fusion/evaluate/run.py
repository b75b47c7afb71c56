"""A run against its reference: the tree that `dsmap evaluate` writes into metrics.json."""

from pathlib import Path
from typing import Any

from dsmap.fusion.evaluate.floor_plan import evaluate_floor_plan
from dsmap.fusion.evaluate.loops import evaluate_loops
from dsmap.fusion.evaluate.objects import evaluate_objects
from dsmap.fusion.evaluate.semantics import EVALUATION_SIZE, evaluate_semantics
from dsmap.fusion.evaluate.surface import evaluate_surface
from dsmap.fusion.evaluate.trajectory import evaluate_trajectory
from dsmap.fusion.runs.read_run import SavedRun, load_run, pair_frames
from dsmap.fusion.segmenter import Segmenter
from dsmap.sequences import Sequence

MAX_FRAMES = 100
"""Labelled frames that semantics are scored on by default, evenly spread."""
_MAP_KEYS = ("frames", "surfels", "graph_nodes", "local_loops", "global_loops")
_SPEED_KEYS = ("fps", "stages_ms", "peak_rss_bytes")


def evaluate_run(
    run: SavedRun | Path | str,
    reference: Sequence,
    segmenter: Segmenter | None = None,
    max_frames: int = MAX_FRAMES,
    sfm: bool = False,
) -> dict[str, Any]:
    """Score a run against the recording that it mapped.

    Args:
        run: a RUN folder, or one that `load_run` has read.
        reference: the whole recording at any size, with whatever ground truth there is.
        segmenter: the network that labelled the run, for `semantics.single_frame` and `semantics.map`.
        max_frames: labelled frames scored, evenly spread; 0 for all.
        sfm: compare with structure from motion, too: `trajectory.sfm`.

    Returns:
        The nested tree `trajectory, loops, surface, semantics, objects, floor_plan, map, speed` (docs:
        the evaluation section).
        What lacks ground truth is None, with a `reason` beside it.

    Raises:
        InputError: the run is damaged, or the reference is another recording.
    """
    if not isinstance(run, SavedRun):
        run = load_run(run)
    small = reference.resized(evaluation_size(reference))
    pairs = pair_frames(run, small)
    trajectory, alignment = evaluate_trajectory(run, small, pairs, sfm)
    surface, surfel_labels = evaluate_surface(run, small, pairs, alignment)
    semantics = evaluate_semantics(run, small, pairs, segmenter, max_frames)
    return {
        "trajectory": trajectory,
        "loops": evaluate_loops(run, small, pairs),
        "surface": surface,
        "semantics": semantics | {"surfels": surfel_labels},
        "objects": evaluate_objects(run, small),
        "floor_plan": evaluate_floor_plan(run, small, alignment),
        "map": _from_stats(run.stats, "map", _MAP_KEYS),
        "speed": _from_stats(run.stats, "speed", _SPEED_KEYS),
    }


def evaluation_size(reference: Sequence) -> tuple[int, int]:
    """320x240, or the recording's own size where that is smaller."""
    own = reference.calibration.intrinsics
    if own.width < EVALUATION_SIZE[0] or own.height < EVALUATION_SIZE[1]:
        return own.width, own.height
    return EVALUATION_SIZE


def _from_stats(stats: dict[str, Any], group: str, keys: tuple[str, ...]) -> dict[str, Any]:
    values = stats.get(group)
    if not isinstance(values, dict):
        return dict.fromkeys(keys) | {"reason": "the run has no stats.json"}
    return dict.fromkeys(keys) | values
