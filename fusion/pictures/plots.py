"""Images with legends, colour bars and axes, drawn by matplotlib without a screen."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from dsmap.classes import CLASS_NAMES, PALETTE
from dsmap.errors import InputError
from dsmap.files import atomic_path

_DPI = 100
_LEGEND_CODE = {(True, True): 1, (True, False): 2, (False, False): 3, (False, True): 4}
"""matplotlib's code of a corner, by (top, right)."""
_LOG_TICKS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)


def through_colour_map(name: str, values: np.ndarray) -> np.ndarray:
    """Values in [0, 1], shape (N,), through a matplotlib colour map: RGB, uint8, shape (N, 3)."""
    return matplotlib.colormaps[name](values, bytes=True)[..., :3]


def save_image(path: Path, image: np.ndarray) -> None:
    """Write an RGB image, uint8, shape (H, W, 3), as PNG.

    Raises:
        InputError: the file cannot be written.
    """
    with atomic_path(path) as temporary:
        if not cv2.imwrite(str(temporary), cv2.cvtColor(image, cv2.COLOR_RGB2BGR)):
            raise InputError(f"cannot write {path}: OpenCV could not encode or store the image")


def save_with_legend(path: Path, image: np.ndarray, classes: Sequence[int]) -> None:
    """Write an RGB image with a legend of the given class ids in its emptiest corner."""
    figure = _image_figure(image)
    top, right = _emptiest_corner(image, 0.16, 0.03 + 0.032 * len(classes))
    figure.legend(handles=_patches(classes), loc=_LEGEND_CODE[top, right], fontsize=13, borderaxespad=1.2)
    _save(figure, path)


def save_with_bar(
    path: Path, image: np.ndarray, cmap: str, low: float, high: float, log: bool, title: str
) -> None:
    """Write an RGB image with the colour bar of `cmap` from `low` to `high` in its emptiest corner."""
    figure = _image_figure(image)
    top, right = _emptiest_corner(image, 0.36, 0.13)
    axes = figure.add_axes((0.67 if right else 0.03, 0.91 if top else 0.06, 0.3, 0.02), zorder=1)
    norm = LogNorm(low, high) if log else Normalize(low, high)
    bar = figure.colorbar(ScalarMappable(norm, cmap), cax=axes, orientation="horizontal")
    axes.set_title(title, fontsize=13, pad=5)
    axes.tick_params(labelsize=11)
    if log:
        ticks = [tick for tick in _LOG_TICKS if low <= tick <= high]
        bar.set_ticks(ticks, labels=[str(tick) for tick in ticks])
        bar.minorticks_off()
    _save(figure, path)


Tile = tuple[str, np.ndarray | None]
"""Title and RGB image of a cell of a grid; None where a row has no such image."""


def save_grid(path: Path, rows: Sequence[Sequence[Tile]], classes: Sequence[int], width: int = 1280) -> None:
    """Write rows of titled RGB images side by side, with a legend of `classes` below."""
    shown = next(image for row in rows for _, image in row if image is not None)
    columns = max(len(row) for row in rows)
    gap, head, foot = 0.04, 0.3, 0.55 if len(classes) else 0.05
    cell_width = width / _DPI / columns
    cell_height = (cell_width - gap) * shown.shape[0] / shown.shape[1] + gap
    total = head + foot + cell_height * len(rows)
    figure = Figure(figsize=(width / _DPI, total), dpi=_DPI)
    for r, row in enumerate(rows):
        for c, (title, image) in enumerate(row):
            bottom = total - head - (r + 1) * cell_height + gap
            box = (
                c / columns,
                bottom / total,
                (cell_width - gap) * _DPI / width,
                (cell_height - gap) / total,
            )
            axes = figure.add_axes(box)
            axes.axis("off")
            if r == 0:
                axes.set_title(title, fontsize=12, pad=4)
            if image is not None:
                axes.imshow(image, aspect="auto", interpolation="antialiased")
            else:
                axes.text(0.5, 0.5, "none for this frame", ha="center", va="center", color="0.5")
    if len(classes):
        figure.legend(handles=_patches(classes), loc="lower center", ncols=7, fontsize=11, frameon=False)
    _save(figure, path)


def save_trajectory(
    path: Path, positions: np.ndarray, lost: np.ndarray, reference: np.ndarray | None, title: str
) -> None:
    """Write the camera path from above and from the side, in metres, with equal axes.

    Args:
        positions: camera centres in level axes (z up) [m], shape (M, 3).
        lost: True where the frame was not tracked, shape (M,).
        reference: the reference's camera centres in the same axes, shape (K, 3), or None.
    """
    everything = positions if reference is None else np.concatenate([positions, reference])
    span = np.ptp(everything, axis=0)
    figure = Figure(figsize=(12.8, 6.4), dpi=_DPI, layout="constrained")
    figure.suptitle(title, fontsize=13)
    wide = span[1] + span[2] < span[0]
    panels = figure.subplots(2, 1) if wide else figure.subplots(1, 2)
    for axes, (across, along, name) in zip(
        panels, ((0, 1, "from above"), (0, 2, "from the side")), strict=True
    ):
        if reference is not None:
            axes.plot(reference[:, across], reference[:, along], color="0.55", lw=3, label="reference")
        axes.plot(positions[:, across], positions[:, along], color=PALETTE[6] / 255, lw=1.4, label="estimate")
        axes.plot(*positions[0, [across, along]], "o", color=PALETTE[9] / 255, label="start")
        axes.plot(*positions[-1, [across, along]], "s", color=PALETTE[1] / 255, label="end")
        if lost.any():
            axes.plot(*positions[lost][:, [across, along]].T, "x", color=PALETTE[4] / 255, label="lost")
        axes.set(title=name, xlabel="xyz"[across] + " [m]", ylabel="xyz"[along] + " [m]")
        axes.set_aspect("equal", adjustable="datalim")
        axes.grid(color="0.9")
    panels[0].legend(fontsize=11)
    _save(figure, path)


def _image_figure(image: np.ndarray) -> Figure:
    """A figure of exactly the image's pixels."""
    figure = Figure(figsize=(image.shape[1] / _DPI, image.shape[0] / _DPI), dpi=_DPI)
    figure.figimage(image)
    return figure


def _emptiest_corner(image: np.ndarray, width: float, height: float) -> tuple[bool, bool]:
    """(top, right) of the corner box, given by its shares of the image, that holds the fewest dark pixels."""
    rows, columns = int(height * image.shape[0]), int(width * image.shape[1])
    drawn: np.ndarray = np.any(image < 250, axis=2)
    corners = [(True, True), (False, True), (True, False), (False, False)]

    def filled(corner: tuple[bool, bool]) -> int:
        band = drawn[:rows] if corner[0] else drawn[-rows:]
        return int((band[:, -columns:] if corner[1] else band[:, :columns]).sum())

    return min(corners, key=filled)


def _patches(classes: Sequence[int]) -> list[Patch]:
    return [Patch(color=PALETTE[i] / 255, label="unlabelled" if i == 0 else CLASS_NAMES[i]) for i in classes]


def _save(figure: Figure, path: Path) -> None:
    FigureCanvasAgg(figure)
    with atomic_path(path) as temporary:
        figure.savefig(temporary)
