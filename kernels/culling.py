"""Culling: what a frame costs follows what the camera sees, not how large the map is.

Surfels lie in memory in the order in which they were inserted, so neighbours in memory were first seen by
the same few frames and are near each other. A block is BLOCK of them in a row. For every block the map's
owner keeps a bounding box and what else decides whether a kernel has to visit it; a frame tests the blocks
(40,000 in a map of 10 million surfels) and its kernels walk the surfels of those that may be in view.
Compared with a hash of world cells nothing has to be sorted, moved or kept consistent when surfels move:
the boxes of the blocks that were walked are measured again, 36 bytes a block, an eighth of a byte a surfel.
The results are bit for bit those of walking every surfel.
"""

from typing import Any

import numpy as np
import warp as wp

from dsmap.kernels.camera import Camera
from dsmap.kernels.index_map import MAX_COARSE_SPLAT, MAX_SPLAT
from dsmap.kernels.launch import BLOCK, Slice, launch_rows
from dsmap.kernels.types import SurfelArrays, SurfelMap

_NEVER = wp.constant(2**31 - 1)
_BORDER, _COARSE_BORDER = float(MAX_SPLAT) + 1.0, float(MAX_COARSE_SPLAT) + 1.0
"""Surfels this far [px] outside the image may still reach into it with their discs."""
_SLACK = 1e-3
"""Rounding [m] of single-precision positions in maps of up to a kilometre."""
_planes = wp.types.matrix(shape=(6, 4), dtype=wp.float32)


@wp.kernel
def _measure(
    s: Slice,
    blocks: wp.array(dtype=wp.int32),
    count: int,
    stable_weight: float,
    m: SurfelArrays,
    low: wp.array(dtype=wp.vec3),
    high: wp.array(dtype=wp.vec3),
    living: wp.array(dtype=wp.int32),
    waiting: wp.array(dtype=wp.int32),
    oldest: wp.array(dtype=wp.int32),
):
    # One thread a block, on CUDA as well: launch_rows with one lane.
    row, lane = wp.tid()
    b = blocks[s.first + s.stride * row]
    lo = wp.vec3(1.0e30, 1.0e30, 1.0e30)
    hi = wp.vec3(-1.0e30, -1.0e30, -1.0e30)
    alive = int(0)
    first_unstable = int(_NEVER)
    first = int(_NEVER)
    for i in range(b * BLOCK, wp.min((b + 1) * BLOCK, count)):
        w = m.weight[i]
        if w > 0.0:
            alive += 1
            lo = wp.min(lo, m.position[i])
            hi = wp.max(hi, m.position[i])
            t = m.t_updated[i]
            first = wp.min(first, t)
            if w < stable_weight:
                first_unstable = wp.min(first_unstable, t)
    low[b] = lo
    high[b] = hi
    living[b] = alive
    waiting[b] = first_unstable
    oldest[b] = first


@wp.kernel
def _test(
    s: Slice,
    planes: _planes,
    low: wp.array(dtype=wp.vec3),
    high: wp.array(dtype=wp.vec3),
    living: wp.array(dtype=wp.int32),
    seen: wp.array(dtype=wp.uint8),
):
    row, lane = wp.tid()
    b = s.first + s.stride * row
    inside = living[b] > 0
    lo = low[b]
    hi = high[b]
    for k in range(6):
        if inside:
            # The corner of the box that lies furthest along the plane's normal.
            x = planes[k, 0] * wp.where(planes[k, 0] > 0.0, hi[0], lo[0])
            y = planes[k, 1] * wp.where(planes[k, 1] > 0.0, hi[1], lo[1])
            z = planes[k, 2] * wp.where(planes[k, 2] > 0.0, hi[2], lo[2])
            inside = x + y + z + planes[k, 3] >= 0.0
    seen[b] = wp.where(inside, wp.uint8(1), wp.uint8(0))


def frustum(
    camera: Camera, T_world_camera: np.ndarray, max_depth: float, border: float = _BORDER
) -> np.ndarray:
    """Planes (n, d) of what a camera sees up to max_depth [m], padded; shape (6, 4), world frame.

    A world point x may be seen only if n . x + d >= 0 for all six; |n| = 1.
    """
    left, top = camera.cx + border, camera.cy + border
    right, bottom = camera.width + border - camera.cx, camera.height + border - camera.cy
    sides = [[camera.fx, 0, left], [-camera.fx, 0, right], [0, camera.fy, top], [0, -camera.fy, bottom]]
    planes = np.array([[*normal, 0] for normal in [*sides, [0, 0, 1], [0, 0, -1]]], dtype=np.float64)
    planes[5, 3] = max_depth
    planes /= np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    planes[:, 3] += _SLACK
    return planes @ np.linalg.inv(T_world_camera)


