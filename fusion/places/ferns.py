"""A keyframe database that recognises places: randomised ferns (Glocker et al., TVCG 2015).

Each fern looks at one pixel of a small view and asks four questions: is it redder, greener, bluer and
farther than four random thresholds? The answers are its 4-bit code. Two views are as unlike as the share of
ferns that answer differently (block-wise Hamming distance); ferns whose pixel has no data in either of the
two do not count. A view unlike all keyframes becomes one.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from dsmap.frame import Intrinsics
from dsmap.fusion.config import FernConfig

NO_DATA = 255
"""Code of a fern whose pixel has no depth."""
_NO_QUERY = 254  # the same in a query: unlike every stored code, NO_DATA too
_WORD = 8
_GROWTH = 1.5
_MILLIMETRE = 1e-3
_COLOURS = (20, 200)
"""Colour thresholds: most of a room lies between; a threshold that no pixel passes tells nothing apart."""
_FAR = 5.0
"""Largest depth threshold [m]: rooms are nearer than the range of their sensors."""


@dataclass
class SmallView:
    """A colour and depth image of a few thousand pixels; a pixel without depth has no data."""

    rgb: np.ndarray
    """uint8, shape (h, w, 3)."""
    depth: np.ndarray
    """Planar depth [m], float32, shape (h, w); 0 where there is none."""


@dataclass
class Keyframe:
    """One entry of the database."""

    index: int
    view: SmallView
    T_world_camera: np.ndarray
    time: int
    """Frame number at which the view was taken."""


def small_size(intrinsics: Intrinsics, width: int) -> tuple[int, int]:
    """(height, width) [px] of the small view of a camera: `width` columns, or the camera's if it has fewer."""
    width = min(width, intrinsics.width)
    return max(round(intrinsics.height * width / intrinsics.width), 1), width


