"""What the numbers mean: trajectory error, confusion matrix and its scores, calibration of probabilities.

All functions take and return NumPy; none reads a file.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dsmap.classes import CLASS_NAMES, NUM_CLASSES, VOID

NUM_BINS = 15
"""Equal bins of the largest probability, for the expected calibration error."""


def align_se3(estimated: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """The rigid transform of estimated onto reference points with least squares (Umeyama 1991).

    Args:
        estimated, reference: corresponding points, shapes (N, 3).

    Returns:
        T_reference_estimated, shape (4, 4); no scale.
    """
    centre_e, centre_r = estimated.mean(axis=0), reference.mean(axis=0)
    U, _, Vt = np.linalg.svd((reference - centre_r).T @ (estimated - centre_e))
    S = np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    T = np.eye(4)
    T[:3, :3] = U @ S @ Vt
    T[:3, 3] = centre_r - T[:3, :3] @ centre_e
    return T


def align_similarity(estimated: np.ndarray, reference: np.ndarray) -> tuple[float, np.ndarray]:
    """Scale and rigid transform of estimated onto reference points with least squares (Umeyama 1991).

    Args:
        estimated, reference: corresponding points, shapes (N, 3). Those of a single moving camera have no scale.

    Returns:
        s and T, shape (4, 4): reference = T (s estimated).
    """
    T = align_se3(estimated, reference)  # the rotation is the same with and without a scale
    spread = estimated - estimated.mean(axis=0)
    turned = spread @ T[:3, :3].T
    scale = float((turned * (reference - reference.mean(axis=0))).sum() / (spread**2).sum())
    T[:3, 3] = reference.mean(axis=0) - scale * T[:3, :3] @ estimated.mean(axis=0)
    return scale, T


def ate_rmse(
    T_estimated: np.ndarray, T_reference: np.ndarray, *, align: bool = True, scale: bool = False
) -> float:
    """Absolute trajectory error: RMS distance of camera centres [m] (Sturm et al., IROS 2012).

    Args:
        T_estimated, T_reference: camera-to-world poses of the same frames, shapes (N, 4, 4).
        align: after SE(3) alignment of the centres.
        scale: after the best similarity transform instead.
    """
    estimated, reference = T_estimated[:, :3, 3], T_reference[:, :3, 3]
    if scale:
        s, T = align_similarity(estimated, reference)
        estimated = s * estimated @ T[:3, :3].T + T[:3, 3]
    elif align:
        T = align_se3(estimated, reference)
        estimated = estimated @ T[:3, :3].T + T[:3, 3]
    return float(np.sqrt(((estimated - reference) ** 2).sum(axis=1).mean()))


def relative_pose_error(
    times: np.ndarray, T_estimated: np.ndarray, T_reference: np.ndarray, interval: float = 1.0
) -> tuple[float, float] | None:
    """Relative pose error over a fixed time (Sturm et al., IROS 2012).

    Every frame is compared with the one whose stamp is nearest to `interval` later, if there is one within
    half a frame's time (the median one).

    Args:
        times: sorted stamps [s], shape (N,).
        T_estimated, T_reference: camera-to-world poses, shapes (N, 4, 4).
        interval: [s].

    Returns:
        RMS of translation [m] and of rotation [rad]; None if no pair of frames is that far apart.
    """
    if len(times) < 2:
        return None
    after = np.clip(np.searchsorted(times, times + interval), 1, len(times) - 1)
    later = np.where(times[after] - times - interval > times + interval - times[after - 1], after - 1, after)
    first = np.flatnonzero(np.abs(times[later] - times - interval) <= 0.501 * np.median(np.diff(times)))
    if len(first) == 0:
        return None
    second = later[first]
    moved_estimated = np.linalg.inv(T_estimated[first]) @ T_estimated[second]
    moved_reference = np.linalg.inv(T_reference[first]) @ T_reference[second]
    error = np.linalg.inv(moved_reference) @ moved_estimated
    angle = Rotation.from_matrix(error[:, :3, :3]).magnitude()
    translation = (error[:, :3, 3] ** 2).sum(axis=1)
    return float(np.sqrt(translation.mean())), float(np.sqrt((angle**2).mean()))


@dataclass
class ConfusionMatrix:
    """Counts of labelled pixels (or surfels): reference class by predicted class. Void is never scored."""

    counts: np.ndarray = field(default_factory=lambda: np.zeros((NUM_CLASSES, NUM_CLASSES), dtype=np.int64))
    """Rows: reference, columns: predicted; column 0 (no answer) counts as wrong. Shape (14, 14)."""
    names: tuple[str, ...] = CLASS_NAMES

    @classmethod
    def of(cls, names: tuple[str, ...]) -> "ConfusionMatrix":
        """Of other classes than dsmap's, such as VOC's; the first is void."""
        return cls(np.zeros((len(names), len(names)), dtype=np.int64), names)

    def add(self, reference: np.ndarray, predicted: np.ndarray) -> None:
        """Count class ids of equal shapes; where the reference is void (or no class) nothing is counted."""
        classes = len(self.names)
        scored = (reference != VOID) & (reference < classes)
        pairs = reference[scored].astype(np.int64) * classes + predicted[scored]
        self.counts += np.bincount(pairs, minlength=classes**2).reshape(classes, classes)

    @property
    def total(self) -> int:
        return int(self.counts.sum())

    def scores(self) -> dict[str, Any]:
        """class_avg, pixel_acc, miou and per_class {name: {recall, iou, pixels}}, as plain numbers.

        Averages run over the classes that the reference contains, as in the paper's Table 4; IoU (Eq. 7) is
        TP / (TP + FP + FN). Everything is None if nothing was counted.
        """
        hits = np.diag(self.counts)
        references, answers = self.counts.sum(axis=1), self.counts.sum(axis=0)
        present = [k for k in range(1, len(self.names)) if references[k] > 0]
        if not present:
            return {"class_avg": None, "pixel_acc": None, "miou": None, "per_class": {}}
        recall = {k: float(hits[k] / references[k]) for k in present}
        iou = {k: float(hits[k] / (references[k] + answers[k] - hits[k])) for k in present}  # Eq. 7
        return {
            "class_avg": float(np.mean(list(recall.values()))),
            "pixel_acc": float(hits[1:].sum() / self.total),
            "miou": float(np.mean(list(iou.values()))),
            "per_class": {
                self.names[k]: {"recall": recall[k], "iou": iou[k], "pixels": int(references[k])}
                for k in present
            },
        }


@dataclass
class Reliability:
    """How far probabilities can be believed: expected calibration error and Brier score."""

    count: np.ndarray = field(default_factory=lambda: np.zeros(NUM_BINS, dtype=np.int64))
    confidence: np.ndarray = field(default_factory=lambda: np.zeros(NUM_BINS))
    """Sum of the largest probability a bin."""
    correct: np.ndarray = field(default_factory=lambda: np.zeros(NUM_BINS, dtype=np.int64))
    squares: float = 0.0

    def add(self, reference: np.ndarray, probabilities: np.ndarray) -> None:
        """Count predictions.

        Args:
            reference: class ids, any shape; void is left out.
            probabilities: of the 13 classes 1..13, rows sum to 1, shape (*reference.shape, 13); or of
                another number of classes.
        """
        scored = (reference != VOID) & (reference <= probabilities.shape[-1])
        truth, p = reference[scored].astype(np.int64) - 1, probabilities[scored].astype(np.float64)
        if len(truth) == 0:
            return
        top, answer = p.max(axis=1), p.argmax(axis=1)
        # Rounding must not part equal probabilities that lie on a bin's edge (3/5 is one), hence the 1e-5.
        bins = np.clip(np.ceil(top * NUM_BINS - 1e-5).astype(np.int64) - 1, 0, NUM_BINS - 1)
        self.count += np.bincount(bins, minlength=NUM_BINS)
        self.confidence += np.bincount(bins, weights=top, minlength=NUM_BINS)
        self.correct += np.bincount(bins[answer == truth], minlength=NUM_BINS)
        # |p - onehot|^2 = |p|^2 - 2 p_truth + 1
        self.squares += float(((p**2).sum(axis=1) - 2 * p[np.arange(len(p)), truth] + 1).sum())

    def ece(self) -> float | None:
        """Expected calibration error: mean over predictions of |accuracy - confidence| of their bin."""
        total = self.count.sum()
        return float(np.abs(self.correct - self.confidence).sum() / total) if total else None

    def brier(self) -> float | None:
        """Mean squared distance of the probabilities to the one-hot truth, 0 (best) to 2."""
        total = self.count.sum()
        return self.squares / float(total) if total else None


def class_probabilities(probabilities: np.ndarray) -> np.ndarray:
    """Fourteen probabilities (void first) to those of the 13 classes, renormalised; uniform where all void.

    Shapes (..., 14) to (..., 13), float32; likewise for another number of classes.
    """
    p = np.clip(np.nan_to_num(probabilities[..., 1:].astype(np.float32)), 0.0, None)
    total = p.sum(axis=-1, keepdims=True)
    return np.where(total > 0, p / np.maximum(total, 1e-12), np.float32(1.0 / p.shape[-1]))
