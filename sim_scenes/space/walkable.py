"""The floor of a room that a person can walk on: what keeps furniture from walling anybody in."""

from collections.abc import Sequence

import numpy as np

from dsmap.sim_scenes.space.grids import distance_to_taken, regions

_CELL = 0.05
"""Side of a grid cell [m]."""
HALF_WIDTH = 0.35
"""A walker keeps this far from everything [m]: ways are at least twice as wide."""


class Walkable:
    """Grid of a room's floor: which cells are taken, and whether all doors stay joined by a way."""

    def __init__(self, low: np.ndarray, high: np.ndarray, half_width: float = HALF_WIDTH) -> None:
        self.half_width = half_width
        self.low = np.asarray(low, float)
        self.shape = tuple(np.maximum(1, np.floor((high - self.low) / _CELL).astype(int)))
        self.blocked = np.zeros(self.shape, bool)
        self.anchors: list[np.ndarray] = []
        """Places before doors that must stay reachable from one another [m], each (2,)."""
        self.least = 0.0
        """Floor that must stay walkable around the anchors [m^2]."""
        x, y = np.meshgrid(*[np.arange(n) for n in self.shape], indexing="ij")
        self._centres = self.low + (np.stack([x, y], -1) + 0.5) * _CELL

    def _take(self, blocked: np.ndarray, corners: np.ndarray) -> None:
        """Mark the cells of `blocked` whose centre lies in a convex polygon (K, 2), counter-clockwise."""
        low = np.clip(np.floor((corners.min(0) - self.low) / _CELL).astype(int), 0, self.shape)
        high = np.clip(np.ceil((corners.max(0) - self.low) / _CELL).astype(int) + 1, 0, self.shape)
        window = (slice(low[0], high[0]), slice(low[1], high[1]))
        edges = np.roll(corners, -1, 0) - corners
        offset = self._centres[window][..., None, :] - corners
        inside = (edges[:, 0] * offset[..., 1] - edges[:, 1] * offset[..., 0] >= -1e-9).all(-1)
        blocked[window] |= inside

    def block(self, corners: np.ndarray) -> None:
        """Take the cells of a convex polygon (K, 2), counter-clockwise."""
        self._take(self.blocked, corners)

    def stays_open(self, polygons: Sequence[np.ndarray]) -> bool:
        """Whether doors stay joined and enough floor free if these polygons were taken as well."""
        blocked = self.blocked.copy()
        for corners in polygons:
            self._take(blocked, corners)
        way = self.way(blocked)
        return way is not None and way.sum() * _CELL**2 >= self.least

    def way(self, blocked: np.ndarray | None = None) -> np.ndarray | None:
        """Cells that a walker's middle can reach from the doors (from anywhere where there are none).

        None where the doors are cut off from each other or the room has no free place.
        """
        taken = np.pad(self.blocked if blocked is None else blocked, 1, constant_values=True)
        free = distance_to_taken(~taken)[1:-1, 1:-1] * _CELL > self.half_width
        parts, count = regions(free)
        if count == 0:
            return None
        if not self.anchors:
            return parts == 1 + int(np.argmax(np.bincount(parts.ravel())[1:]))
        found = {self._part_at(parts, xy) for xy in self.anchors}
        if len(found) != 1 or 0 in found:
            return None
        return parts == found.pop()

    def _part_at(self, parts: np.ndarray, xy: np.ndarray) -> int:
        """The connected part that a place belongs to, give or take 10 cm; 0 = none."""
        cell = np.floor((xy - self.low) / _CELL).astype(int)
        (x0, y0), (x1, y1) = np.maximum(cell - 2, 0), cell + 3
        near = parts[x0:x1, y0:y1]
        return int(near.max()) if near.size else 0
