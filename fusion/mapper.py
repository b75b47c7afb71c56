"""The main step of dsmap: a frame goes in, the pose and the labelled surfel map come out."""

import copy
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import warp as wp

from dsmap.errors import InputError
from dsmap.frame import Frame, Intrinsics, orthonormal
from dsmap.fusion.config import MapConfig
from dsmap.fusion.labels.gravity import MapGravity
from dsmap.fusion.labels.segment import segment
from dsmap.fusion.labels.semantics import Schedule
from dsmap.fusion.lie import inverse
from dsmap.fusion.loops.loop_closure import LoopCloser
from dsmap.fusion.loops.record import LoopRecord, Moment
from dsmap.fusion.segmenter import Segmenter, wants_geometry
from dsmap.fusion.step_result import StepResult
from dsmap.fusion.surfels.integrator import Integrator
from dsmap.fusion.surfels.model_view import ModelView
from dsmap.fusion.surfels.views import Views, has_left, pyramid_cameras
from dsmap.fusion.tracking.motion_filter import Motion
from dsmap.fusion.tracking.moving_things import MovingThings, without
from dsmap.fusion.tracking.pose_check import PoseCheck
from dsmap.fusion.tracking.rolling_shutter import at_once, put_right, rolling
from dsmap.fusion.tracking.tracker import Tracker
from dsmap.fusion.trajectory import TrajectoryPoint, extrapolated
from dsmap.kernels.compact import Sweep
from dsmap.kernels.culling import Blocks
from dsmap.kernels.label import posterior
from dsmap.kernels.preprocess import clean_depth, preprocess
from dsmap.kernels.runtime import chosen_device
from dsmap.kernels.types import FrameMaps, SurfelMap

