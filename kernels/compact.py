"""Compaction: the rows of dead surfels are closed up, a bounded number of rows a frame.

The living keep their order, so it makes no difference to any result when and how far a map is compacted.
"""

import numpy as np
import warp as wp

from dsmap.kernels.culling import Blocks
from dsmap.kernels.launch import BLOCK
from dsmap.kernels.types import ARRAYS, SurfelMap

DEAD_SHARE = 0.15
"""Share of dead surfels, of the whole map or of its newer end, from which moving the others up pays."""
MIN_DEAD = 1024
"""Fewer dead surfels are not worth a compaction."""


def compact(surfels: SurfelMap, first: int = 0) -> int:
    """Remove the dead surfels from row `first` on, keeping the others in order; returns how many were removed.

    Surfel indices held elsewhere (index maps, matches) are void afterwards.
    """
    m = surfels
    dead = m.weight[: m.count].numpy()[first:] <= 0.0
    removed = int(np.count_nonzero(dead))
    if removed == 0:
        return 0
    first += int(np.argmax(dead))  # all before the first dead one stay where they are
    m.count = _move(m, first, first, m.count)
    return removed


class Compaction:
    """Compaction that goes on from frame to frame: at most `rows` rows are looked at and moved at a time.

    A sweep starts where the rest of the map holds enough dead surfels to pay. Most die young, at the map's
    newer end, so that a large map is seldom swept from its beginning. While it runs there is a gap of dead
    rows between what has been moved and what has not.
    """

    def __init__(self, surfels: SurfelMap, blocks: Blocks, rows: int = 1 << 16):
        self.surfels, self.blocks, self.rows = surfels, blocks, rows
        self._to = self._next = 0  # [to, next) is the gap; no compaction runs where next == 0

    @property
    def cursor(self) -> tuple[int, int]:
        """Rows (to, next) between which the gap lies; next is 0 where no compaction runs. May be set, to go on."""
        return self._to, self._next

    @cursor.setter
    def cursor(self, rows: tuple[int, int]) -> None:
        self._to, self._next = rows

    def step(self) -> bool:
        """One frame's share, or the start of a compaction where one pays; returns whether surfels were moved."""
        m = self.surfels
        if self._next == 0:
            start = sweep_from(self.blocks.dead)
            if start is None:
                return False
            self._to = self._next = start * int(BLOCK)
        begin, end = self._next, min(self._next + self.rows, m.count)
        first, self._to = self._to, _move(m, self._to, begin, end)
        if self._to < end:
            m.weight[max(self._to, begin) : end].zero_()
        self._next = end
        if end == m.count:
            m.count, self._next = self._to, 0
            self.blocks.forget(first)
        else:
            changed = np.zeros(-(-m.count // int(BLOCK)), dtype=bool)
            for a, b in ((first, self._to), (begin, end)):
                changed[a // int(BLOCK) : -(-b // int(BLOCK))] = True
            numbers = np.flatnonzero(changed).astype(np.int32)
            self.blocks.measure(wp.array(numbers, device=m.device))
        return True


def sweep_from(dead: np.ndarray) -> int | None:
    """First block of the longest end of the map that is worth a compaction; None where none is.

    dead: dead surfels of every block, shape (blocks,).
    """
    behind = np.cumsum(dead[::-1])[::-1]
    rows = np.arange(len(dead), 0, -1) * int(BLOCK)
    worth = np.flatnonzero((behind >= DEAD_SHARE * rows) & (behind >= MIN_DEAD))
    if len(worth) == 0:
        return None
    return int(worth[0] + np.argmax(dead[worth[0] :] > 0))


def _move(m: SurfelMap, to: int, begin: int, end: int) -> int:
    """Move the living among rows begin .. end - 1 up to row `to` <= begin; returns the row after the last."""
    alive = m.weight[begin:end].numpy() > 0.0
    moved = np.flatnonzero(alive) + begin
    after = to + len(moved)
    for name in ARRAYS if len(moved) else ():
        array = getattr(m, name)
        if m.device.is_cuda:
            rows = array[wp.array(moved, dtype=wp.int32, device=m.device)]
            wp.copy(array[to:after], rows.contiguous())
        else:  # NumPy gathers rows about four times as fast as a Warp copy of an indexed array
            array.numpy()[to:after] = array.numpy().take(moved, axis=0)
    return after