def small_view(colour: np.ndarray, depth: np.ndarray, size: tuple[int, int]) -> SmallView:
    """Reduce a view to `size` (h, w): colour is the mean of the block's valid pixels, depth the middle one's.

    Args:
        colour: RGB in [0, 1], float32, shape (H, W, 3); of a camera frame or predicted from the model.
        depth: planar depth [m], float32, shape (H, W); 0 where there is no data.
    """
    h, w = size
    skip = max(min(depth.shape[0] // (2 * h), depth.shape[1] // (2 * w)), 1)
    # Two samples a block and direction: enough for a mean, and a quarter of the work at 640x480.
    valid = (depth[::skip, ::skip] > 0).astype(np.float32)
    light = colour[::skip, ::skip] * valid[..., None]
    share = cv2.resize(valid, (w, h), interpolation=cv2.INTER_AREA)
    mean = cv2.resize(light, (w, h), interpolation=cv2.INTER_AREA) / np.maximum(share, 1e-6)[..., None]
    # Depth is never averaged: the mean of two surfaces is a third one that does not exist.
    rows = ((np.arange(h) + 0.5) * depth.shape[0] / h).astype(int)
    columns = ((np.arange(w) + 0.5) * depth.shape[1] / w).astype(int)
    middle = depth[rows[:, None], columns[None, :]]
    return SmallView(
        (255 * mean.clip(0, 1) + 0.5).astype(np.uint8), np.where(share > 0, middle, 0).astype(np.float32)
    )


class FernDatabase:
    """Keyframes and their codes; the same seed and the same calls give the same bits.

    Args:
        config: number of ferns, thresholds, ages.
        size: (height, width) of the small views [px].
        depth_range: (least, greatest) depth that a view can have [m]; thresholds are drawn between them.
        seed: of the ferns' pixels and thresholds.

    `poses` (T_world_camera, float64, shape (K, 4, 4)) and `times` (frame numbers, shape (K,)) may be set:
    the deformation graph moves keyframes with the map.
    """

    def __init__(
        self, config: FernConfig, size: tuple[int, int], depth_range: tuple[float, float], seed: int = 0
    ):
        self.config = config
        self.size = size
        self._draw(depth_range, np.random.default_rng(seed))
        # Rows are padded with codes that no query has, so that eight ferns are counted in one operation.
        self._padded = -(-config.count // _WORD) * _WORD
        self._count = 0
        self._codes = np.empty((0, self._padded), np.uint8)
        self._rgb = np.empty((0, *size, 3), np.uint8)
        self._depth_mm = np.empty((0, *size), np.uint16)
        self.poses = np.empty((0, 4, 4))
        self.times = np.empty(0, np.int64)

    def _draw(self, depth_range: tuple[float, float], rng: np.random.Generator) -> None:
        count, (h, w) = self.config.count, self.size
        self._pixels = np.stack([rng.integers(0, h, count), rng.integers(0, w, count)], axis=1)
        self._colour_thresholds = rng.uniform(*_COLOURS, (count, 3)).astype(np.float32)
        near, far = depth_range
        self._depth_thresholds = rng.uniform(near, max(min(far, _FAR), near), count).astype(np.float32)

    def __len__(self) -> int:
        return self._count

    @property
    def nbytes(self) -> int:
        """Bytes of the keyframes in use."""
        arrays = (self._codes, self._rgb, self._depth_mm)
        return sum(array[: self._count].nbytes for array in arrays) + self.poses.nbytes + self.times.nbytes

    def encode(self, view: SmallView) -> np.ndarray:
        """The view's code: 4 bits (R, G, B, depth) a fern, uint8, shape (count,); NO_DATA where it sees none."""
        rows, columns = self._pixels.T
        depth = view.depth[rows, columns]
        bits = view.rgb[rows, columns] > self._colour_thresholds  # (count, 3)
        code = bits[:, 0] | bits[:, 1] << 1 | bits[:, 2] << 2 | (depth > self._depth_thresholds) << 3
        return np.where(depth > 0, code, NO_DATA).astype(np.uint8)

    def similarities(self, code: np.ndarray) -> np.ndarray:
        """Likeness of a view to every keyframe, 1 - block-wise Hamming distance, float32, shape (K,).

        Only ferns that have data in both views count; where those are fewer than `min_overlap` of all
        ferns, the likeness is 0.
        """
        stored = self._codes[: self._count]
        query = np.full(self._padded, _NO_QUERY, np.uint8)
        query[: len(code)] = np.where(code == NO_DATA, _NO_QUERY, code)
        equal = _ones(stored == query)
        both = _ones((stored != NO_DATA) & (query != _NO_QUERY))
        enough = both >= self.config.min_overlap * self.config.count
        return np.where(enough, equal / np.maximum(both, 1), 0).astype(np.float32)

    def add_if_novel(self, code: np.ndarray, view: SmallView, T_world_camera: np.ndarray, time: int) -> bool:
        """Keep the view if it is less like every keyframe than `1 - novelty`; returns whether it was kept."""
        if np.count_nonzero(code != NO_DATA) < self.config.min_overlap * self.config.count:
            return False  # nothing could ever be compared with it
        if self._count and self.similarities(code).max() > 1 - self.config.novelty:
            return False
        self._reserve(self._count + 1)
        row = self._count
        self._codes[row] = NO_DATA
        self._codes[row, : len(code)] = code
        self._rgb[row] = view.rgb
        self._depth_mm[row] = np.rint(view.depth / _MILLIMETRE).clip(0, np.iinfo(np.uint16).max)
        self._count += 1
        self.poses = np.concatenate([self.poses, np.asarray(T_world_camera, np.float64)[None]])
        self.times = np.append(self.times, time)
        return True

    def candidates(
        self, code: np.ndarray, time: int, min_age: int | None = None, most: int | None = None
    ) -> list[tuple[Keyframe, float]]:
        """The keyframes most like a view, best first, each with its similarity.

        Args:
            time: the view's frame number.
            min_age: keyframes younger than this many frames are left out; default: the configured age.
            most: how many; default: as configured.
        """
        min_age = self.config.min_age if min_age is None else min_age
        most = self.config.candidates if most is None else most
        if not self._count:
            return []
        similarity = np.where(time - self.times >= min_age, self.similarities(code), 0)
        best = np.argsort(-similarity, kind="stable")[:most]
        return [
            (self.keyframe(int(i)), float(similarity[i]))
            for i in best
            if similarity[i] > self.config.min_similarity
        ]

    def candidate(self, code: np.ndarray, time: int, min_age: int) -> tuple[Keyframe, float] | None:
        """The keyframe most like a view and its similarity, or None; see `candidates`."""
        return next(iter(self.candidates(code, time, min_age, most=1)), None)

    def keyframe(self, index: int) -> Keyframe:
        """The keyframe in row `index`."""
        depth = self._depth_mm[index].astype(np.float32) * np.float32(_MILLIMETRE)
        view = SmallView(self._rgb[index].copy(), depth)
        return Keyframe(index, view, self.poses[index].copy(), int(self.times[index]))

    def state(self) -> dict[str, np.ndarray]:
        """Everything as plain arrays, for a checkpoint."""
        return {
            "pixels": self._pixels,
            "colour_thresholds": self._colour_thresholds,
            "depth_thresholds": self._depth_thresholds,
            "codes": self._codes[: self._count, : self.config.count].copy(),
            "rgb": self._rgb[: self._count].copy(),
            "depth_mm": self._depth_mm[: self._count].copy(),
            "poses": self.poses.copy(),
            "times": self.times.copy(),
        }

    @staticmethod
    def from_state(config: FernConfig, size: tuple[int, int], state: dict[str, np.ndarray]) -> "FernDatabase":
        """The database whose `state` this is; it goes on bit for bit where that one stopped."""
        ferns = FernDatabase(config, size, (1.0, 2.0))
        # The ferns themselves are stored too: another NumPy may draw others from the same seed.
        ferns._pixels = state["pixels"].astype(np.int64)
        ferns._colour_thresholds = state["colour_thresholds"].astype(np.float32)
        ferns._depth_thresholds = state["depth_thresholds"].astype(np.float32)
        count = len(state["codes"])
        ferns._reserve(count)
        ferns._codes[:count] = NO_DATA
        ferns._codes[:count, : config.count] = state["codes"]
        ferns._rgb[:count] = state["rgb"]
        ferns._depth_mm[:count] = state["depth_mm"]
        ferns._count = count
        ferns.poses = state["poses"].astype(np.float64)
        ferns.times = state["times"].astype(np.int64)
        return ferns

    def _reserve(self, rows: int) -> None:
        if rows <= len(self._codes):
            return
        capacity = max(rows, int(_GROWTH * len(self._codes)), 64)
        for name in ("_codes", "_rgb", "_depth_mm"):
            old = getattr(self, name)
            new = np.empty((capacity, *old.shape[1:]), old.dtype)
            new[: self._count] = old[: self._count]
            setattr(self, name, new)


def _ones(mask: np.ndarray) -> np.ndarray:
    """Ones in every row of a boolean matrix whose width is a multiple of 8 and below 2040, shape (rows,)."""
    # Eight bytes are added at once: none of them can exceed 255.
    words = np.ascontiguousarray(mask).view(np.uint64).sum(axis=1)
    return words[:, None].view(np.uint8).sum(axis=1, dtype=np.int32)
