"""The main step of dsmap: a frame goes in, the pose and the labelled surfel map come out."""

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import warp as wp

from dsmap.errors import InputError
from dsmap.frame import Frame, Intrinsics, orthonormal
from dsmap.fusion.config import MapConfig
from dsmap.fusion.segmenter import Segmenter
from dsmap.fusion.semantics import Schedule
from dsmap.fusion.tracker import Health, ModelView, Tracker
from dsmap.kernels.associate import associate
from dsmap.kernels.camera import make_camera
from dsmap.kernels.compact import Sweep
from dsmap.kernels.culling import Blocks
from dsmap.kernels.fuse import fuse_frame
from dsmap.kernels.label import posterior, update_labels
from dsmap.kernels.predict import predict_model
from dsmap.kernels.preprocess import clean_depth, intensity_map, preprocess
from dsmap.kernels.prune import prune
from dsmap.kernels.types import FrameMaps, ModelMaps, SurfelMap

LEVELS = 3
"""Pyramid levels of tracking."""
_MIN_DEPTH_PIXELS = 0.02
"""A frame with a smaller share of valid depth is lost: there is nothing to track or to fuse."""


@dataclass
class TrajectoryPoint:
    """One line of the trajectory: every frame has one; a lost frame carries the last pose."""

    time: float
    T_world_camera: np.ndarray
    tracked: bool


@dataclass
class StepResult:
    """What one frame did to the map."""

    T_world_camera: np.ndarray
    tracked: bool
    health: Health | None
    """None where poses are given, and for the first frame."""
    reason: str
    """Why the frame is lost, in words; empty when tracked."""
    inserted: int
    segmented: bool
    stages_ms: dict[str, float] = field(default_factory=dict)


