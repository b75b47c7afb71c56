"""The arrays that kernels share: surfels, the maps of a camera frame, the maps predicted from the model.

Structures of arrays. An invalid pixel has vertex.z == 0 and normal == 0; an empty index is -1.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from dsmap.classes import NUM_CLASSES

NUM_EVIDENCE = NUM_CLASSES - 1
"""Columns of label evidence: the 13 classes; void has none."""
GROWTH = 1.25
"""Capacity factor of a growing map; keeps allocated memory below 1.25 x the surfels' own bytes."""
ADDRESSES = 1 << 25
"""Rows of address space that a map on the CPU takes when it first grows. Memory comes with the first write to a
row, so that up to this size growing copies nothing and no frame waits for it; beyond, and on CUDA, it copies."""


@wp.struct
class FrameImages:
    """What fusion takes from the finest FrameMaps of a frame (see there), as kernels take it."""

    depth: wp.array2d(dtype=wp.float32)
    vertex: wp.array2d(dtype=wp.vec3)
    normal: wp.array2d(dtype=wp.vec3)
    colour: wp.array2d(dtype=wp.vec3)
    radius: wp.array2d(dtype=wp.float32)
    edge: wp.array2d(dtype=wp.uint8)


@dataclass(frozen=True)
class FrameMaps:
    """Maps of one camera frame at one pyramid level, in the camera frame. Shapes (H, W)."""

    depth: wp.array  # float32 [m], 0 invalid
    vertex: wp.array  # vec3 [m]
    normal: wp.array  # vec3, towards the camera
    intensity: wp.array  # float32 in [0, 1]
    radius: Any = None  # float32 [m], level 0 only
    colour: Any = None  # vec3 RGB in [0, 1], level 0 only
    edge: Any = None  # uint8, 1 on depth edges, level 0 only

    @cached_property
    def images(self) -> FrameImages:
        """Level 0 as kernels take it."""
        images = FrameImages()
        for name in FrameImages.vars:
            setattr(images, name, getattr(self, name))
        return images

    @property
    def surface(self) -> "Surface":
        """What registration needs of it."""
        return Surface(self.vertex, self.normal, self.intensity)


@wp.struct
class SurfaceImages:
    """The images of a Surface (see there), as kernels take them."""

    vertex: wp.array2d(dtype=wp.vec3)
    normal: wp.array2d(dtype=wp.vec3)
    intensity: wp.array2d(dtype=wp.float32)
    gradient: wp.array2d(dtype=wp.vec2)


@dataclass
class Surface:
    """What a frame or a view shows of a surface, on one pyramid level; images of one camera, shape (H, W)."""

    vertex: wp.array  # vec3 [m], z = 0 where there is none
    normal: wp.array  # vec3
    intensity: wp.array  # float32 in [0, 1]
    gradient: wp.array | None = None  # vec2 [1 / px], of views that something is registered to

    @property
    def images(self) -> SurfaceImages:
        """What kernels take; a gradient that there is not is an empty array."""
        images = SurfaceImages()
        for name in SurfaceImages.vars:
            setattr(images, name, getattr(self, name))
        return images


@dataclass
class ModelMaps:
    """What the model looks like from a camera pose, in that camera's frame. Shapes (H, W)."""

    index: wp.array  # int32 surfel seen by the pixel, -1 where none
    vertex: wp.array  # vec3 [m]
    normal: wp.array  # vec3
    colour: wp.array  # vec3 RGB in [0, 1]
    time: wp.array  # int32, frame number of the surfel's last update; -1 where none

    @staticmethod
    def empty(height: int, width: int, device: Any) -> "ModelMaps":
        """Allocate the maps of one view; nothing visible yet."""
        shape = (height, width)
        return ModelMaps(
            index=wp.full(shape, -1, dtype=wp.int32, device=device),
            vertex=wp.zeros(shape, dtype=wp.vec3, device=device),
            normal=wp.zeros(shape, dtype=wp.vec3, device=device),
            colour=wp.zeros(shape, dtype=wp.vec3, device=device),
            time=wp.full(shape, -1, dtype=wp.int32, device=device),
        )


@wp.struct
class SurfelArrays:
    """The arrays of a SurfelMap (see there) as kernels take them; in a kernel they cost what arguments cost."""

    position: wp.array(dtype=wp.vec3)
    normal: wp.array(dtype=wp.vec3)
    colour: wp.array(dtype=wp.vec3)
    weight: wp.array(dtype=wp.float32)
    radius: wp.array(dtype=wp.float32)
    t_created: wp.array(dtype=wp.int32)
    t_updated: wp.array(dtype=wp.int32)
    label: wp.array(dtype=wp.uint8)
    observations: wp.array(dtype=wp.float32)
    evidence: wp.array2d(dtype=wp.float32)
    segment: wp.array(dtype=wp.int32)


