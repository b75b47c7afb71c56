"""Pictures of what a network answers: the reliability of its probabilities, and images beside their labels."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from dsmap.classes import CLASS_NAMES, PALETTE, VOID, colourise
from dsmap.dsnet.scoring.measure import ImageScore
from dsmap.errors import InputError
from dsmap.files import atomic_path
from dsmap.metrics import NUM_BINS, Reliability

_DPI = 100
_CELL_WIDTH = 2.6
"""Inches of one picture."""
_OPACITY = 0.6


@dataclass(frozen=True)
class Overlay:
    """One image with what it shows and what was answered."""

    rgb: np.ndarray
    """uint8 (H, W, 3)."""
    label: np.ndarray
    """Class ids, uint8 (H, W), 0 = unlabelled."""
    answer: np.ndarray
    """Class ids, uint8 (H, W)."""
    score: ImageScore
    rank: int
    """From 0, the best."""


def draw_reliability(path: Path, reliability: Reliability, title: str = "") -> None:
    """Accuracy over confidence in 15 bins, the share of pixels below, ECE in the title (Guo et al. 2017)."""
    count = np.maximum(reliability.count, 1)
    accuracy, confidence = reliability.correct / count, reliability.confidence / count
    share = reliability.count / max(int(reliability.count.sum()), 1)
    width = 1 / NUM_BINS
    left = np.arange(NUM_BINS) * width
    some = reliability.count > 0
    figure = Figure(figsize=(5, 6), dpi=_DPI, layout="constrained")
    top, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    top.bar(left, accuracy, width, align="edge", color="#1f77b4", edgecolor="white", label="accuracy")
    top.plot(
        confidence[some], accuracy[some], "o", color="black", markersize=4, label="mean confidence of a bin"
    )
    top.plot([0, 1], [0, 1], "--", color="gray", label="honest")
    top.set(xlim=(0, 1), ylim=(0, 1), ylabel="share of pixels that are right")
    top.legend(loc="upper left", frameon=False)
    ece = reliability.ece()
    measured = "nothing to score" if ece is None else f"ECE {100 * ece:.1f} %, {NUM_BINS} bins"
    top.set_title(f"{title}\n{measured}" if title else measured)
    below.bar(left, share, width, align="edge", color="#7f7f7f", edgecolor="white")
    below.set(xlabel="largest probability", ylabel="share of pixels")
    _save(path, figure)


def draw_overlays(path: Path, overlays: Sequence[Overlay], count: int) -> None:
    """Image, label and answer of each, rank and scores above it, a legend of the classes below.

    Args:
        count: images that were ranked.
    """
    if not overlays:
        raise InputError(f"{path}: no labelled image to draw")
    blocks = 2 if len(overlays) > 1 else 1
    rows = -(-len(overlays) // blocks)
    height, width = overlays[0].label.shape
    cell = _CELL_WIDTH * height / width + 0.3
    foot = 0.7
    figure = Figure(figsize=(3 * blocks * _CELL_WIDTH, rows * cell + foot), dpi=_DPI)
    total = rows * cell + foot
    for k, overlay in enumerate(overlays):
        block, row = divmod(k, rows)
        pictures = (overlay.rgb, _blend(overlay.rgb, overlay.label), _blend(overlay.rgb, overlay.answer))
        for column, picture in enumerate(pictures):
            x = (3 * block + column) / (3 * blocks)
            bottom = (foot + (rows - 1 - row) * cell) / total
            axes = figure.add_axes((x + 0.002, bottom, 1 / (3 * blocks) - 0.004, (cell - 0.3) / total))
            axes.imshow(picture, aspect="auto")
            axes.set_axis_off()
            if column == 0:
                axes.set_title(_caption(overlay, count), fontsize=9, loc="left", pad=3)
    classes = sorted(set().union(*(np.unique(x) for o in overlays for x in (o.label, o.answer))))
    patches = [
        Patch(color=tuple(PALETTE[c] / 255), label="unlabelled" if c == VOID else CLASS_NAMES[c])
        for c in classes
    ]
    figure.legend(
        handles=patches, loc="lower center", ncols=(len(patches) + 1) // 2, frameon=False, fontsize=10
    )
    _save(path, figure)


def _caption(overlay: Overlay, count: int) -> str:
    score = overlay.score
    return (
        f"rank {overlay.rank + 1} of {count}: class average {100 * score.class_avg:.0f} %, "
        f"pixels {100 * score.pixel_acc:.0f} %   (image {score.index}; picture | label | answer)"
    )


def _blend(rgb: np.ndarray, label: np.ndarray) -> np.ndarray:
    """Class colours over the grey picture; unlabelled pixels are dark."""
    grey = np.repeat(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)[..., None], 3, axis=2)
    return (_OPACITY * colourise(label) + (1 - _OPACITY) * grey).astype(np.uint8)


def _save(path: Path, figure: Figure) -> None:
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = cv2.cvtColor(np.asarray(canvas.buffer_rgba())[..., :3].copy(), cv2.COLOR_RGB2BGR)
    quality = [] if path.suffix == ".png" else [cv2.IMWRITE_JPEG_QUALITY, 88]  # OpenCV warns of it in a PNG
    with atomic_path(path) as temporary:
        if not cv2.imwrite(str(temporary), pixels, quality):
            raise InputError(f"cannot write {path}: OpenCV could not encode or store the image")
