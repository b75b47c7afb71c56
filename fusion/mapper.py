"""The main step of dsmap: a frame goes in, the pose and the labelled surfel map come out."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dsmap.errors import InputError
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
        return StepResult(
            T.copy(), located.tracked, located.health, located.reason, inserted, segmented, located.relocalised,
            loop, located.moving, clock.step_ms,
        )  # fmt: skip

    def skip(self, time: float) -> None:
        """Record a frame that could not be read: it counts as lost and carries the last pose."""
        self.trajectory.append(TrajectoryPoint(time, self.T_world_camera.copy(), False))

    def probabilities(self) -> np.ndarray:
        """Class probabilities of every surfel under the configured rule, shape (N, 13), uniform if unlabelled."""
        labels = self.config.labels
        return posterior(self.surfels, rule=labels.rule, temperature=labels.temperature)

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
        now.update(self.surfels, self.config.surfels.stable_weight, self.trajectory)
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
        state = own
        for part in (self.clock, self.model, self.locator, self.labeller, self.closer):
            state |= part.state()
        return state

    def load_state(self, state: dict[str, Any], trajectory: Sequence[TrajectoryPoint]) -> None:
        """Go on where `state` was taken, with the surfels and the trajectory of then."""
        self._load_map_state(state, trajectory)
        self.first_frame = state["first_frame"]
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
