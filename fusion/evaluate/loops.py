"""Which of a run's loops are right: the relative pose of a loop's two frames against the reference."""

from typing import Any

import numpy as np

from dsmap.errors import InputError
from dsmap.fusion.lie import inverse, pose_difference
from dsmap.fusion.runs.read_run import SavedRun
from dsmap.sequences import Sequence

MAX_DISTANCE = 0.05
"""A loop whose relative pose is off by more than this [m] is wrong..."""
MAX_ANGLE_DEG = 3.0
"""... or by more than this [deg]."""


def evaluate_loops(run: SavedRun, reference: Sequence, pairs: list[tuple[int, int]]) -> dict[str, Any]:
    """Scores of the loops in loops.json.

    Args:
        pairs: (frame of the run, frame of the reference).

    Returns:
        The tree of `loops.*`: how many a kind, how many that bent the map (in the others both parts agreed), how
        many of those with poses for both frames are `correct` and `wrong`, the largest and the median errors,
        and the list `each`. None, with a `reason`, where the run has no loops.json or the reference no poses.

    Raises:
        InputError: loops.json names frames that the run does not have, or its poses are no poses.
    """
    keys = (
        "closed",
        "kinds",
        "bent",
        "compared",
        "correct",
        "wrong",
        "distance_median_m",
        "distance_max_m",
        "angle_max_deg",
    )
    if run.loops is None:
        return dict.fromkeys(keys) | {"reason": "the run has no loops.json"}
    kinds = [loop.get("kind", "unnamed") for loop in run.loops]
    tree: dict[str, Any] = dict.fromkeys(keys) | {
        "closed": len(run.loops),
        "kinds": {kind: kinds.count(kind) for kind in sorted(set(kinds))},
        "bent": sum(loop.get("nodes", 1) > 0 for loop in run.loops),
    }
    true = {i: T for i, j in pairs if (T := reference.T_world_camera(j)) is not None}
    if not true:
        return tree | {"reason": "the reference has no poses"}
    each = [_judged(run, loop, true) for loop in run.loops]
    compared = [loop for loop in each if loop["wrong"] is not None]
    wrong = sum(loop["wrong"] for loop in compared)
    tree |= {"compared": len(compared), "correct": len(compared) - wrong, "wrong": wrong}
    if compared:
        distances = [loop["distance_m"] for loop in compared]
        tree["distance_median_m"], tree["distance_max_m"] = float(np.median(distances)), max(distances)
        tree["angle_max_deg"] = max(loop["angle_deg"] for loop in compared)
    return tree | {"each": each}


def _judged(run: SavedRun, loop: dict[str, Any], true: dict[int, np.ndarray]) -> dict[str, Any]:
    """One loop with its error; `wrong` is None where the reference lacks a pose of its frames."""
    try:
        source, destination = int(loop["frame"]), int(loop["frame_destination"])
        T_destination_frame = np.array(loop["T_destination_frame"], dtype=np.float64).reshape(4, 4)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{run.path}/loops.json: a loop without {error}; expected frame, frame_destination and T_destination_frame"
        ) from error
    # A negative destination is a frame of the earlier recording in whose map this one started.
    if not (0 <= source < len(run.times) and destination < len(run.times)):
        raise InputError(
            f"{run.path}/loops.json: a loop of frames {source} and {destination}; expected 0 to {len(run.times) - 1}"
        )
    judged = {"kind": loop.get("kind"), "frame": source, "frame_destination": destination}
    if source not in true or destination not in true:
        return judged | {"distance_m": None, "angle_deg": None, "wrong": None}
    distance, angle = pose_difference(inverse(true[destination]) @ true[source], T_destination_frame)
    wrong = not (distance <= MAX_DISTANCE and angle <= MAX_ANGLE_DEG)  # NaN is wrong too
    return judged | {"distance_m": distance, "angle_deg": angle, "wrong": wrong}