@dataclass
class SurfelMap:
    """All surfels, in order of insertion. Only the first `count` rows of every array are in use.

    A surfel with weight 0 is dead: every kernel skips it until compaction removes it.
    """

    count: int
    position: wp.array  # vec3 [m], world frame
    normal: wp.array  # vec3, world frame
    colour: wp.array  # vec3 RGB in [0, 1]
    weight: wp.array  # float32, surfel confidence w
    radius: wp.array  # float32 [m]
    t_created: wp.array  # int32, frame number t_0
    t_updated: wp.array  # int32, frame number t of the last update
    label: wp.array  # uint8, argmax of the evidence; 0 = never labelled
    observations: wp.array  # float32, label observations n (sum of their weights)
    evidence: wp.array  # float32, shape (capacity, 13): sum of log p (bayes, geometric) or of p (mean)
    segment: wp.array  # int32, number of the geometric segment; 0 = none (see fusion/objects/segments.py)
    _reserved: dict[str, np.ndarray] = field(
        default_factory=dict, repr=False
    )  # see ADDRESSES; (rows, columns)
    _bundle: tuple[SurfelArrays, list[wp.array]] | None = field(default=None, repr=False, compare=False)

    @staticmethod
    def empty(device: Any, capacity: int = 1 << 16) -> "SurfelMap":
        """A map without surfels."""
        return SurfelMap(count=0, **_allocate(capacity, device))

    @property
    def arrays(self) -> SurfelArrays:
        """The arrays as kernels take them, bundled anew where one was replaced."""
        own = [getattr(self, name) for name in SurfelArrays.vars]
        if self._bundle is None or any(a is not b for a, b in zip(own, self._bundle[1], strict=True)):
            bundle = SurfelArrays()
            for name, array in zip(SurfelArrays.vars, own, strict=True):
                setattr(bundle, name, array)
            self._bundle = bundle, own
        return self._bundle[0]

    @property
    def device(self) -> Any:
        return self.position.device

    @property
    def capacity(self) -> int:
        return self.position.shape[0]

    @property
    def nbytes(self) -> int:
        """Bytes of the rows up to capacity."""
        return sum(getattr(self, name).capacity for name in ARRAYS)

    def reserve(self, capacity: int) -> None:
        """Make room for `capacity` surfels, growing by at least GROWTH; there is no upper limit."""
        if capacity <= self.capacity:
            return
        rows = max(capacity, int(self.capacity * GROWTH))
        if len(self._reserved.get("weight", ())) >= rows:
            new = {name: _wrap(name, memory[:rows]) for name, memory in self._reserved.items()}
        else:
            new, self._reserved = self._copied(rows)
        for name, array in new.items():
            setattr(self, name, array)

    def _copied(self, rows: int) -> tuple[dict[str, wp.array], dict[str, np.ndarray]]:
        """Arrays of `rows` rows with the surfels in use, and the address space they lie in, if any."""
        reserved = {} if self.device.is_cuda else _reserve(max(2 * rows, ADDRESSES))
        if reserved:
            new = {name: _wrap(name, memory[:rows]) for name, memory in reserved.items()}
        else:
            new = _allocate(rows, self.device)
        for name, array in new.items():
            wp.copy(
                array, getattr(self, name), count=self.count * (NUM_EVIDENCE if name == "evidence" else 1)
            )
        return new, reserved

    def numpy(self) -> dict[str, np.ndarray]:
        """The surfels in use, by array name; views without a copy on the CPU."""
        return {name: getattr(self, name).numpy()[: self.count] for name in ARRAYS}

    def torch(self) -> dict[str, Any]:
        """The surfels in use as torch tensors on the same memory, by array name (needs torch)."""
        return {name: wp.to_torch(getattr(self, name), requires_grad=False)[: self.count] for name in ARRAYS}


_DTYPES: dict[str, Any] = {
    "position": wp.vec3, "normal": wp.vec3, "colour": wp.vec3, "weight": wp.float32, "radius": wp.float32,
    "t_created": wp.int32, "t_updated": wp.int32, "label": wp.uint8, "observations": wp.float32,
    "evidence": wp.float32, "segment": wp.int32,
}  # fmt: skip
ARRAYS = tuple(_DTYPES)
"""Names of the arrays of a SurfelMap."""


def _allocate(capacity: int, device: Any) -> dict[str, wp.array]:
    shapes = {name: (capacity, NUM_EVIDENCE) if name == "evidence" else capacity for name in ARRAYS}
    return {name: wp.zeros(shapes[name], dtype=_DTYPES[name], device=device) for name in ARRAYS}


def _reserve(rows: int) -> dict[str, np.ndarray]:
    """Zeros of shape (rows, columns) by array name, in memory that is not there before it is written to."""
    columns = {name: 3 if dtype is wp.vec3 else 1 for name, dtype in _DTYPES.items()} | {
        "evidence": NUM_EVIDENCE
    }
    scalars = {wp.vec3: np.float32, wp.float32: np.float32, wp.int32: np.int32, wp.uint8: np.uint8}
    try:
        return {name: np.zeros((rows, columns[name]), scalars[dtype]) for name, dtype in _DTYPES.items()}
    except MemoryError:  # a system that counts addresses as memory
        return {}


def _wrap(name: str, rows: np.ndarray) -> wp.array:
    """The memory of `_reserve` as a Warp array of this name."""
    shaped = rows if rows.shape[1] > 1 else rows[:, 0]
    return wp.array(shaped, dtype=_DTYPES[name], device="cpu", copy=False)
