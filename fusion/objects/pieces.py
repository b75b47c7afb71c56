"""Pieces of one thing that the camera saw apart: the legs of a table, the rungs of a chair."""

import numpy as np

from dsmap.classes import CLASS_NAMES
from dsmap.fusion.objects.boxes import Box, fit_box
from dsmap.fusion.objects.segments import Cells

_MARGINS = {
    "bed": (0.6, 1.0), "chair": (0.1, 1.0), "furniture": (0.1, 1.0), "sofa": (0.1, 1.0), "table": (0.1, 1.0),
    "objects": (0.1, 0.15),
}  # fmt: skip
"""Classes whose things are seen in pieces; pieces of others have to touch. A piece of a thing lies over its ground, or
within the first number of it [m] (pillows hide what joins a bed to its head), no further above or below than the second
[m]..."""
_INSIDE = 0.6
"""... with this share of its cells."""
_HIGHEST = 1.3
"""Of a thing with legs, from its lowest piece to its highest [m]."""
_LEAST = 12
"""Cells of a piece that others may join."""


def join_pieces(cells: Cells, group: np.ndarray, labels: np.ndarray, up: np.ndarray) -> np.ndarray:
    """The groups of cells, shape (C,), after pieces of furniture joined the larger one that they stand over or under.

    Args:
        group: connected piece of each cell, shape (C,); -1: none.
        labels: class of each cell, shape (C,).
    """
    group = group.copy()
    for name, (margin, gap) in _MARGINS.items():
        here = (labels == CLASS_NAMES.index(name)) & (group >= 0)
        if not here.any():
            continue
        numbers, counts = np.unique(group[here], return_counts=True)
        larger: list[tuple[int, Box]] = []
        for number in numbers[np.argsort(-counts, kind="stable")].tolist():
            points = cells.position[here & (group == number)]
            home = next((n for n, box in larger if _belongs(points, box, margin, gap)), None)
            if home is None:
                if len(points) >= _LEAST:
                    larger.append((number, fit_box(points, up)))
                continue
            group[here & (group == number)] = home
            at = [n for n, _ in larger].index(home)
            larger[at] = home, fit_box(cells.position[here & (group == home)], up)
    return group


def _belongs(points: np.ndarray, box: Box, margin: float, gap: float) -> bool:
    local = (points - box.T_world_box[:3, 3]) @ box.T_world_box[:3, :3]
    over = (np.abs(local[:, :2]) < box.extent[:2] / 2 + margin).all(axis=1)
    heights = local[:, 2]
    half = box.extent[2] / 2
    tall = max(heights.max(), half) - min(heights.min(), -half)
    apart = max(heights.min() - half, -half - heights.max())
    return bool(over.mean() > _INSIDE and tall < _HIGHEST and apart < gap)