class Blocks:
    """Where the blocks of a map lie; which of them a view, or the clean-up, has to walk.

    Whoever changes the map says so: `measure` after a frame was fused and cleaned up, `forget` after surfels
    were moved by other means (deformation, compaction, loading). Blocks of surfels that were appended since
    are found by themselves.

    Args:
        surfels: the map; may grow, shrink and be replaced in its arrays.
        stable_weight: surfel confidence from which a surfel no longer waits to be confirmed.
        coarse: whether it has a finest resolution: then discs from further outside an image reach into it.
    """

    def __init__(self, surfels: SurfelMap, stable_weight: float, coarse: bool = False):
        self.surfels, self.stable_weight = surfels, stable_weight
        self._border = _COARSE_BORDER if coarse else _BORDER
        self._known = 0  # surfels, from the front, whose blocks have been measured
        self._allocate(0)

    @property
    def nbytes(self) -> int:
        """Bytes allocated for all blocks."""
        return sum(
            array.capacity for array in (self._low, self._high, self._living, self._waiting, self._oldest)
        )

    @property
    def dead(self) -> np.ndarray:
        """Dead surfels of every block, int, shape (blocks,)."""
        self._measure_new()
        count = self._count
        size = np.full(count, int(BLOCK))
        if count:
            size[-1] = self.surfels.count - (count - 1) * int(BLOCK)
        return size - self._living.numpy()[:count]

    def visible(
        self, camera: Camera, T_world_camera: np.ndarray, max_depth: float, t_max: int | None = None
    ) -> wp.array:
        """Blocks that may hold surfels which project into a camera (or next to it) up to max_depth [m].

        Args:
            t_max: only blocks that may hold surfels last updated in this frame or before; None: all.

        Returns:
            Ascending block numbers, int32, on the map's device.
        """
        self._measure_new()
        count = self._count
        seen = wp.empty(count, dtype=wp.uint8, device=self.surfels.device)
        planes = _planes(*frustum(camera, T_world_camera, max_depth, self._border).ravel().tolist())
        inputs = [planes, self._low, self._high, self._living]
        if count:
            launch_rows(_test, count, 1, inputs, [seen], self.surfels.device, lanes=1)
        if t_max is None:
            return self._list(seen.numpy())
        # Surfels only become younger, so a block that was not measured since is listed once too often at worst.
        return self._list((seen.numpy() != 0) & (self._oldest.numpy()[:count] <= t_max))

    def to_clean(self, visible: wp.array, time: int, max_unseen: int) -> wp.array:
        """The visible blocks and those in which an unstable surfel was last updated before time - max_unseen."""
        self._measure_new()
        walk = self._waiting.numpy()[: self._count] < time - max_unseen
        walk[visible.numpy()] = True
        return self._list(walk)

    def measure(self, blocks: wp.array) -> None:
        """Measure blocks again whose surfels were moved, confirmed or taken out."""
        m = self.surfels
        self._allocate(self._count)
        if m.count == 0 or blocks.shape[0] == 0:
            return
        inputs = [blocks, m.count, self.stable_weight, m.arrays]
        outputs = [self._low, self._high, self._living, self._waiting, self._oldest]
        # The width says how much work a row is; a small launch stays on one thread.
        launch_rows(_measure, blocks.shape[0], int(BLOCK), inputs, outputs, m.device, lanes=1)

    def forget(self, first: int = 0) -> None:
        """Surfels from `first` on are not where they were: measure their blocks again before their next use."""
        self._known = min(self._known, first)

    @property
    def _count(self) -> int:
        return -(-self.surfels.count // int(BLOCK))

    def _measure_new(self) -> None:
        m = self.surfels
        if self._known > m.count:  # the map was cut short
            self._known = m.count // int(BLOCK) * int(BLOCK)
        if self._known < m.count:
            first = self._known // int(BLOCK)
            self.measure(wp.array(np.arange(first, self._count, dtype=np.int32), device=m.device))
        self._known = m.count

    def _list(self, chosen: np.ndarray) -> wp.array:
        return wp.array(np.flatnonzero(chosen).astype(np.int32), device=self.surfels.device)

    def _allocate(self, blocks: int) -> None:
        if blocks > 0 and blocks <= self._low.shape[0]:
            return
        size, device = max(2 * blocks, 256), self.surfels.device
        dtypes: dict[str, Any] = {
            "_low": wp.vec3,
            "_high": wp.vec3,
            "_living": wp.int32,
            "_waiting": wp.int32,
            "_oldest": wp.int32,
        }
        for name, dtype in dtypes.items():
            array, old = wp.zeros(size, dtype=dtype, device=device), getattr(self, name, None)
            if old is not None:
                wp.copy(array, old, count=old.shape[0])
            setattr(self, name, array)
