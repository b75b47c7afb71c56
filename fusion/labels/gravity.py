"""Up and the floor of a map, and what they say about a frame. They come from the whole map: steady over frames."""

import warnings
from collections.abc import Sequence
from typing import Literal

import numpy as np

from dsmap.errors import InputWarning
from dsmap.frame import FrameGeometry, Intrinsics
from dsmap.fusion.trajectory import TrajectoryPoint
from dsmap.gravity import CAMERA_HEIGHT, FACES_UP, NOT_A_TABLE, estimate_up, lowest_level
from dsmap.kernels.geometry import geometry_channels
from dsmap.kernels.types import FrameMaps, SurfelMap

ImageSide = Literal["top", "right", "bottom", "left"]
"""A side of the image."""
AXES = {
    "top": (0.0, -1.0, 0.0),
    "right": (1.0, 0.0, 0.0),
    "bottom": (0.0, 1.0, 0.0),
    "left": (-1.0, 0.0, 0.0),
}
"""Where each side of the image lies in the camera's frame."""
_EVERY = 15
"""Frames between two looks at the map."""
_SAMPLES = 4096
_MIN_STABLE = 500
_POSES = 300
_STARTS_ANEW_DEG = 60.0
"""So far from the cameras' mean up, the last one found is not where the search goes on."""
_UPSIDE_DOWN = 0.1
"""By this share of the map more faces away from up than towards it where a camera hangs upside down. Rooms that were
taken upright have -0.5 to -0.02: little but ceilings faces down."""
_CELL, _WIDE = 0.5, 24
"""Nearer than NOT_A_TABLE, a floor covers at least so many squares of this side [m]: a robot's camera sees it so."""
_CAMERA_HEIGHTS = (0.35, 3.0)
"""Heights above the floor that cameras are carried at [m]."""
_HIGHEST_ROOM = 8.0
"""[m]"""
_FIELD_OF_VIEW_DEG = (20.0, 140.0)
_SURE = 0.5
"""Confidence of up from which distances along it count as evidence about the scale."""
_MIN_DEPTH = 0.02
"""Share of the image that has depth in a frame with geometry."""


