"""A contact sheet: one view of each of many scenes, colour and classes side by side, with a legend."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from dsmap.classes import CLASS_NAMES, NUM_CLASSES, PALETTE, colourise
from dsmap.errors import InputError
from dsmap.files import atomic_path
from dsmap.sim_scenes.recording.dataset import plan, worker_pool
from dsmap.sim_scenes.recording.open_scene import open_scene
from dsmap.sim_scenes.recording.record import RenderOptions, iter_frames

_VIEWS = 4
"""Views rendered of each scene; the one that shows the most classes is taken."""
_GAP = 4
_LEGEND = 22
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def contact_sheet(
    path: Path | str,
    base: RenderOptions,
    *,
    columns: int = 5,
    rows: int = 6,
    jobs: int = 1,
    done: Callable[[], object] = lambda: None,
) -> Path:
    """Render columns x rows scenes (of consecutive seeds) and write one picture; returns its path.

    Raises:
        InputError: options out of range, or the picture cannot be written.
    """
    if columns < 1 or rows < 1:
        raise InputError(f"the sheet is {columns}x{rows}; expected at least 1x1")
    path = Path(path)
    if path.suffix.lower() not in (".png", ".jpg"):
        raise InputError(f"{path}: the suffix is {path.suffix!r}; expected .png or .jpg")
    base = replace(base, path="views", frames=_VIEWS, jobs=1)
    options = [task.options for task in plan(Path(), base, columns * rows)]
    cells = []
    with worker_pool(jobs) as pool:
        for cell in pool.map(best_view, options):
            cells.append(cell)
            done()
    sheet = _arrange(cells, columns)
    with atomic_path(path) as file:
        cv2.imwrite(str(file), np.ascontiguousarray(sheet[..., ::-1]))
    return path


def best_view(options: RenderOptions) -> np.ndarray:
    """The view of a scene that shows the most classes: colour beside classes, uint8 (H, 2 W, 3)."""
    frames = list(iter_frames(open_scene(options), options))
    frame = max(frames, key=lambda f: _variety(f.label))
    return np.concatenate([frame.rgb, colourise(frame.label)], 1)


def _variety(label: np.ndarray) -> float:
    """Entropy of an image's classes."""
    share = np.bincount(label.ravel(), minlength=NUM_CLASSES) / label.size
    share = share[share > 0]
    return float(-(share * np.log(share)).sum())


def _arrange(cells: list[np.ndarray], columns: int) -> np.ndarray:
    height, width = cells[0].shape[:2]
    rows = -(-len(cells) // columns)
    sheet = np.full((rows * (height + _GAP) + _LEGEND, columns * (width + _GAP) - _GAP, 3), 255, np.uint8)
    for k, cell in enumerate(cells):
        y, x = k // columns * (height + _GAP), k % columns * (width + _GAP)
        sheet[y : y + height, x : x + width] = cell
    step = sheet.shape[1] / (NUM_CLASSES - 1)
    size = min(0.45, step / 190)
    for k in range(1, NUM_CLASSES):
        left, top = int((k - 1) * step), sheet.shape[0] - _LEGEND + 4
        cv2.rectangle(sheet, (left, top), (left + 14, top + 14), PALETTE[k].tolist(), cv2.FILLED)
        cv2.putText(sheet, CLASS_NAMES[k], (left + 18, top + 12), _FONT, size, (0, 0, 0), 1, cv2.LINE_AA)
    return sheet
