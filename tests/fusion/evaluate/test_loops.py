"""Loops of a run against a reference: which are right, which are wrong, what cannot be said."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.fusion.config import MapConfig
from dsmap.fusion.evaluate.loops import evaluate_loops
from dsmap.fusion.labels.gravity import MapGravity
from dsmap.fusion.lie import exp_se3, inverse
from dsmap.fusion.runs.read_run import SavedRun
from dsmap.kernels.types import SurfelMap
from dsmap.tools.support.score_tables import _loop_rows

FRAMES = 12
START = exp_se3(np.array([1.0, 2.0, 0.5, 0.3, -0.2, 0.1]))


@dataclass
class Reference:
    """Poses of a recording in a world of its own; frame 5 has none."""

    posed: bool = True

    def T_world_camera(self, i: int) -> np.ndarray | None:
        true = START @ exp_se3(np.array([0.1 * i, 0.02 * i, 0, 0, 0.2 * i, 0]))
        return true if self.posed and i != 5 else None


CAMERA = Intrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)


def run_with(loops) -> SavedRun:
    times = np.arange(FRAMES) / 10
    poses = np.stack([np.eye(4)] * FRAMES)  # the trajectory plays no part: a later loop may bend it
    return SavedRun(
        Path("RUN"),
        SurfelMap.empty("cpu", 1),
        MapConfig(),
        times,
        poses,
        poses,
        np.ones(FRAMES, bool),
        CAMERA,
        MapGravity(CAMERA),
        {},
        {},
        loops,
    )


def loop(frame, destination, error=(0, 0, 0, 0, 0, 0), kind="local", nodes=32):
    reference = Reference()
    true = {i: reference.T_world_camera(i) if i != 5 else np.eye(4) for i in (frame, destination)}
    T = inverse(true[destination]) @ true[frame] @ exp_se3(np.array(error, dtype=float))
    return {
        "kind": kind,
        "frame": frame,
        "frame_destination": destination,
        "T_destination_frame": T.tolist(),
    } | {"nodes": nodes}


PAIRS = [(i, i) for i in range(FRAMES)]


def test_correct_and_wrong_loops():
    loops = [
        loop(9, 1, nodes=0),
        loop(10, 1, (0.04, 0, 0, 0, 0, 0), "global", nodes=0),
        loop(11, 2, (0.06, 0, 0, 0, 0, 0)),  # 6 cm off
        loop(8, 0, (0, 0, 0, 0, 0, np.deg2rad(4)), "global"),  # 4 deg off
        loop(8, 5),  # the reference has no pose of frame 5
    ]
    tree = evaluate_loops(run_with(loops), Reference(), PAIRS)
    assert (tree["closed"], tree["compared"], tree["correct"], tree["wrong"]) == (5, 4, 2, 2)
    assert tree["kinds"] == {"global": 2, "local": 3} and tree["bent"] == 3
    assert [each["wrong"] for each in tree["each"]] == [False, False, True, True, None]
    assert tree["distance_max_m"] == pytest.approx(0.06) and tree["angle_max_deg"] == pytest.approx(4)
    rows = dict(_loop_rows(tree))
    assert rows["closed"] == "5 (2 global, 3 local)" and rows["correct"] == "2 of 4 compared"
    assert rows["of these, bent the map"] == "3"
    assert rows["wrong (> 5 cm or > 3 deg)"] == "2"


def test_a_pose_of_nans_is_wrong():
    bad = loop(9, 1) | {"T_destination_frame": np.full((4, 4), np.nan).tolist()}
    assert evaluate_loops(run_with([bad]), Reference(), PAIRS)["wrong"] == 1


def test_frames_are_matched_by_pairs_not_by_number():
    """The run started at frame 2 of the reference."""
    shifted = loop(9, 3) | {"frame": 7, "frame_destination": 1}
    tree = evaluate_loops(run_with([shifted]), Reference(), [(i, i + 2) for i in range(FRAMES - 2)])
    assert tree["correct"] == 1 and tree["distance_max_m"] < 1e-9


def test_nothing_to_score_says_why():
    assert "loops.json" in evaluate_loops(run_with(None), Reference(), PAIRS)["reason"]
    tree = evaluate_loops(run_with([loop(9, 1)]), Reference(posed=False), PAIRS)
    assert tree["closed"] == 1 and tree["wrong"] is None and "no poses" in tree["reason"]
    none = evaluate_loops(run_with([]), Reference(), PAIRS)
    assert (none["closed"], none["correct"], none["wrong"]) == (0, 0, 0) and none["distance_max_m"] is None


@pytest.mark.parametrize(
    "change", [{"frame": 99}, {"T_destination_frame": [1, 2, 3]}, {"frame_destination": None}]
)
def test_damaged_loops_are_refused(change):
    with pytest.raises(InputError, match="loops.json"):
        evaluate_loops(run_with([loop(9, 1) | change]), Reference(), PAIRS)
