"""How good the labels are: of the network alone, and of the map rendered into the frames."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from dsmap.classes import NUM_CLASSES, VOID
from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.fusion.labels.segment import segment_later
from dsmap.fusion.runs.map_renderer import MapRenderer
from dsmap.fusion.runs.read_run import SavedRun, evenly_spread
from dsmap.fusion.segmenter import Segmenter
from dsmap.metrics import ConfusionMatrix, Reliability, class_probabilities
from dsmap.sequences import Sequence
from dsmap.sequences.associate import associate

EVALUATION_SIZE = (320, 240)
"""Labels are scored at this size, as the paper does; smaller recordings at their own."""
EDGE_BAND_PX = 3
"""`off_edges` leaves out pixels within this distance of a label edge."""


@dataclass
class Score:
    """Confusion matrix and reliability of one kind of answer."""

    confusion: ConfusionMatrix = field(default_factory=ConfusionMatrix)
    reliability: Reliability = field(default_factory=Reliability)

    def tree(self) -> dict[str, Any]:
        """The keys `class_avg pixel_acc miou per_class ece brier`."""
        return self.confusion.scores() | {"ece": self.reliability.ece(), "brier": self.reliability.brier()}


def unknown(reason: str) -> dict[str, Any]:
    """The tree of a score that cannot be computed."""
    return Score().tree() | {"reason": reason}


def evaluate_semantics(
    run: SavedRun,
    reference: Sequence,
    pairs: list[tuple[int, int]],
    segmenter: Segmenter | None,
    max_frames: int,
) -> dict[str, Any]:
    """Scores of the network and of the map over the labelled frames of the reference.

    single_frame: the segmenter on the frame at the run's image size. map: the map's labels rendered into the
    frame's estimated pose; pixels where it has none take the network's answer. map_only: such pixels count
    as wrong (its ECE runs over the answered ones). coverage: share of labelled pixels the map answers.
    map_only_off_edges: answered pixels only, a band of 3 px along ground-truth label edges left out.

    Args:
        reference: frames of the evaluation's size.
        segmenter: the run's; None leaves `single_frame` and `map` out.
        max_frames: labelled frames scored, evenly spread; 0 for all.
    """
    keys = ("single_frame", "map", "map_only", "map_only_off_edges")
    labelled = [(i, j) for i, j in pairs if reference.entries[j].label is not None]
    if not labelled or run.surfels.count == 0:
        reason = "the map is empty" if labelled else "the reference has no labels"
        return {key: unknown(reason) for key in keys} | {"coverage": None, "reason": reason, "frames": 0}
    if max_frames > 0:
        labelled = [labelled[k] for k in evenly_spread(len(labelled), max_frames)]
    scores, covered, frames = {key: Score() for key in keys}, 0, 0
    render = MapRenderer(run, reference.intrinsics)
    native = reference.resized(run_size(run, reference))
    for i, j in labelled:
        try:
            truth = reference.label(j)
            network = None
            if segmenter:
                frame = native.frame(j)
                p = segment_later(segmenter, frame, run.poses[i], run.gravity, native.intrinsics, run.config)
                network = at_size(p, reference.intrinsics)
        except InputError:
            continue  # a damaged frame has no truth to compare with
        if truth is None:
            continue
        covered += _score_frame(scores, truth, *render(run.poses[i]), network)
        frames += 1
    total = scores["map_only"].confusion.total
    tree: dict[str, Any] = {key: score.tree() for key, score in scores.items()}
    if scores["single_frame"].confusion.total == 0:
        for key in ("single_frame", "map"):
            tree[key] = unknown("no network answered (the run's segmenter is none, or gave nothing)")
    return tree | {"coverage": covered / total if total else None, "frames": frames}


def evaluate_network(answers: Iterable[tuple[np.ndarray | None, np.ndarray]]) -> tuple[dict[str, Any], int]:
    """Scores of a network alone, at the labels' size.

    Args:
        answers: probabilities of a frame, shape (h, w, 14), or None, and its labels, shape (H, W).

    Returns:
        The tree of `Score.tree`, and the number of frames scored.
    """
    score, count = Score(), 0
    for p, truth in answers:
        if p is None:
            continue
        _add(score, truth, *_answer(resize_probabilities(p, truth.shape[1], truth.shape[0])))
        count += 1
    return (score.tree() if count else unknown("no frame was segmented")), count


def evaluate_labels(given: Sequence, reference: Sequence, max_frames: int = 0) -> dict[str, Any]:
    """Scores of label images, such as `dsmap export RUN --to labels-2d` writes, by the rules of a run's `map_only`.

    Args:
        given: a recording with these labels, paired with the reference by stamp.
        reference: the recording with true labels, at the size at which labels are scored.
        max_frames: labelled frames scored, evenly spread; 0 for all.

    Returns:
        A tree with the keys `labels` (scores without reliability: label images say no probabilities), `coverage` and
        `frames`.

    Raises:
        InputError: one of them has no labels, or they share no stamp.
    """
    for sequence in (given, reference):
        if not sequence.has_labels:
            raise InputError(f"{sequence.path}: found no label images, expected some (label.txt)")
    camera = reference.intrinsics
    given = given.resized((camera.width, camera.height))
    pairs = [
        (i, j) for i, j in associate(given.times, reference.times) if reference.entries[j].label is not None
    ]
    if not pairs:
        raise InputError(
            f"{given.path}: none of its stamps is within 20 ms of a labelled frame of {reference.path}"
        )
    if max_frames > 0:
        pairs = [pairs[k] for k in evenly_spread(len(pairs), max_frames)]
    confusion, covered, frames = ConfusionMatrix(), 0, 0
    for i, j in pairs:
        label, truth = given.label(i), reference.label(j)
        if label is None or truth is None:
            continue  # one that cannot be read has been warned of
        confusion.add(truth, label)
        covered += _covered(truth, label)
        frames += 1
    scores = confusion.scores() | {"ece": None, "brier": None}
    return {
        "labels": scores,
        "coverage": covered / confusion.total if confusion.total else None,
        "frames": frames,
    }


def run_size(run: SavedRun, reference: Sequence) -> tuple[int, int]:
    """The (width, height) that the run's segmenter saw; the recording's own if the run does not say."""
    size = run.settings.get("sequence", {}).get("size")
    own = reference.calibration.intrinsics
    return (int(size[0]), int(size[1])) if size else (own.width, own.height)


def at_size(p: np.ndarray | None, camera: Intrinsics) -> np.ndarray | None:
    """Class probabilities (h, w, 14) at the size of `camera`, without void: shape (H, W, 13); None stays None."""
    return None if p is None else class_probabilities(resize_probabilities(p, camera.width, camera.height))


def resize_probabilities(probabilities: np.ndarray, width: int, height: int) -> np.ndarray:
    """Bilinear, shape (h, w, 14) to (height, width, 14)."""
    if probabilities.shape[:2] == (height, width):
        return probabilities
    return cv2.resize(probabilities, (width, height), interpolation=cv2.INTER_LINEAR)


def off_edges(truth: np.ndarray, band: int = EDGE_BAND_PX) -> np.ndarray:
    """Pixels further than `band` [px, along rows and columns] from a change of label, bool, shape (H, W)."""
    edge = np.zeros(truth.shape, dtype=np.uint8)
    across, down = truth[:, 1:] != truth[:, :-1], truth[1:] != truth[:-1]
    edge[:, 1:] |= across
    edge[:, :-1] |= across
    edge[1:] |= down
    edge[:-1] |= down
    return cv2.dilate(edge, np.ones((2 * band - 1, 2 * band - 1), np.uint8)) == 0


def _score_frame(
    scores: dict[str, Score], truth: np.ndarray, label: np.ndarray, p: np.ndarray, network: np.ndarray | None
) -> int:
    """Add one frame to all scores; returns the number of labelled pixels that the map answers."""
    answered = label != VOID
    scores["map_only"].confusion.add(truth, label)
    scores["map_only"].reliability.add(np.where(answered, truth, VOID), p)
    inner = np.where(answered & off_edges(truth), truth, VOID)
    _add(scores["map_only_off_edges"], inner, label, p)
    if network is not None:
        network_label = (network.argmax(axis=-1) + 1).astype(np.uint8)
        _add(scores["single_frame"], truth, network_label, network)
        both = np.where(answered[..., None], p, network)
        _add(scores["map"], truth, np.where(answered, label, network_label), both)
    return _covered(truth, label)


def _covered(truth: np.ndarray, label: np.ndarray) -> int:
    """Labelled pixels that have an answer."""
    return int(((label != VOID) & (truth != VOID) & (truth < NUM_CLASSES)).sum())


def _answer(probabilities: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    p = class_probabilities(probabilities)
    return (p.argmax(axis=-1) + 1).astype(np.uint8), p


def _add(score: Score, truth: np.ndarray, label: np.ndarray, probabilities: np.ndarray) -> None:
    score.confusion.add(truth, label)
    score.reliability.add(truth, probabilities)
