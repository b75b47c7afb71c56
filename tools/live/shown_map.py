"""The part of a growing map that a page shows: one point a cell, in chunks of space that are sent when they change."""

from dataclasses import dataclass

import numpy as np

CHUNK_M = 0.64
"""Edge of a chunk [m]."""
SHOWN_CELL_M = 0.01
"""Edge of a cell at first [m]; doubled whenever there are too many points."""


@dataclass
class ShownPoints:
    """Surfels, or what a page has of them; N rows each."""

    position: np.ndarray
    """[m], float32, shape (N, 3)."""
    colour: np.ndarray
    """RGB, uint8, shape (N, 3)."""
    label: np.ndarray
    """Class ids, uint8, shape (N,)."""

    def __len__(self) -> int:
        return len(self.label)

    def rows(self, chosen: np.ndarray) -> "ShownPoints":
        """Some of the rows."""
        return ShownPoints(self.position[chosen], self.colour[chosen], self.label[chosen])

    @staticmethod
    def of(surfels: dict[str, np.ndarray], rows: np.ndarray) -> "ShownPoints":
        """Rows of the arrays of a SurfelMap, as copies."""
        rgb = np.rint(surfels["colour"][rows].clip(0, 1) * 255).astype(np.uint8)
        return ShownPoints(surfels["position"][rows], rgb, surfels["label"][rows])


ChunkKey = tuple[int, int, int]


class ShownMap:
    """The newest surfel of each cell.

    Args:
        most: points at most; more make cells twice as wide.
    """

    def __init__(self, most: int = 400_000):
        self.most, self.cell = most, SHOWN_CELL_M
        self.chunks: dict[ChunkKey, ShownPoints] = {}
        self.changed: dict[ChunkKey, int] = {}
        """Chunks that differ from what was taken of them last, and in how many points."""

    def __len__(self) -> int:
        return sum(map(len, self.chunks.values()))

    def add(self, points: ShownPoints) -> None:
        """Put surfels into their cells, in place of those that are there."""
        for chunk, rows in _by_chunk(points.position).items():
            self._merge(chunk, points.rows(rows))
        while len(self) > self.most:
            self._coarsen()

    def replace(self, points: ShownPoints) -> None:
        """All surfels of the map, as they are now: what is no longer there goes."""
        before, self.chunks = self.chunks, {}
        changed = dict(self.changed)
        self.add(points)
        self.changed = changed
        for chunk in before.keys() | self.chunks.keys():
            old, new = before.get(chunk), self.chunks.get(chunk)
            if old is None or new is None or not np.array_equal(old.position, new.position):
                self.changed[chunk] = max(len(old or ()), len(new or ()))

    def take(self, budget: int) -> list[tuple[ChunkKey, ShownPoints | None]]:
        """The chunks that changed most, until they hold `budget` points (one at least); None: it is empty now."""
        taken: list[tuple[ChunkKey, ShownPoints | None]] = []
        for chunk in sorted(self.changed, key=lambda c: -self.changed[c]):
            if budget <= 0:
                break
            found = self.chunks.get(chunk)
            taken.append((chunk, found))
            del self.changed[chunk]
            budget -= len(found or ())
        return taken

    def touch_all(self) -> None:
        """Everything has to be sent again: it is shown otherwise."""
        for chunk, points in self.chunks.items():
            self.changed[chunk] = len(points)

    def _merge(self, chunk: ChunkKey, points: ShownPoints) -> None:
        old = self.chunks.get(chunk)
        if old is not None:
            points = ShownPoints(
                np.concatenate([points.position, old.position]),
                np.concatenate([points.colour, old.colour]),
                np.concatenate([points.label, old.label]),
            )
        keys = _keys(points.position, self.cell)
        _, first = np.unique(keys, return_index=True)  # of equal ones the first: the newest
        self.chunks[chunk] = points.rows(first)
        news = len(first) - len(old or ()) + int((first < len(keys) - len(old or ())).sum())
        self.changed[chunk] = self.changed.get(chunk, 0) + news

    def _coarsen(self) -> None:
        self.cell *= 2
        for chunk, points in self.chunks.items():
            _, first = np.unique(_keys(points.position, self.cell), return_index=True)
            self.chunks[chunk] = points.rows(first)
            self.changed[chunk] = len(first)


def _by_chunk(position: np.ndarray) -> dict[ChunkKey, np.ndarray]:
    """Rows of the points in each chunk."""
    if not len(position):
        return {}
    where = np.floor(position / CHUNK_M).astype(np.int64)
    chunks, inverse = np.unique(where, axis=0, return_inverse=True)
    order = np.argsort(inverse.reshape(-1), kind="stable")
    ends = np.cumsum(np.bincount(inverse.reshape(-1)))
    parts = np.split(order, ends[:-1])
    return {(int(x), int(y), int(z)): rows for (x, y, z), rows in zip(chunks, parts, strict=True)}


def _keys(position: np.ndarray, cell: float) -> np.ndarray:
    """A number for the cell that each point lies in, within 2^21 cells an axis."""
    at = np.floor(position / cell).astype(np.int64) & (1 << 21) - 1
    return at[:, 0] << 42 | at[:, 1] << 21 | at[:, 2]
