"""A floor plan for navigation: free, occupied and unknown cells, as ROS's map_server reads it (PGM and YAML).

A cell is occupied where surfels stand between the floor and the height of whoever moves there. It is free where the
floor was seen and nothing stands on it. All else is unknown. The floor is a height, and the labels' floor widens it: a
carpet's edge or a noisy measurement that is labelled floor is no obstacle.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy import ndimage

from dsmap.classes import CLASS_NAMES
from dsmap.errors import InputError
from dsmap.files import atomic_path
from dsmap.fusion.exports.level import transformed

CELL_M = 0.05
"""Edge of a cell by default [m]."""
BAND_M = (0.10, 1.80)
"""Heights above the floor at which surfels are in the way [m]: over thresholds and carpets, below door frames."""
_FLOOR_M = 0.07
"""A surfel that faces up is floor up to this height [m]..."""
_LABELLED_FLOOR_M = 0.20
"""... and up to this one if it is labelled so."""
_FACES_UP = 0.7
_ENOUGH = 3
"""Fewer surfels in a cell are noise."""
_MARGIN = 2
"""Unknown cells around the map."""
_GAP = 1
"""Gaps of up to twice so many cells are closed, in the floor and in what stands on it: between two surfels there is
more of the same."""
FREE, OCCUPIED, UNKNOWN = 254, 0, 205
"""Values of the PGM, as map_saver writes them."""


@dataclass
class Grid:
    """Cells of a floor plan."""

    cells: np.ndarray
    """FREE, OCCUPIED or UNKNOWN, uint8, shape (Y, X): the first row has the smallest y."""
    low: np.ndarray
    """Corner of the first cell in the level frame [m], shape (2,)."""
    cell: float
    """Edge of a cell [m]."""

    def count(self, points: np.ndarray) -> np.ndarray:
        """How many points [m] of the level frame, shape (N, 2) or more columns, lie over each cell, shape (Y, X)."""
        index = np.floor((points[:, :2] - self.low) / self.cell).astype(np.int64)
        height, width = self.cells.shape
        inside = ((index >= 0) & (index < [width, height])).all(axis=1)
        flat = index[inside, 1] * width + index[inside, 0]
        return np.bincount(flat, minlength=height * width).reshape(height, width)


def occupancy_grid(
    surfels: dict[str, np.ndarray],
    T_level_world: np.ndarray,
    cell: float = CELL_M,
    min_weight: float = 0.0,
    band: tuple[float, float] = BAND_M,
) -> Grid:
    """The floor plan of a map.

    Args:
        surfels: arrays by the names of `SurfelMap`.
        T_level_world: of `level_transform`.
        cell: edge of a cell [m].
        min_weight: surfels of a lower confidence are left out.
        band: heights above the floor at which a surfel is in the way [m].

    Raises:
        InputError: no surfel is left.
    """
    kept = (surfels["weight"] > 0) & (surfels["weight"] >= min_weight)
    if not kept.any():
        raise InputError(f"the map has no surfels of confidence {min_weight}, expected some")
    points = transformed(T_level_world, surfels["position"][kept].astype(np.float64))
    up = surfels["normal"][kept] @ T_level_world[2, :3]
    named = surfels["label"][kept] == CLASS_NAMES.index("floor")
    above = points[:, 2]
    floor = (up > _FACES_UP) & (np.abs(above) < np.where(named, _LABELLED_FLOOR_M, _FLOOR_M))
    in_the_way = (above > band[0]) & (above < band[1]) & ~floor
    low = np.floor(points[:, :2].min(axis=0) / cell) * cell - _MARGIN * cell
    width, height = np.floor((points[:, :2].max(axis=0) - low) / cell).astype(int) + 1 + _MARGIN
    grid = Grid(np.full((height, width), UNKNOWN, np.uint8), low, cell)
    standing = grid.count(points[in_the_way]) >= _ENOUGH
    # A table top of which some cells were hardly seen has no holes.
    occupied = standing | _closed(standing)
    seen = grid.count(points[floor]) > 0
    # Closing must not reach over an obstacle: the other side of a thin wall is another room.
    closed = _closed(seen)
    grid.cells[(seen | closed) & ~occupied] = FREE
    grid.cells[occupied] = OCCUPIED
    return grid


def _closed(cells: np.ndarray) -> np.ndarray:
    return np.asarray(ndimage.binary_closing(cells, np.ones((3, 3), bool), iterations=_GAP))


def write_occupancy(path: Path, grid: Grid, T_level_world: np.ndarray) -> int:
    """Write NAME.pgm and NAME.yaml; returns the number of free cells.

    The map's frame is the level frame; its place in dsmap's world stands in the YAML as a comment.
    """
    image = path.with_suffix(".pgm")
    with atomic_path(image) as temporary:
        temporary.write_bytes(
            cv2.imencode(".pgm", grid.cells[::-1])[1].tobytes()
        )  # a map's first row is its top
    rows = [" ".join(f"{v:.9g}" for v in row) for row in T_level_world]
    lines = [
        f"image: {image.name}", "mode: trinary", f"resolution: {grid.cell:g}",
        f"origin: [{grid.low[0]:.6f}, {grid.low[1]:.6f}, 0.0]", "negate: 0", "occupied_thresh: 0.65",
        "free_thresh: 0.196", "# T_map_world, rows of the transform from dsmap's world into this map's frame:",
        *(f"#   {row}" for row in rows),
    ]  # fmt: skip
    with atomic_path(path.with_suffix(".yaml")) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="ascii")
    return int((grid.cells == FREE).sum())
