"""How good and how honest a network is on labelled images: scores, temperature, the rank of every image."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import logsumexp, softmax

from dsmap.classes import VOID
from dsmap.dsnet.data import LabelledImages
from dsmap.dsnet.datasets.base import Example
from dsmap.dsnet.inference.predict import DSNetSegmenter
from dsmap.metrics import ConfusionMatrix, Reliability, class_probabilities
from dsmap.sequences.images import resize_nearest

_PIXELS_A_IMAGE = 2000


def score(segmenter: DSNetSegmenter, data: LabelledImages, *, calibration: bool = False) -> dict:
    """Scores of a network at the size of the labels, its probabilities enlarged bilinearly.

    Args:
        calibration: `ece` and `brier` as well (takes as long again).

    Returns:
        class_avg, pixel_acc, miou, per_class (see `ConfusionMatrix.scores`) [, ece, brier].
    """
    confusion, reliability = ConfusionMatrix.of(data.class_names), Reliability()
    for i in range(len(data)):
        example = data[i]
        label = example.label
        probabilities = enlarge(segmenter.predict(example.rgb, example.geometry), label)
        confusion.add(label, probabilities[..., 1:].argmax(axis=2) + 1)
        if calibration:
            reliability.add(label, class_probabilities(probabilities))
    scores = confusion.scores()
    if calibration:
        scores |= {"ece": reliability.ece(), "brier": reliability.brier()}
    return scores


def fit_temperature(segmenter: DSNetSegmenter, *sets: LabelledImages, seed: int = 0) -> float:
    """The temperature that fits labelled images; void is left out.

    One set: that of the least negative log-likelihood (Guo et al. 2017). Several: that whose largest calibration error
    (ECE) among the sets is least, since no temperature is right for two worlds of different difficulty.
    At most 2000 labelled pixels of each image are used, chosen by `seed`.
    """
    samples = [_sampled_logits(segmenter, data, seed) for data in sets]
    samples = [(z, target) for z, target in samples if len(target)]
    if not samples:
        return 1.0

    def worst(log_temperature: float) -> float:
        scale = np.exp(log_temperature)
        if len(samples) == 1:
            return _log_loss(samples[0][0] / scale, samples[0][1])
        return max(_calibration_error(z / scale, target) for z, target in samples)

    best: Any = minimize_scalar(worst, bounds=(-3, 3) if len(samples) == 1 else (-1, 1), method="bounded")
    return float(np.exp(best.x))


def _log_loss(logits: np.ndarray, target: np.ndarray) -> float:
    return float(np.mean(logsumexp(logits, axis=1) - logits[np.arange(len(target)), target]))


def _calibration_error(logits: np.ndarray, target: np.ndarray) -> float:
    reliability = Reliability()
    reliability.add((target + 1)[None], softmax(logits, axis=1)[None])
    return reliability.ece() or 0.0  # none of no pixels


def _sampled_logits(
    segmenter: DSNetSegmenter, data: LabelledImages, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Logits at the network's prior, float64 (N, classes - 1), and true classes (N,), both without void."""
    rng = np.random.default_rng(seed)
    logits, targets = [], []
    for i in range(len(data)):
        example = data[i]
        z = segmenter.logits(example.rgb, example.geometry)
        label = resize_nearest(example.label, z.shape[1], z.shape[0]).ravel()
        chosen = np.flatnonzero(label != VOID)
        chosen = rng.permutation(chosen)[:_PIXELS_A_IMAGE]
        logits.append(z.reshape(-1, z.shape[2])[chosen, 1:])
        targets.append(label[chosen].astype(np.int64) - 1)
    return np.concatenate(logits).astype(np.float64), np.concatenate(targets)


@dataclass(frozen=True)
class ImageScore:
    """How well one image was labelled."""

    index: int
    """Position in the data set."""
    class_avg: float
    """Mean recall of the classes in the image."""
    pixel_acc: float


class Watch:
    """A network's `predict` that passes answers on and notes how good they are."""

    def __init__(self, predict: Callable[[np.ndarray, np.ndarray | None], np.ndarray]):
        self.predict = predict
        self.images: list[ImageScore] = []
        self.reliability = Reliability()

    def __call__(self, index: int, example: Example) -> np.ndarray:
        """Probabilities of one image, the `index`-th of its set."""
        probabilities = self.predict(example.rgb, example.geometry)
        full = class_probabilities(enlarge(probabilities, example.label))
        confusion = ConfusionMatrix()
        confusion.add(example.label, full.argmax(axis=2) + 1)
        self.reliability.add(example.label, full)
        if confusion.total:
            scores = confusion.scores()
            self.images.append(ImageScore(index, scores["class_avg"], scores["pixel_acc"]))
        return probabilities

    def ranked(self) -> list[ImageScore]:
        """Images by class average, the best first; equal ones by pixel accuracy, then in their order."""
        return sorted(self.images, key=lambda s: (-s.class_avg, -s.pixel_acc, s.index))


def enlarge(probabilities: np.ndarray, label: np.ndarray) -> np.ndarray:
    """Bilinear, shape (h, w, classes) to the size of a label image (H, W)."""
    return cv2.resize(probabilities, label.shape[::-1], interpolation=cv2.INTER_LINEAR)


def by_rank(count: int, best: int = 3, median: int = 4, worst: int = 3) -> list[int]:
    """Ranks (from 0) to show of so many: the first, those around the middle, the last; all if there are few."""
    if count <= best + median + worst:
        return list(range(count))
    first = (count - median) // 2
    return [*range(best), *range(first, first + median), *range(count - worst, count)]
