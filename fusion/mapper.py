"""The main step of dsmap: a frame goes in, the pose and the labelled surfel map come out."""

import copy
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dsmap.errors import InputError, InputWarning
from dsmap.frame import Frame, Intrinsics
from dsmap.fusion.config import MapConfig, SegmentConfig
from dsmap.fusion.labels.labeller import Labeller
from dsmap.fusion.locator import Locator
from dsmap.fusion.loops.loop_closure import LoopCloser
from dsmap.fusion.loops.record import LoopQuery, LoopRecord
from dsmap.fusion.objects.things import SceneObjects, find_objects
from dsmap.fusion.segmenter import Segmenter
from dsmap.fusion.stage_clock import StageClock, StageTime
from dsmap.fusion.surfels.model import SurfelModel
from dsmap.fusion.tracking.image_content import Colours
from dsmap.fusion.tracking.tracker import Health
from dsmap.fusion.trajectory import Trajectory, TrajectoryPoint
from dsmap.kernels.label import posterior
from dsmap.kernels.preprocess import depth_in_range, preprocess
from dsmap.kernels.types import FrameMaps, SurfelMap
from dsmap.ranges import check_ranges

_SETTLED = 5
"""A map in which so many frames were surely tracked stays, whatever comes."""
_SETTLED_ANYHOW = 30
"""And one in which so many were, surely or not."""
_ENOUGH = 40
"""So many lost frames in a row that fit each other outweigh a map that is not settled: longer than a covered lens."""


@dataclass(frozen=True)
class StepResult:
    """What one frame did to the map."""

    T_world_camera: np.ndarray
    """Shape (4, 4); of a lost frame that of the last one."""
    tracked: bool
    health: Health | None
    """Of the registration; None where poses are given, and for the first frame."""
    reason: str
    """Why the frame is lost, in words; empty when tracked."""
    inserted: int
    """New surfels."""
    segmented: bool
    """Whether its class probabilities were fused."""
    relocalised: bool
    """Tracking had lost this frame; it was found again by keyframes."""
    loop: LoopRecord | None
    """The loop that was closed after this frame."""
    moving: float
    """Share of the image that moves and is left out of the map."""
    stages_ms: dict[str, float]
    """Wall time of every stage [ms]."""