class MapGravity:
    """Which way is up in a map and where its floor is; warns once where they speak of a wrong calibration.

    Args:
        intrinsics: of the frames.
        camera_up: the side of the image that is up, roughly; auto: the top, or the bottom where the map shows
            that the camera hangs upside down.
    """

    def __init__(self, intrinsics: Intrinsics, camera_up: ImageSide | Literal["auto"] = "auto"):
        self._camera_up = camera_up
        self.side: ImageSide = "top" if camera_up == "auto" else camera_up
        self.up: np.ndarray | None = None
        """Unit vector in the world's frame, float64, shape (3,); None before the first frame."""
        self.confidence = 0.0
        """How much of the map speaks for `up`, 0 to 1."""
        self.floor = 0.0
        """Where the floor lies along `up` in the world's frame [m]."""
        self.camera_height = self.room_height = np.nan
        """Of the cameras above the lowest level, and of the highest points above the lowest [m]; nan: not known."""
        self._looked = -_EVERY
        self._intrinsics = intrinsics
        self._warned: set[str] = set()

    def update(self, surfels: SurfelMap, stable_weight: float, trajectory: Sequence[TrajectoryPoint]) -> None:
        """Look at the map again if it is time to. The trajectory is that of all frames so far."""
        if len(trajectory) - self._looked < _EVERY:
            return
        self._looked = len(trajectory)
        position, normal = _sample(surfels, stable_weight)
        poses = [p.T_world_camera for p in trajectory[:: max(len(trajectory) // _POSES, 1)] if p.tracked]
        if not poses or len(position) == 0:
            return
        self._find_up(normal, np.array(poses))
        self._find_floor(position, normal, np.array(poses)[:, :3, 3])

    def of_frame(self, T_world_camera: np.ndarray, maps: FrameMaps) -> FrameGeometry | None:
        """The geometry of a frame from its finest maps; None, and a warning once, where it cannot be trusted."""
        if self.up is None:
            return None
        if doubt := self.doubt():
            self._warn("calibration", f"{doubt}: labels come from the colours alone")
            return None
        with_depth = np.count_nonzero(maps.vertex.numpy()[::4, ::4, 2])
        if with_depth < _MIN_DEPTH * maps.vertex.size / 16:
            self._warn("depth", "a frame has next to no depth: its labels come from the colours alone")
            return None
        up = self.in_camera(T_world_camera)
        floor = self.floor - float(T_world_camera[:3, 3] @ self.up)
        channels = geometry_channels(maps.vertex, maps.normal, up, floor).numpy()
        return FrameGeometry(channels, up, floor, self.confidence)

    def in_camera(self, T_world_camera: np.ndarray) -> np.ndarray:
        """Up in a camera's frame, shape (3,); by `side` alone before the first look at a map."""
        return np.array(AXES[self.side]) if self.up is None else T_world_camera[:3, :3].T @ self.up

    def doubt(self) -> str:
        """Why heights and angles cannot be right; empty where nothing speaks against them."""
        i = self._intrinsics
        field_of_view = 2 * np.degrees(np.arctan2(i.width / 2, i.fx))
        if not _FIELD_OF_VIEW_DEG[0] < field_of_view < _FIELD_OF_VIEW_DEG[1]:
            return f"fx = {i.fx:g} of a {i.width}x{i.height} image is a view of {field_of_view:.0f} degrees"
        if self.room_height > _HIGHEST_ROOM:
            return f"the room is {self.room_height:.1f} m high, so the depth scale may be wrong"
        if self.camera_height < _CAMERA_HEIGHTS[0] or self.camera_height > _CAMERA_HEIGHTS[1]:
            below = f"{self.camera_height:.2f} m below the camera"
            return f"the lowest level lies {below}, so the depth scale may be wrong"
        return ""

    def state(self) -> dict[str, np.ndarray]:
        """What a checkpoint keeps, by name."""
        if self.up is None:
            return {}
        numbers = [self.confidence, self.floor, self.camera_height, self.room_height]
        counts = [self._looked, list(AXES).index(self.side)]
        return {"up": self.up, "numbers": np.array(numbers, np.float64), "counts": np.array(counts, np.int64)}

    def load_state(self, arrays: dict[str, np.ndarray]) -> None:
        """Go on from `state`; an empty one, as of older checkpoints, is a fresh start."""
        if "up" in arrays:
            self.up = arrays["up"]
            self.confidence, self.floor, self.camera_height, self.room_height = arrays["numbers"].tolist()
            self._looked, side = arrays["counts"].tolist()
            self.side = list(AXES)[side]

    def _find_up(self, normal: np.ndarray, poses: np.ndarray) -> None:
        held = (poses[:, :3, :3] @ np.array(AXES[self.side])).mean(axis=0)
        held /= max(float(np.linalg.norm(held)), 1e-9)
        start = held
        if self.up is not None and self.up @ held > np.cos(np.deg2rad(_STARTS_ANEW_DEG)):
            start = self.up
        found = estimate_up(normal, start)
        self.up, self.confidence = found.direction, found.confidence
        if self._camera_up == "auto" and self._looked > _EVERY:
            cosine = normal @ self.up
            if float((cosine < -FACES_UP).mean() - (cosine > FACES_UP).mean()) > _UPSIDE_DOWN:
                self.side = "bottom" if self.side == "top" else "top"
                self.up = -self.up

    def _find_floor(self, position: np.ndarray, normal: np.ndarray, cameras: np.ndarray) -> None:
        """The floor, and what its distance from the cameras says about the scale of the depth."""
        assert self.up is not None
        heights, facing = position @ self.up, normal @ self.up > FACES_UP
        low, high = np.percentile(heights, [1, 99])
        camera = float(np.median(cameras @ self.up))
        level = lowest_level(heights, facing)
        if level is None or not (camera - level > NOT_A_TABLE or _is_wide(position, heights, facing, level)):
            self.floor = min(float(low), camera - CAMERA_HEIGHT)
        else:
            self.floor = level
        if self.confidence > _SURE and level is not None:
            self.camera_height, self.room_height = camera - level, float(high - low)

    def _warn(self, kind: str, text: str) -> None:
        if kind not in self._warned:
            self._warned.add(kind)
            warnings.warn(text, InputWarning, stacklevel=2)


def _sample(surfels: SurfelMap, stable_weight: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions and normals of surfels all over the map, float64, shapes (N, 3): stable ones, if there are enough."""
    rows = slice(None, surfels.count, max(surfels.count // _SAMPLES, 1))
    weight, position, normal = (
        array[rows].contiguous().numpy() for array in (surfels.weight, surfels.position, surfels.normal)
    )
    stable = weight >= stable_weight
    chosen = stable if np.count_nonzero(stable) >= _MIN_STABLE else weight > 0
    return position[chosen].astype(np.float64), normal[chosen].astype(np.float64)


def _is_wide(position: np.ndarray, heights: np.ndarray, facing: np.ndarray, level: float) -> bool:
    """Whether a level covers as much ground as no table or bed does."""
    on_level = position[facing & (np.abs(heights - level) < 0.1)]
    return len(np.unique(np.floor(on_level / _CELL).astype(np.int64), axis=0)) >= _WIDE
