"""Where a camera can be: clearance from every surface, ways for a person through rooms and doors, lines of sight."""

from functools import cached_property

import numpy as np
from scipy import ndimage
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from dsmap.errors import InputError
from dsmap.sim_scenes.scene import Scene
from dsmap.sim_scenes.space.grids import distance_to_taken, regions

_CELL = 0.06
"""Side of a voxel [m]."""
CEILING = 2.2
"""No camera is held above [m]."""
EYE_BAND = (1.15, 1.7)
"""Heights at which a walking person holds the camera [m]."""
BODY_BAND = (0.12, 1.9)
"""Heights that a walking person takes up [m]: door sills and rugs are below."""
HALF_BODY = 0.24
"""A walking person's middle keeps this far from everything [m]."""
HIDDEN_M3 = 1.5
"""Free space smaller than this and cut off from the rooms is the inside of furniture."""


class FreeSpace:
    """Distances from any point of a scene's rooms to the nearest surface."""

    def __init__(self, scene: Scene, swept: np.ndarray | None = None) -> None:
        """`swept`: points (N, 3) that moving things come by, counted as surfaces like those of things at rest."""
        self.name = f"scene {scene.name} seed {scene.seed}"
        vertices, faces, _, _ = scene.surface()
        self._samples = surface_samples(vertices, faces, 0.035, np.random.default_rng(scene.seed))
        if swept is not None:
            self._samples = np.concatenate([self._samples, swept])
        boxes = [(room.low, room.high) for room in scene.rooms] or [
            (vertices[:, :2].min(0), vertices[:, :2].max(0))
        ]
        self.low = np.array([*np.min([b[0] for b in boxes], 0), 0.0])
        self.high = np.array([*np.max([b[1] for b in boxes], 0), min(CEILING, float(vertices[:, 2].max()))])
        self.shape = tuple(np.ceil((self.high - self.low) / _CELL).astype(int))
        floor = np.zeros(self.shape[:2], bool)
        for low, high in boxes:
            floor |= self._floor(low, high)
        for door in scene.doors:
            half = np.abs(door.normal) * 0.4 + np.abs(door.normal[::-1]) * door.width / 2
            floor |= self._floor(door.centre - half, door.centre + half)
        self.open, self._distance = self._voxels(floor)

    def _floor(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Columns whose middle lies in a rectangle, bool (X, Y)."""
        x, y = (self.low[k] + (np.arange(self.shape[k]) + 0.5) * _CELL for k in (0, 1))
        return ((x > low[0]) & (x < high[0]))[:, None] & ((y > low[1]) & (y < high[1]))[None]

    def _voxels(self, floor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Free voxels that are not shut up in furniture, bool (X, Y, Z), and their distance to what is not [m]."""
        solid = np.zeros(self.shape, bool)
        cells, inside = self.cells(self._samples)
        solid[tuple(cells[inside].T)] = True
        solid |= ~floor[..., None]
        # Beyond the rooms all is solid: pad, so that the outermost voxels know it.
        padded = np.pad(~solid, ((1, 1), (1, 1), (1, 0)))
        distance = distance_to_taken(padded, _CELL)[1:-1, 1:-1, 1:]
        parts, count = regions(distance > 0.12)
        if count == 0:
            raise InputError(f"{self.name} leaves the camera no free space")
        size = np.bincount(parts.ravel(), minlength=count + 1) * _CELL**3
        size[0] = 0
        kept = (size > HIDDEN_M3) | (size == size.max())
        kept[0] = False
        return kept[parts], distance

    def cells(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Voxel of each of points (N, 3), clipped to the grid, (N, 3), and whether it was inside, (N,)."""
        index = np.floor((points - self.low) / _CELL).astype(int)
        shape = np.array(self.shape)
        return np.clip(index, 0, shape - 1), np.all((index >= 0) & (index < shape), axis=-1)

    @cached_property
    def _tree(self) -> KDTree:
        return KDTree(self._samples[self._samples[:, 2] < CEILING + 0.5])

    def clearance(self, points: np.ndarray) -> np.ndarray:
        """Distance to the nearest surface [m] of points (N, 3), good to about 2 cm.

        0 outside the rooms, inside furniture, and closer than about 12 cm to anything.
        """
        cells, inside = self.cells(points)
        return np.where(inside & self.open[tuple(cells.T)], self._tree.query(points)[0], 0.0)

    def sample(
        self, rng: np.random.Generator, count: int, heights: tuple[float, float], clearance: float
    ) -> np.ndarray:
        """Up to `count` random points [m], shape (N, 3), at eye heights and clear of all surfaces."""
        low, high = self.low.copy(), self.high.copy()
        low[2], high[2] = heights
        filled = float(self.open.mean()) + 0.02
        points = rng.uniform(low, high, (int(4 * count / filled), 3))
        return points[self.clearance(points) >= clearance][:count]

    def reach(self, eye: np.ndarray, direction: np.ndarray, limit: float) -> np.ndarray:
        """How far one sees from points (N, 3) along unit vectors (N, 3) before something solid [m], up to `limit`."""
        steps = np.arange(2 * _CELL, limit + _CELL, _CELL * 0.7)
        points = eye[:, None] + steps[:, None] * direction[:, None]
        cells, inside = self.cells(points.reshape(-1, 3))
        blocked = (inside & (self._distance[tuple(cells.T)] <= 0)).reshape(points.shape[:2])
        first = np.where(blocked.any(1), blocked.argmax(1), len(steps) - 1)
        return np.minimum(steps[first], limit)

    @cached_property
    def ways(self) -> "Ways":
        """The floor as a walking person sees it."""
        return Ways(self)

    def eye_clearance(self) -> np.ndarray:
        """Least distance to anything over `EYE_BAND` at each column [m], 0 where shut up, shape (X, Y)."""
        first, last = (int(h / _CELL) for h in EYE_BAND)
        band = np.where(self.open, self._distance, 0.0)[:, :, first : last + 1]
        return band.min(2)

    def body_clearance(self) -> np.ndarray:
        """Distance of each column to the nearest one with something in `BODY_BAND` [m], shape (X, Y)."""
        first, last = (int(h / _CELL) for h in BODY_BAND)
        taken = (self._distance[:, :, first : last + 1] <= 0).any(2)
        return distance_to_taken(np.pad(~taken, 1), _CELL)[1:-1, 1:-1]


class Ways:
    """Shortest comfortable ways over the floor, as a graph of its walkable columns."""

    def __init__(self, space: FreeSpace) -> None:
        self.space = space
        eye, body = space.eye_clearance(), space.body_clearance()
        self.clear = np.minimum(eye, body + 0.12)
        self.walkable = self._largest((eye > 0.27) & (body > HALF_BODY))
        if self.walkable.sum() * _CELL**2 < 0.4:
            # A crammed room: a camera fits where a person hardly does.
            self.walkable = self._largest(eye > 0.2)
        if not self.walkable.any():
            raise InputError(f"{space.name} leaves the camera no free space")
        self._number = np.full(self.walkable.shape, -1)
        self._number[self.walkable] = np.arange(self.walkable.sum())
        self.points = space.low[:2] + (np.argwhere(self.walkable) + 0.5) * _CELL
        self.room_left = self.clear[self.walkable]
        self._graph = self._edges()

    @staticmethod
    def _largest(free: np.ndarray) -> np.ndarray:
        parts, count = regions(free)
        return parts == 1 + int(np.argmax(np.bincount(parts.ravel())[1:])) if count else free

    def _edges(self) -> csr_array:
        """Steps to the eight neighbours; their cost is their length, more where it is narrow."""
        count, rows, columns, costs = len(self.points), [], [], []
        comfort = 1.0 + 3.0 * np.clip(0.6 - self.room_left, 0, 0.6) / 0.6
        padded = np.pad(self._number, 1, constant_values=-1)
        cells = np.argwhere(self.walkable) + 1
        for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
            other = padded[cells[:, 0] + dx, cells[:, 1] + dy]
            here = np.flatnonzero(other >= 0)
            there = other[here]
            length = _CELL * np.hypot(dx, dy) * (comfort[here] + comfort[there]) / 2
            rows += [here, there]
            columns += [there, here]
            costs += [length, length]
        return csr_array(
            (np.concatenate(costs), (np.concatenate(rows), np.concatenate(columns))), shape=(count, count)
        )

    def nearest(self, xy: np.ndarray) -> int:
        """Number of the walkable column nearest to a floor point (2,)."""
        return int(np.argmin(np.square(self.points - xy).sum(1)))

    def costs(self, start: int) -> np.ndarray:
        """Cost of the best way from a column to every column, shape (N,); metres where there is room."""
        return dijkstra(self._graph, indices=start)

    def way(self, start: int, goal: int) -> np.ndarray:
        """The best way between two columns as floor points [m], shape (M, 2), both ends included."""
        _, before = dijkstra(self._graph, indices=start, return_predecessors=True)
        steps = [goal]
        while steps[-1] != start:
            steps.append(int(before[steps[-1]]))
        return self.points[steps[::-1]]

    def clearance_at(self, xy: np.ndarray) -> np.ndarray:
        """Room on all sides at floor points (N, 2) [m], bilinear between columns."""
        at = (xy - self.space.low[:2]) / _CELL - 0.5
        return ndimage.map_coordinates(self.clear, at.T, order=1, mode="nearest")


def surface_samples(
    vertices: np.ndarray, faces: np.ndarray, spacing: float, rng: np.random.Generator
) -> np.ndarray:
    """Random points on triangles, about one per `spacing` squared [m], and every vertex; shape (N, 3)."""
    corner = vertices[faces]
    area = 0.5 * np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    owner = rng.choice(len(faces), int(area.sum() / spacing**2), p=area / area.sum())
    u, v = rng.random((2, len(owner), 1))
    flip = u + v > 1
    u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
    a, b, c = corner[owner].transpose(1, 0, 2)
    return np.concatenate([a + u * (b - a) + v * (c - a), vertices])
