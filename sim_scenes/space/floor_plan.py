"""A scene's floor seen from above: what is in the way of things that slide, roll or walk on it."""

import numpy as np

from dsmap.sim_scenes.scene import Scene
from dsmap.sim_scenes.space.free_space import surface_samples
from dsmap.sim_scenes.space.grids import distance_to_taken

_CELL = 0.05
"""Side of a cell [m]."""


class FloorPlan:
    """Distance of floor points to what stands between two heights, some instances left out."""

    def __init__(self, scene: Scene, band: tuple[float, float], without: range = range(0)) -> None:
        vertices, faces, _, instance = scene.surface()
        kept = ~np.isin(instance, list(without))
        used, renumbered = np.unique(faces[kept], return_inverse=True)
        points = surface_samples(
            vertices[used], renumbered.reshape(-1, 3), 0.03, np.random.default_rng(scene.seed)
        )
        points = points[(points[:, 2] > band[0]) & (points[:, 2] < band[1])][:, :2]
        boxes = [(r.low, r.high) for r in scene.rooms] or [(vertices[:, :2].min(0), vertices[:, :2].max(0))]
        self.low = np.min([b[0] for b in boxes], 0) - 2 * _CELL
        shape = np.ceil((np.max([b[1] for b in boxes], 0) - self.low) / _CELL).astype(int) + 2
        free = np.zeros(shape, bool)
        for low, high in boxes:
            a, b = (np.round((c - self.low) / _CELL).astype(int) for c in (low, high))
            free[a[0] : b[0], a[1] : b[1]] = True
        cell = np.floor((points - self.low) / _CELL).astype(int)
        cell = cell[((cell >= 0) & (cell < shape)).all(1)]
        free[tuple(cell.T)] = False
        self.distance = distance_to_taken(free, _CELL)

    def room(self, xy: np.ndarray) -> np.ndarray:
        """Distance to the nearest obstacle at points (..., 2) [m]."""
        index = np.floor((np.asarray(xy) - self.low) / _CELL).astype(int)
        inside = ((index >= 0) & (index < self.distance.shape)).all(-1)
        index = np.clip(index, 0, np.array(self.distance.shape) - 1)
        return np.where(inside, self.distance[index[..., 0], index[..., 1]], 0.0)

    def runs(
        self, xy: np.ndarray, angles: np.ndarray, radius: float, limit: float, leave: float
    ) -> np.ndarray:
        """How far a disc can slide from a point (2,) in each direction [m], shape (A,).

        For the first `leave` metres it need not fit, as long as it gets freer: a chair is drawn from under a table.
        """
        steps = np.arange(0.0, limit + _CELL, _CELL)
        ways = np.stack([np.cos(angles), np.sin(angles)], -1)
        room = self.room(xy + steps[None, :, None] * ways[:, None])
        leaving = np.maximum.accumulate(room, axis=1) - room < 0.08
        fits = (room >= radius) | ((steps < leave) & leaving)
        return steps[np.where(fits.all(1), len(steps) - 1, np.maximum(fits.argmin(1) - 1, 0))]

    def spots(self, rng: np.random.Generator, radius: float, count: int) -> np.ndarray:
        """Up to `count` random floor points where a disc fits [m], shape (N, 2)."""
        cells = np.argwhere(self.distance >= radius)
        chosen = cells[rng.permutation(len(cells))[:count]]
        return self.low + (chosen + 0.5) * _CELL