LEVELS = 3
"""Pyramid levels of tracking."""
_MIN_DEPTH_PIXELS = 0.02
"""A frame with a smaller share of valid depth is lost: there is nothing to track or to fuse."""


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
        self.device = chosen_device(config.device)
        self.cameras = pyramid_cameras(intrinsics, LEVELS)
        self.camera = self.cameras[0]
        self.tracker = Tracker(config.track, self.cameras)
        self.motion = Motion(config.track)
        self.schedule = Schedule(config.labels)
        self.gravity = MapGravity(intrinsics, config.camera_up)
        self.surfels = SurfelMap.empty(self.device)
        self.blocks = Blocks(self.surfels, config.surfels.stable_weight)
        self.views = Views(config, self.blocks, self.cameras)
        self.integrator = Integrator(config, self.views)
        self.check = PoseCheck(config, self.views)
        looping = config.loops.mode != "off" and config.poses == "track"
        self.closer = LoopCloser(config, intrinsics, self.views) if looping else None
        self.moving = MovingThings(config, self.cameras)
        self.view: ModelView | None = None
        self.view_t_active = 0
        self.time = 0
        self.last_fused = -1
        self.first_frame = 0
        """Frames before this one belong to an earlier recording, in whose map this one started."""
        self.T_world_camera = np.eye(4)
        self.trajectory: list[TrajectoryPoint] = []
        self.maps = self.views.empty()
        self._clock: dict[str, float] = {}
        self.stages_ms: dict[str, list[float]] = defaultdict(list)

    def adopt(self, surfels: SurfelMap) -> None:
        """Go on with this map: a new one, or one that was loaded; it lies on the mapper's device."""
        self.surfels = self.blocks.surfels = surfels
        self.blocks.forget()
        self.integrator.sweep = Sweep(surfels, self.blocks)

    def prepare(self, frame: Frame) -> list[FrameMaps]:
        """The frame's maps for `step`, finest first; touches nothing of the mapper, so any thread may do it.

        Raises:
            InputError: the frame has not the camera's size.
        """
        frame.check_size(self.intrinsics)
        depth = clean_depth(frame.depth, self.config.depth_min, self.config.depth_max)
        return preprocess(frame.rgb, depth, self.cameras, self.device)

    def step(self, frame: Frame, maps: list[FrameMaps] | None = None, waited_ms: float = 0.0) -> StepResult:
        """Process one frame: preprocess, track, mask, associate, fuse, clean up, segment, label, predict, loops.

        maps: of `prepare`, changed; None prepares them now. waited_ms: for them, counted as `preprocess`.
        """
        self._clock = {"preprocess": waited_ms}
        result = StepResult(self.T_world_camera, False, None, "", 0, False, stages_ms=self._clock)
        if maps is None:
            with self._stage("preprocess"):
                maps = self.prepare(frame)
        light = maps[-1].intensity
        with self._stage("track"):
            self._locate(frame, maps, result)
        if result.tracked:
            with self._stage("moving"):
                self._set_movers_apart(maps, result, frame.taken)
        self.trajectory.append(
            TrajectoryPoint(frame.time, self.T_world_camera.copy(), result.tracked, frame.depth_time)
        )
        if result.tracked:
            with self._stage("associate"):
                self.integrator.associate(self.T_world_camera, maps[0], self._t_active)
            with self._stage("fuse"):
                result.inserted = self.integrator.fuse(self.T_world_camera, maps[0], self.time)
            with self._stage("clean up"):
                self.integrator.clean_up(self.T_world_camera, maps[0], self.time, self._t_active)
            with self._stage("segment"):
                probabilities = self._segment(frame, maps[0])
            with self._stage("label"):
                result.segmented = self.integrator.label(
                    self.T_world_camera, maps[0], probabilities, self._t_active
                )
            if self._view_is_old(result):
                with self._stage("predict"):
                    self._predict()
                with self._stage("loops"):
                    result.loop = self._close_loops(maps)
            self.tracker.remember(light)
            self.last_fused = self.time
        self.time += 1
        for name, ms in self._clock.items():
            self.stages_ms[name].append(ms)
        result.T_world_camera = self.T_world_camera.copy()
        return result

    def skip(self, time: float) -> None:
        """Record a frame that could not be read: it counts as lost and carries the last pose."""
        self.time += 1
        self.trajectory.append(TrajectoryPoint(time, self.T_world_camera.copy(), False))

    def probabilities(self) -> np.ndarray:
        """Class probabilities of every surfel under the configured rule, shape (N, 13), uniform if unlabelled."""
        labels = self.config.labels
        return posterior(self.surfels, rule=labels.rule, temperature=labels.temperature)

    @property
    def up(self) -> np.ndarray:
        """Which way is up in the world's frame, from the whole map so far: a unit vector, shape (3,)."""
        now = copy.copy(self.gravity)  # looking at the map between two frames must not change what follows
        now.update(self.surfels, self.config.surfels.stable_weight, self.trajectory)
        return self.T_world_camera[:3, :3] @ now.in_camera(self.T_world_camera)

    @property
    def sweep(self) -> Sweep:
        """The compaction under way."""
        return self.integrator.sweep

    @property
    def loops(self) -> list[LoopRecord]:
        """The loops closed so far."""
        return self.closer.records if self.closer else []

    @property
    def tracked_frames(self) -> int:
        return sum(point.tracked for point in self.trajectory)

    def _locate(self, frame: Frame, maps: list[FrameMaps], result: StepResult) -> None:
        """Find the camera's pose: given, tracked, or, when tracking has lost it, by keyframes."""
        if self.config.poses == "given":
            result.tracked = frame.T_world_camera is not None
            result.reason = "" if result.tracked else "no pose is given for this frame"
            if frame.T_world_camera is not None:
                self.T_world_camera = np.asarray(frame.T_world_camera, dtype=np.float64)
                rows = rolling(self.config.readout_s, self.trajectory, frame.taken, np.eye(4))
                maps[:] = at_once(self.cameras, maps, rows, self.T_world_camera)
            return
        depth = maps[0].vertex.numpy()[::4, ::4, 2]
        if np.count_nonzero(depth) < _MIN_DEPTH_PIXELS * depth.size:
            result.reason = "too little depth"
        elif self.view is None and self.surfels.count == 0:
            result.tracked = True  # the first frame defines the world
        elif self.view is None:
            result.reason = "not found in the map yet"
            self._relocalise(maps, result)
        else:
            self._track(maps, self.view, result, frame.taken)

    def _track(self, maps: list[FrameMaps], view: ModelView, result: StepResult, taken: float) -> None:
        """Track from the last pose; after a gap the map is searched first, which looks closer and further.

        Where that leads astray, once more from where constant motion leads, and by depth and colours alone.
        """
        gap = bool(self.trajectory) and not self.trajectory[-1].tracked
        if gap and self.closer:
            self._relocalise(maps, result)
            if result.tracked:
                return
        T_view_world, t_min = inverse(view.T_world_camera), self.view_t_active
        expected = self.motion.expected(self.trajectory, taken, T_view_world)
        rows = rolling(self.config.readout_s, self.trajectory, taken, T_view_world)
        starts = [(True, self.T_world_camera, expected)]
        starts += [(False, T, None) for T in extrapolated(self.trajectory)[:1]]
        for first, T_start, motion in starts:
            T_prev_cur, result.health = self.tracker.track(
                maps, view, T_view_world @ T_start, first, motion, rows
            )
            T = orthonormal(view.T_world_camera @ T_prev_cur)
            still = at_once(self.cameras, maps, rows, T_prev_cur)
            result.reason = self.check.objection(still, T, result.health, self.trajectory, t_min, not first)
            if not result.reason:
                self.T_world_camera, result.tracked = T, True
                maps[:] = still
                return
        if self.closer and not gap:
            self._relocalise(maps, result)

    def _set_movers_apart(self, maps: list[FrameMaps], result: StepResult, taken: float) -> None:
        """Mask what moves, and track once more without it: it must not steer the camera."""
        moving = self.moving.mask(maps, self.trajectory, self.T_world_camera)
        result.moving = 0.0 if moving is None else float(moving.mean())
        if result.health is None or result.relocalised or self.view is None:
            return
        view, T_view_world = self.view, inverse(self.view.T_world_camera)
        T_view_cur = T_view_world @ self.T_world_camera
        if moving is not None:
            expected = self.motion.expected(self.trajectory, taken, T_view_world)
            T_still, health = self.tracker.track(without(maps, moving), view, T_view_cur, False, expected)
            T = orthonormal(view.T_world_camera @ T_still)
            if not self.check.objection(maps, T, health, self.trajectory, self.view_t_active):
                self.T_world_camera, T_view_cur, result.health = T, T_still, health
        self.motion.learn(self.trajectory, taken, self.T_world_camera, T_view_cur, result.health.covariance)

    def _relocalise(self, maps: list[FrameMaps], result: StepResult) -> None:
        assert self.closer is not None
        found = self.closer.relocalise(maps, self.time, self.trajectory)
        if found is not None:
            self.T_world_camera = found
            self.closer.wake(maps, found, self.time, self._t_active)
            result.tracked = result.relocalised = True

    @property
    def _t_active(self) -> int:
        """Surfels updated since this frame are active; lost frames do not make the map older."""
        if self.closer is None:
            return 0
        return max(self.last_fused + 1 - self.config.surfels.active_window, 0)

    def _segment(self, frame: Frame, maps: FrameMaps) -> np.ndarray | None:
        if self.segmenter is None or not self.schedule.due(self.T_world_camera):
            return None
        frame = put_right(frame, maps) if self.config.readout_s else frame
        if wants_geometry(self.segmenter):
            self.gravity.update(self.surfels, self.config.surfels.stable_weight, self.trajectory)
        return segment(self.segmenter, frame, maps, self.T_world_camera, self.gravity)

    def _view_is_old(self, result: StepResult) -> bool:
        """Whether the view is to be predicted anew: in its turn, where the camera has left it, and for loops."""
        track, T = self.config.track, self.T_world_camera
        if self.view is None or result.relocalised or self.time % track.predict_every == 0:
            return True
        if self.closer is not None and self.closer.looks(self.time, T, self._t_active):
            return True
        return has_left(track, self.view.T_world_camera, T)

    def _predict(self) -> None:
        """The active model's view from the camera, which the next frame is tracked against."""
        self.view_t_active = self._t_active
        T, t_min = self.T_world_camera, self.view_t_active
        self.views.render(T, self.maps, t_min=t_min, visible=self.integrator.visible)
        self.view = self.views.pyramid(T, self.maps)

    def _close_loops(self, maps: list[FrameMaps]) -> LoopRecord | None:
        if self.closer is None or self.view is None:
            return None
        before = len(self.closer.records)
        now = Moment(maps, self.view, self.maps, self.time, self._t_active, self.trajectory)
        if self.closer.close(now):
            self.T_world_camera = self.trajectory[-1].T_world_camera.copy()
            self.integrator.visible = self.views.visible(self.T_world_camera)
            self._predict()
        return self.closer.records[-1] if len(self.closer.records) > before else None

    @contextmanager
    def _stage(self, name: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        if self.device.is_cuda:
            wp.synchronize_device(self.device)
        self._clock[name] = (time.perf_counter() - start) * 1e3
