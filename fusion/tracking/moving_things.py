"""Moving things: people and objects that move are masked out of a frame: neither fused, nor do they steer the camera.

A point is moving if it lies where one of the last frames saw free space. New surfaces that come into view lie
where nothing was known, and are fused at once; a thing that moved in front of a known wall is not. Nothing
has to be recognised, and what comes to rest is static by itself: once it has stood still for the length of the memory
no remembered frame looks through it any more. A camera that follows a mover to where no frame has looked before learns
nothing there: then what was moving in the last frame still is. What has left is none of this module's
business: prune takes out what the camera sees through.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import warp as wp

from dsmap.fusion.config import MapConfig
from dsmap.fusion.lie import inverse
from dsmap.fusion.trajectory import TrajectoryPoint
from dsmap.kernels.moving import carried_over, was_free_space
from dsmap.kernels.types import FrameMaps

_EVERY = 4
"""Every n-th frame is remembered."""
_COMPARED = (1, 3, 7)
"""The remembered frames, counted from the newest, that every frame is compared with; and the oldest one."""

_STEP = 0.1
"""Between two frames a mover comes nearer by less than this [m]: 1.5 m/s at 15 frames/s."""
_AROUND = 7
"""Pixels of the coarse level, across, whose nearest depth counts as what an earlier frame saw. In fast motion
silhouettes are off by that much (colour and depth are not taken at one time), and so are floors seen at low angles:
with 3 pixels 1.4 % of fr1/xyz, where nothing moves, counted as moving, with 7 it is 0.1 %."""

_SQUARE = np.ones((3, 3), np.uint8)


class MovingThings:
    """Finds the pixels of moving things by a short memory of depth images.

    It remembers `memory`: (row of the trajectory, depth [m] of the coarse level, shape (h, w)), and in `last`, where
    something moved in the last tracked frame: its row, its depth, and what moved, uint8, shape (h, w).

    Args:
        config: gates of the surfel map, and `moving`.
        cameras: of the image pyramid, finest first.
    """

    def __init__(self, config: MapConfig, cameras: Sequence[Any]):
        self.config = config
        narrow = [level for level, camera in enumerate(cameras) if camera.width <= config.moving.width]
        self.level = min(narrow, default=len(cameras) - 1)
        self.camera = cameras[self.level]
        self.memory: deque[tuple[int, np.ndarray]] = deque(maxlen=max(config.moving.memory // _EVERY, 1))
        self.last: tuple[int, np.ndarray, np.ndarray] | None = None

    def mask(
        self, frame: Sequence[FrameMaps], trajectory: Sequence[TrajectoryPoint], T_world_camera: np.ndarray
    ) -> np.ndarray | None:
        """A tracked frame's moving pixels; the frame is remembered for later ones.

        Args:
            frame: its maps, finest level first.
            trajectory: of all frames before this one.

        Returns:
            The moving pixels, bool, shape (H, W) of the finest level; None if nothing moves.
        """
        if self.config.moving.mode == "off":
            return None
        moving = self.find(frame, trajectory, T_world_camera)
        self.remember(frame, len(trajectory))
        return moving

    def state(self) -> dict[str, np.ndarray]:
        """What is remembered, as plain arrays."""
        if not self.memory:
            return {}
        rows, depths = zip(*self.memory, strict=True)
        state = {"rows": np.array(rows, dtype=np.int64), "depths": np.stack(depths)}
        if self.last is not None:
            row, depth, things = self.last
            state |= {"last_row": np.array(row), "last_depth": depth, "last_things": things}
        return state

    def load_state(self, state: dict[str, np.ndarray]) -> None:
        """Remember what `state` gave."""
        self.memory.clear()
        self.last = None
        if "last_row" in state:
            self.last = int(state["last_row"]), state["last_depth"], state["last_things"]
        if state:
            self.memory.extend(zip(state["rows"].tolist(), state["depths"], strict=True))

    def find(
        self, frame: Sequence[FrameMaps], trajectory: Sequence[TrajectoryPoint], T_world_camera: np.ndarray
    ) -> np.ndarray | None:
        """Mask of a frame's moving pixels, bool, shape (H, W) of the finest level; None if nothing moves.

        A few remembered frames tell whether anything does. Only if so all are asked: where a chair that comes nearer
        is now, some frame has looked through before the chair was in its way.
        """
        if not self.memory:
            return None
        few = {len(self.memory) - back for back in _COMPARED} | {0}
        things = self._things(frame, trajectory, T_world_camera, [i for i in sorted(few) if i >= 0])
        if things.any():
            things = self._things(frame, trajectory, T_world_camera, range(len(self.memory)))
        if not things.any():
            self.last = None
            return None
        self.last = len(trajectory), self._depth(frame), things
        height, width = frame[0].vertex.shape
        things = cv2.dilate(things, _SQUARE)
        return cv2.resize(things, (width, height), interpolation=cv2.INTER_NEAREST).astype(bool)

    def _things(
        self,
        frame: Sequence[FrameMaps],
        trajectory: Sequence[TrajectoryPoint],
        T_world_camera: np.ndarray,
        numbers: Sequence[int],
    ) -> np.ndarray:
        """What lies where these remembered frames saw free space, uint8, shape (h, w) of the coarse level.

        And what moved in the last frame, where the first of them has not looked: it cannot know.
        """
        vertex = frame[self.level].vertex
        like: dict[str, Any] = {"dtype": wp.uint8, "device": vertex.device}
        free, known = (wp.empty(vertex.shape, **like) for _ in range(2))
        chosen = [self.memory[i] for i in numbers]
        to_past = [inverse(trajectory[row].T_world_camera) @ T_world_camera for row, _ in chosen]
        surfels = self.config.surfels
        was_free_space(
            self.camera, vertex, to_past, [depth for _, depth in chosen], free=free, known=known,
            margin=surfels.max_ray_distance, margin_z2=surfels.ray_distance_z2,
        )  # fmt: skip
        seeds = free.numpy()
        if self.last is not None:
            row, depth, things = self.last
            T_last_camera = inverse(trajectory[row].T_world_camera) @ T_world_camera
            seeds |= carried_over(self.camera, vertex, T_last_camera, depth, things, _STEP) & (
                1 - known.numpy()
            )
        return grow_to_objects(seeds, self._depth(frame), self.config.moving.min_share)

    def _depth(self, frame: Sequence[FrameMaps]) -> np.ndarray:
        """Of the coarse level [m], shape (h, w)."""
        return np.ascontiguousarray(frame[self.level].vertex.numpy()[..., 2])

    def remember(self, frame: Sequence[FrameMaps], row: int) -> None:
        """Remember a tracked frame, line `row` of the trajectory, for later ones."""
        if row % _EVERY == 0:
            # The nearest depth around each pixel; holes (0) tell nothing.
            self.memory.append((row, cv2.erode(self._depth(frame), np.ones((_AROUND, _AROUND), np.uint8))))


def with_edges(frame: Sequence[FrameMaps], moving: np.ndarray) -> list[FrameMaps]:
    """Maps of a frame whose moving pixels, bool, (H, W), are depth edges: neither fused nor labelled, no evidence."""
    edge = frame[0].edge
    marked = wp.array(edge.numpy() | moving, dtype=edge.dtype, device=edge.device)
    return [replace(frame[0], edge=marked), *frame[1:]]


def mask_depth(frame: Sequence[FrameMaps], moving: np.ndarray) -> list[FrameMaps]:
    """Maps of a frame, finest level first, without the depth of these pixels: bool, shape (H, W) of the finest."""
    still = []
    for maps in frame:
        vertex = np.array(maps.vertex.numpy())
        height, width = vertex.shape[:2]
        # INTER_AREA: a coarse pixel that is partly moving counts as moving.
        vertex[cv2.resize(moving.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA) > 0] = 0
        still.append(replace(maps, vertex=wp.array(vertex, dtype=wp.vec3, device=maps.vertex.device)))
    return still


def grow_to_objects(free: np.ndarray, depth: np.ndarray, min_share: float) -> np.ndarray:
    """Moving things from single pixels: specks are dropped, the rest of a thing is added.

    Args:
        free: uint8, shape (h, w), 1 where the point lies in what was free space.
        depth: of the frame [m], shape (h, w), 0 where there is none.
        min_share: smallest thing, as a share of the image.

    Returns:
        uint8, shape (h, w), 1 on moving things.
    """
    seeds = cv2.morphologyEx(free, cv2.MORPH_OPEN, _SQUARE)
    count, label, stats, _ = cv2.connectedComponentsWithStats(seeds, connectivity=8)
    large = np.flatnonzero(stats[:, cv2.CC_STAT_AREA] >= max(min_share * free.size, 4))
    seeds = np.isin(label, large[large > 0]).astype(np.uint8)
    if count == 1 or not seeds.any():
        return np.zeros_like(free)
    # A slow thing hides part of where it was: a patch of continuous depth that is mostly moving moves as a whole.
    step = cv2.morphologyEx(depth, cv2.MORPH_GRADIENT, _SQUARE) > 0.05 + 0.02 * depth
    patches = ((depth > 0) & ~step).astype(np.uint8)
    patch = np.asarray(cv2.connectedComponents(patches, connectivity=4)[1], np.int32)
    size = np.bincount(patch.ravel())
    moving = np.bincount(patch.ravel(), weights=seeds.ravel())
    whole = moving > 0.4 * size
    whole[0] = False
    return seeds | whole[patch].astype(np.uint8)