class Mapper:
    """Tracks a camera, fuses its frames into surfels and labels them (Fig. 2 of the paper).

    Args:
        config: every parameter.
        intrinsics: of the frames that `step` will get.
        segmenter: gives class probabilities of a frame; None maps without labels.
        surfels: a map to go on with, on the configured device; None: an empty one.
        frozen: find and track the camera in that map, and leave it as it is.

    Raises:
        InputError: the image is too small for the pyramid, or the device is not there.
    """

    def __init__(
        self,
        config: MapConfig,
        intrinsics: Intrinsics,
        segmenter: Segmenter | None = None,
        *,
        surfels: SurfelMap | None = None,
        frozen: bool = False,
    ):
        check_ranges(config, str)
        if min(intrinsics.width, intrinsics.height) < 32:
            raise InputError(
                f"images of {intrinsics.width}x{intrinsics.height} are too small; expected at least 32x32"
            )
        self.config, self.intrinsics = config, intrinsics
        self.model = SurfelModel(config, intrinsics, surfels, frozen)
        self.clock = StageClock(self.model.device)
        self.locator = Locator(config, intrinsics, self.model, self.clock)
        self.labeller = Labeller(config, intrinsics, None if frozen else segmenter)
        self.closer = LoopCloser(config, self.model, self.locator.recovery)
        self.segmenter = segmenter
        self.T_world_camera = np.eye(4)
        self.trajectory = Trajectory()
        self.first_frame = 0
        """Frames before this one belong to an earlier recording, in whose map this one started."""
        self.begins_at = 0
        """The map's first frame: those before it were lost with a start that no later frame fitted."""
        self._may_begin_anew = config.poses == "track" and surfels is None and not frozen
        self._sure_frames = 0
        self._rival: Mapper | None = None
        """A map of the frames that this one lost, while it hardly began."""

    def prepare(self, frame: Frame) -> list[FrameMaps]:
        """The frame's maps for `step`, finest first; touches nothing of the mapper, so any thread may do it.

        Raises:
            InputError: the frame has not the camera's size.
        """
        frame.check_size(self.intrinsics)
        depth = depth_in_range(frame.depth, *self.config.depth_range)
        return preprocess(frame.rgb, depth, self.model.cameras, self.model.device)

    def step(
        self, frame: Frame, maps: Sequence[FrameMaps] | None = None, waited_ms: float = 0.0
    ) -> StepResult:
        """Process one frame: prepare, locate, record, integrate, label, predict, close loops.

        maps: of `prepare`; None prepares them now. waited_ms: for them, counted as `preprocess`.
        """
        model, clock, time = self.model, self.clock, self.time
        clock.begin(waited_ms)
        if maps is None:
            with clock.stage("preprocess"):
                maps = self.prepare(frame)
        located = self.locator.locate(frame, maps, self.T_world_camera, self.trajectory)
        T = self.T_world_camera = located.T_world_camera
        self.trajectory.append(TrajectoryPoint(frame.time, T.copy(), located.tracked, frame.depth_time))
        self.closer.remember_step(time, located.health, located.tracked and not located.relocalised)
        inserted, segmented, loop = 0, False, None
        if located.tracked:
            finest = located.maps[0]
            inserted = model.integrate(finest, T, time, clock, located.fused_colours)
            with clock.stage("segment"):
                probabilities = None
                if located.colours is not Colours.UNTRUE:
                    probabilities = self.labeller.probabilities(
                        frame, finest, T, model.surfels, self.trajectory
                    )
            with clock.stage("label"):
                segmented = model.label(finest, T, probabilities)
            if located.relocalised or model.is_stale(T, time) or self.closer.is_due(time, T):
                with clock.stage("predict"):
                    view = model.predict(T)
                with clock.stage("loops"):
                    query = LoopQuery(
                        located.maps, view, model.maps, time, self.trajectory, located.relocalised
                    )
                    loop = self.closer.close(query)
                T = self.T_world_camera = self.trajectory[-1].T_world_camera.copy()
            self.locator.remember(maps, located.colours)
            model.last_fused = time
        clock.end()
        result = StepResult(
            T.copy(), located.tracked, located.health, located.reason, inserted, segmented, located.relocalised,
            loop, located.moving, clock.step_ms,
        )  # fmt: skip
        return result if self.settled else self._doubt_start(frame, maps, result)

    def skip(self, time: float) -> None:
        """Record a frame that could not be read: it counts as lost and carries the last pose."""
        self.trajectory.append(TrajectoryPoint(time, self.T_world_camera.copy(), False))
        if self._rival is not None:
            self._rival.skip(time)

    @property
    def settled(self) -> bool:
        """Whether the map is here to stay; until then a bad first frame (noise, a hand) may be given up."""
        if self._may_begin_anew and (self._sure_frames >= _SETTLED or self.tracked_frames >= _SETTLED_ANYHOW):
            self._may_begin_anew, self._rival = False, None
        return not self._may_begin_anew

    def settle(self) -> None:
        """The recording is over: a map that hardly began gives way to one of the frames that it lost."""
        rival = self._rival
        if not self.settled and rival is not None and rival.tracked_frames >= _SETTLED:
            self._begin_anew(rival)

    def _doubt_start(self, frame: Frame, maps: Sequence[FrameMaps], result: StepResult) -> StepResult:
        """Give up a start that fits none of the frames after it, if those fit each other for long enough.

        A lens that is covered for a second must not end a map, hence the many frames; and a hand, or a bare wall, fits
        itself as well, hence the gate on how surely their poses are known.
        """
        if result.tracked or not self.tracked_frames:
            self._sure_frames += result.tracked and self._is_sure(result)
            self._rival = None
            return result
        seen = result
        for _ in range(2):  # a frame that the rival loses may begin another one
            if self._rival is None:
                self._rival = Mapper(self.config, self.intrinsics, self.segmenter)
                self._rival.be_rival_of(self)
            seen = self._rival.step(frame, maps)
            if seen.tracked and self._is_sure(seen):
                break
            self._rival = None
        if self._rival is None or self._rival.tracked_frames < _ENOUGH:
            return result
        self._begin_anew(self._rival)
        return seen

    def _is_sure(self, result: StepResult) -> bool:
        """Whether the images fix the pose of a tracked frame: a bare wall, or a hand, fits itself anywhere."""
        return result.health is None or result.health.cofactor.max() <= self.config.loops.max_covariance

    def be_rival_of(self, other: "Mapper") -> None:
        """Begin a map with the frame that another mapper has just lost; the frames before are lost for both."""
        past = other.trajectory
        before = len(past) - 1
        nowhere = np.broadcast_to(np.eye(4), (before, 4, 4))
        times, depth_times = past.times[:before], past.depth_times[:before]
        self.trajectory = Trajectory.of_arrays(times, nowhere, np.zeros(before, bool), depth_times)
        self.begins_at, self._may_begin_anew = before, False

    def _begin_anew(self, rival: "Mapper") -> None:
        text = (
            f"the map begins anew at frame {rival.begins_at}: none of {rival.time - rival.begins_at} frames fits what "
            f"the {self.tracked_frames} before had begun, and they fit each other"
        )
        warnings.warn(text, InputWarning, stacklevel=3)
        for name in (
            "model",
            "clock",
            "locator",
            "labeller",
            "closer",
            "trajectory",
            "T_world_camera",
            "begins_at",
        ):
            setattr(self, name, getattr(rival, name))
        self._may_begin_anew, self._rival = False, None

    def probabilities(self) -> np.ndarray:
        """Class probabilities of every surfel under the configured rule, shape (N, 13), uniform if unlabelled."""
        labels = self.config.labels
        return posterior(self.surfels, rule=labels.rule, temperature=labels.posterior_temperature)

    def objects(self, config: SegmentConfig | None = None) -> SceneObjects:
        """The things and the structure of the whole map so far; changes nothing, and takes about a second a million
        surfels, so ask seldom."""
        return find_objects(self.surfels.numpy(), self.probabilities(), self.up, config)

    @property
    def surfels(self) -> SurfelMap:
        """The map."""
        return self.model.surfels

    @property
    def time(self) -> int:
        """Number of the next frame."""
        return len(self.trajectory)

    @property
    def up(self) -> np.ndarray:
        """Which way is up in the world's frame, from the whole map so far: a unit vector, shape (3,)."""
        now = copy.copy(self.labeller.gravity)  # looking between two frames must not change what follows
        now.update(self.surfels, self.config.stable_weight, self.trajectory)
        return self.T_world_camera[:3, :3] @ now.in_camera(self.T_world_camera)

    @property
    def loops(self) -> list[LoopRecord]:
        """The loops closed so far."""
        return self.closer.records

    @property
    def stages(self) -> dict[str, StageTime]:
        """Wall time of every stage over all frames that had it."""
        return self.clock.stages

    @property
    def tracked_frames(self) -> int:
        return int(self.trajectory.tracked.sum())

    def state(self) -> dict[str, Any]:
        """What is carried from frame to frame besides the surfels and the trajectory, by name."""
        own = {"T_world_camera": self.T_world_camera, "time": self.time, "first_frame": self.first_frame}
        own["begins_at"] = self.begins_at
        state = own
        for part in (self.clock, self.model, self.locator, self.labeller, self.closer):
            state |= part.state()
        return state

    def load_state(self, state: dict[str, Any], trajectory: Sequence[TrajectoryPoint]) -> None:
        """Go on where `state` was taken, with the surfels and the trajectory of then."""
        self._load_map_state(state, trajectory)
        self.first_frame, self.begins_at = state["first_frame"], state.get("begins_at", 0)
        for part in (self.clock, self.model, self.locator, self.labeller):
            part.load_state(state)

    def start_in_saved_map(
        self, state: dict[str, Any], trajectory: Sequence[TrajectoryPoint], where: str
    ) -> None:
        """Let the next frame be the first of a new recording, to be found in the map by its keyframes.

        The saved frames keep their numbers; `first_frame` is the first of the new recording.

        Raises:
            InputError: the map has no keyframes, or they were taken with a camera of another shape.
        """
        self.locator.recovery.check_fits(state, where)
        self._load_map_state(state, trajectory)
        self.first_frame, self.model.last_fused = self.time, state["last_fused"]

    def _load_map_state(self, state: dict[str, Any], trajectory: Sequence[TrajectoryPoint]) -> None:
        """What belongs to the map: the trajectory, keyframes, loops."""
        self.trajectory = Trajectory(trajectory)
        self.T_world_camera = state["T_world_camera"]
        self.locator.recovery.load_state(state)
        self.closer.load_state(state)