class Mapper:
    """Tracks a camera, fuses its frames into surfels and labels them (Fig. 2 of the paper).

    Args:
        config: every parameter.
        intrinsics: of the frames that `step` will get.
        segmenter: gives class probabilities of a frame; None maps without labels.

    Raises:
        InputError: the image is too small for the pyramid, or the device is not there.
    """

    def __init__(self, config: MapConfig, intrinsics: Intrinsics, segmenter: Segmenter | None = None):
        if min(intrinsics.width, intrinsics.height) < 32:
            raise InputError(
                f"images of {intrinsics.width}x{intrinsics.height} are too small; expected at least 32x32"
            )
        self.config = config
        self.intrinsics = intrinsics
        self.segmenter = segmenter
        self.device = _device(config.device)
        sizes = [(intrinsics.width >> level, intrinsics.height >> level) for level in range(LEVELS)]
        self.cameras = [make_camera(_level(intrinsics, level, *size)) for level, size in enumerate(sizes)]
        self.camera = self.cameras[0]
        self.tracker = Tracker(config.track, self.cameras)
        self.schedule = Schedule(config.labels)
        self.adopt(SurfelMap.empty(self.device))
        self._visible: wp.array | None = None
        self.view: ModelView | None = None
        self.time = 0
        self.T_world_camera = np.eye(4)
        self.trajectory: list[TrajectoryPoint] = []
        self.maps = ModelMaps.empty(intrinsics.height, intrinsics.width, self.device)
        self._match = wp.empty((intrinsics.height, intrinsics.width), dtype=wp.int32, device=self.device)
        self._clock: dict[str, float] = {}
        self.stages_ms: dict[str, list[float]] = defaultdict(list)

    def adopt(self, surfels: SurfelMap) -> None:
        """Go on with this map: a new one, or one that was loaded; it lies on the mapper's device."""
        self.surfels = surfels
        self.blocks = Blocks(surfels, self.config.surfels.stable_weight)
        self._sweep = Sweep(surfels, self.blocks)

    def step(self, frame: Frame) -> StepResult:
        """Process one frame: preprocess, track, associate, fuse, clean up, segment, label, predict."""
        self._clock = {}
        inserted, segmented = 0, False
        with self._stage("preprocess"):
            depth = self._checked_depth(frame)
            maps = preprocess(frame.rgb, depth, self.cameras, self.device)
        with self._stage("track"):
            tracked, reason, health = self._locate(frame, maps)
        if tracked:
            with self._stage("associate"):
                self._visible = self.visible(self.T_world_camera)
                self._associate(maps[0])
            with self._stage("fuse"):
                T, camera = self.T_world_camera, self.camera
                inserted = fuse_frame(self.surfels, camera, T, maps[0], self._match, time=self.time)
            with self._stage("clean up"):
                self._clean_up(maps[0])
            with self._stage("segment"):
                due = self.segmenter is not None and self.schedule.due(self.T_world_camera)
                probabilities = self.segmenter(frame) if due and self.segmenter else None
            with self._stage("label"):
                segmented = probabilities is not None
                if probabilities is not None:
                    self._label(maps[0], probabilities)
            with self._stage("predict"):
                self.view = self._predict()
                self.tracker.remember(maps)
        self.time += 1
        self.trajectory.append(TrajectoryPoint(frame.time, self.T_world_camera.copy(), tracked))
        for name, ms in self._clock.items():
            self.stages_ms[name].append(ms)
        return StepResult(
            self.T_world_camera.copy(), tracked, health, reason, inserted, segmented, self._clock
        )

    def skip(self, time: float) -> None:
        """Record a frame that could not be read: it counts as lost and carries the last pose."""
        self.time += 1
        self.trajectory.append(TrajectoryPoint(time, self.T_world_camera.copy(), False))

    def probabilities(self) -> np.ndarray:
        """Class probabilities of every surfel under the configured rule, shape (N, 13), uniform if unlabelled."""
        labels = self.config.labels
        return posterior(self.surfels, rule=labels.rule, temperature=labels.temperature)

    def save(self, run_dir: Path | str) -> None:
        """Write map.ply, labels.ply, trajectory.txt, classes.json and the checkpoint into a folder."""
        from dsmap.fusion.run_folder import save_run

        save_run(self, Path(run_dir))

    @property
    def tracked_frames(self) -> int:
        return sum(point.tracked for point in self.trajectory)

    def _checked_depth(self, frame: Frame) -> np.ndarray:
        expected = (self.intrinsics.height, self.intrinsics.width)
        for name, image in (("depth", frame.depth), ("colour", frame.rgb)):
            if image.shape[:2] != expected:
                found = f"{image.shape[1]}x{image.shape[0]}"
                raise InputError(
                    f"frame {frame.index}: {name} is {found}; expected {expected[1]}x{expected[0]}, the camera's size"
                )
        return clean_depth(frame.depth, self.config.depth_min, self.config.depth_max)

    def _locate(self, frame: Frame, maps: list[FrameMaps]) -> tuple[bool, str, Health | None]:
        if self.config.poses == "given":
            if frame.T_world_camera is None:
                return False, "no pose is given for this frame", None
            self.T_world_camera = np.asarray(frame.T_world_camera, dtype=np.float64)
            return True, "", None
        vertex = maps[0].vertex.numpy()
        if np.count_nonzero(vertex[::4, ::4, 2]) < _MIN_DEPTH_PIXELS * vertex[::4, ::4, 2].size:
            return False, "too little depth", None
        if self.view is None:
            return True, "", None  # the first frame defines the world
        T_prev_cur, health = self.tracker.track(maps, self.view)
        if health.tracked:
            self.T_world_camera = orthonormal(self.view.T_world_camera @ T_prev_cur)
        return health.tracked, health.reason, health

    @property
    def _t_active(self) -> int:
        return max(self.time - self.config.surfels.active_window, 0)

    def _associate(self, maps: FrameMaps) -> None:
        surfels = self.config.surfels
        associate(
            self.surfels, self.camera, self.T_world_camera, maps.vertex, maps.normal, maps.edge, match=self._match,
            max_ray_distance=surfels.max_ray_distance, max_ray_distance_z2=surfels.ray_distance_z2,
            max_angle=surfels.max_angle, visible=self._visible,
        )  # fmt: skip

    def visible(self, T_world_camera: np.ndarray) -> wp.array:
        """Blocks of the map that may hold what a frame from this pose sees: `visible` of the kernels' launchers."""
        config = self.config.surfels
        gate = max(config.max_ray_distance, config.ray_distance_z2 * self.config.depth_max**2)
        # A surfel passes the gate along a ray up to a pixel beside its own, so a little further away.
        reach = (self.config.depth_max + gate) * (1 + 2 / self.camera.fx)
        return self.blocks.visible(self.camera, T_world_camera, reach)

    def _clean_up(self, maps: FrameMaps) -> None:
        surfels, walk = self.config.surfels, self._visible
        if self.time % surfels.clean_every == 0:
            walk = self.blocks.to_clean(walk, self.time, surfels.unstable_frames)
            prune(
                self.surfels, self.camera, self.T_world_camera, maps.depth, maps.edge, self._match, time=self.time,
                stable_weight=surfels.stable_weight, max_unseen=surfels.unstable_frames, t_min=self._t_active,
                margin=surfels.max_ray_distance, margin_z2=surfels.ray_distance_z2, walk=walk,
            )  # fmt: skip
        self.blocks.measure(walk)
        self._sweep.step()
        self._visible = self.visible(self.T_world_camera)  # with the frame's new surfels

    def _label(self, maps: FrameMaps, probabilities: np.ndarray) -> None:
        update_labels(
            self.surfels, self.camera, self.T_world_camera, maps.depth, maps.edge, probabilities,
            rule=self.config.labels.rule, floor=self.config.labels.floor,
            max_distance=self.config.surfels.max_ray_distance, max_distance_z2=self.config.surfels.ray_distance_z2,
            visible=self._visible,
        )  # fmt: skip

    def _predict(self) -> ModelView:
        predict_model(
            self.surfels, self.camera, self.T_world_camera, max_depth=self.config.depth_max, maps=self.maps,
            stable_weight=self.config.surfels.stable_weight, t_min=0, visible=self._visible,
        )  # fmt: skip
        T = self.T_world_camera.copy()
        return ModelView(self.maps.vertex, self.maps.normal, intensity_map(self.maps.colour), LEVELS, T)

    @contextmanager
    def _stage(self, name: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        if self.device.is_cuda:
            wp.synchronize_device(self.device)
        self._clock[name] = (time.perf_counter() - start) * 1e3


def _level(intrinsics: Intrinsics, level: int, width: int, height: int) -> Intrinsics:
    # Level sizes round down; the block means then leave out an odd last row or column.
    cropped = Intrinsics(
        width << level, height << level, intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy
    )  # fmt: skip
    return cropped.scaled(width, height)


def _device(name: str) -> wp.Device:
    chosen = name
    if name == "auto":
        chosen = "cuda:0" if wp.is_cuda_available() else "cpu"
    if chosen.startswith("cuda") and not wp.is_cuda_available():
        raise InputError(
            f"device {name!r} was asked for, but this machine has no CUDA driver; expected --device cpu"
        )
    return wp.get_device(chosen)
