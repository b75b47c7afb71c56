"""Where is the camera: given, tracked against the model's view, or, when tracking has lost it, found in the map."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dsmap.frame import Frame, Intrinsics, orthonormal
from dsmap.fusion.config import MapConfig
from dsmap.fusion.lie import inverse
from dsmap.fusion.places.recovery import Recovery
from dsmap.fusion.stage_clock import StageClock
from dsmap.fusion.state import part_of, with_prefix
from dsmap.fusion.surfels.model import SurfelModel
from dsmap.fusion.surfels.model_view import ModelView
from dsmap.fusion.tracking.image_content import Colours
from dsmap.fusion.tracking.motion_filter import MotionFilter
from dsmap.fusion.tracking.moving_things import MovingThings, mask_depth, with_edges
from dsmap.fusion.tracking.observability import BlindWay
from dsmap.fusion.tracking.pose_check import PoseCheck
from dsmap.fusion.tracking.rolling_shutter import row_motion, undo_rolling_shutter
from dsmap.fusion.tracking.tracker import Health, Tracker
from dsmap.fusion.trajectory import TrajectoryPoint, extrapolated
from dsmap.kernels.fuse import FusedColours
from dsmap.kernels.types import FrameMaps

_MIN_DEPTH_PIXELS = 0.02
"""A frame with a smaller share of valid depth is lost: there is nothing to track or to fuse."""


@dataclass(frozen=True)
class Located:
    """Where a frame was taken from."""

    T_world_camera: np.ndarray
    """Shape (4, 4); of a lost frame that of the last one."""
    maps: Sequence[FrameMaps]
    """The frame's, finest first: as if all rows had been taken at once, moving things marked as depth edges."""
    tracked: bool
    reason: str = ""
    """Why the frame is lost, in words; empty when tracked."""
    health: Health | None = None
    """Of the last registration; None where there was none."""
    relocalised: bool = False
    """Tracking had lost this frame; it was found again by keyframes."""
    moving: float = 0.0
    """Share of the image that moves."""
    colours: Colours = Colours.GOOD
    """What the frame's colours are good for."""

    @property
    def fused_colours(self) -> FusedColours:
        """Which surfels take on the frame's colours: none of what is untrue; of another exposure only new ones."""
        if self.colours is Colours.UNTRUE:
            return FusedColours.NONE
        comparable = self.health is None or self.health.comparable
        return FusedColours.ALL if comparable else FusedColours.NEW


class Locator:
    """Finds the pose of one frame after the other; owns tracking, the camera's motion and recovery.

    Args:
        config: every parameter.
        intrinsics: of the frames.
        model: the map that frames are located in; relocalised frames make active again what they see of it.
        clock: times the stages `track` and `moving`.
    """

    def __init__(self, config: MapConfig, intrinsics: Intrinsics, model: SurfelModel, clock: StageClock):
        self.config, self.model, self._clock = config, model, clock
        self.tracker = Tracker(config.track, model.cameras)
        self.motion = MotionFilter(config.track)
        self.blind = BlindWay()
        self.check = PoseCheck(config, model.views)
        self.moving = MovingThings(config, model.cameras)
        self.recovery = Recovery(config, intrinsics, model.views)

    def locate(
        self,
        frame: Frame,
        maps: Sequence[FrameMaps],
        T_world_last: np.ndarray,
        trajectory: Sequence[TrajectoryPoint],
    ) -> Located:
        """Find a frame.

        Args:
            maps: of the frame, finest first; they stay as they are.
            T_world_last: pose of the last frame, shape (4, 4).
            trajectory: of all frames before this one.
        """
        with self._clock.stage("track"):
            colours = self.tracker.colours(maps[-1].surface)
            located = self._find(frame, Located(T_world_last, maps, False, colours=colours), trajectory)
        if located.tracked:
            with self._clock.stage("moving"):
                located = self._set_movers_apart(located, trajectory, frame.pose_time)
        return located

    def remember(self, maps: Sequence[FrameMaps], colours: Colours) -> None:
        """Keep a tracked frame, as it was taken, for the next one's pre-alignment."""
        self.tracker.remember(maps[-1].surface, colours)

    def state(self) -> dict[str, Any]:
        """What is carried from frame to frame."""
        moving, motion = (
            with_prefix("moving.", self.moving.state()),
            with_prefix("motion.", self.motion.state()),
        )
        blind = {"blind_way": self.blind.metres, "blind_held": self.blind.held}
        return moving | motion | blind | self.tracker.state() | self.recovery.state()

    def load_state(self, state: dict[str, Any]) -> None:
        """Go on where `state` was taken."""
        self.moving.load_state(part_of(state, "moving."))
        self.motion.load_state(part_of(state, "motion."))
        self.blind.metres, self.blind.held = (
            float(state.get("blind_way", 0.0)),
            int(state.get("blind_held", 0)),
        )
        self.tracker.load_state(state, self.model.device)

    def _find(self, frame: Frame, last: Located, trajectory: Sequence[TrajectoryPoint]) -> Located:
        model = self.model
        if self.config.poses == "given":
            return self._given(frame, last, trajectory)
        depth = last.maps[0].vertex.numpy()[::4, ::4, 2]
        if np.count_nonzero(depth) < _MIN_DEPTH_PIXELS * depth.size:
            return replace(last, reason="too little depth")
        if model.view is not None:
            return self._track(last, model.view, trajectory, frame.pose_time)
        if model.surfels.count == 0:
            return replace(last, tracked=True)  # the first frame defines the world
        return self._recover(replace(last, reason="not found in the map yet"), trajectory)

    def _given(self, frame: Frame, last: Located, trajectory: Sequence[TrajectoryPoint]) -> Located:
        if frame.T_world_camera is None:
            return replace(last, reason="no pose is given for this frame")
        T = np.asarray(frame.T_world_camera, dtype=np.float64)
        rows = row_motion(self.config.shutter_s, trajectory, frame.pose_time, np.eye(4))
        maps = undo_rolling_shutter(self.model.cameras, last.maps, rows, T)
        return replace(last, T_world_camera=T, maps=maps, tracked=True)

    def _track(
        self, last: Located, view: ModelView, trajectory: Sequence[TrajectoryPoint], pose_time: float
    ) -> Located:
        """Track from the last pose; after a gap the map is searched first, which looks closer and further.

        But not where rows are read one after the other: what is bent looks like nothing in the map, and after a short
        gap the last pose still tells how.

        Where that leads astray, once more from where constant motion leads, and by depth and colours alone.
        """
        gap = bool(trajectory) and not trajectory[-1].tracked
        rows = row_motion(self.config.shutter_s, trajectory, pose_time, inverse(view.T_world_camera))
        search_first = gap and rows is None
        if search_first:
            last = self._recover(last, trajectory)
            if last.tracked:
                return last
        T_view_world, t_min = inverse(view.T_world_camera), self.model.view_t_active
        expected = self.motion.expected(trajectory, pose_time, T_view_world)
        seconds = pose_time - trajectory[-1].pose_time if trajectory else 0.0
        starts = [(True, last.T_world_camera, expected)]
        starts += [(False, T, None) for T in extrapolated(trajectory)[:1]]
        for first, T_start, motion in starts:
            T_view_camera, health = self.tracker.track(
                last.maps, view, T_view_world @ T_start, first, motion, rows, last.colours
            )
            if first:
                self.blind.see(health.unheld)
            T_view_last = T_view_world @ last.T_world_camera
            moved = self.blind.resting(T_view_camera @ inverse(T_view_last), seconds, health.unheld)
            T_view_camera = moved @ T_view_last
            T = orthonormal(view.T_world_camera @ T_view_camera)
            still = undo_rolling_shutter(self.model.cameras, last.maps, rows, T_view_camera)
            reason = self.check.reason_to_reject(
                still, T, health, trajectory, t_min, not first, last.colours, rows is not None
            ) or self.blind.reason_to_reject(moved, health.unheld)
            if not reason:
                self.blind.add(moved, health.unheld)
                return replace(last, T_world_camera=T, maps=still, tracked=True, reason="", health=health)
            last = replace(last, reason=reason, health=health)
        return last if search_first else self._recover(last, trajectory)

    def _recover(self, lost: Located, trajectory: Sequence[TrajectoryPoint]) -> Located:
        """Look for a lost frame in the whole map; what it sees there becomes active again."""
        found = self.recovery.find(lost.maps, len(trajectory), trajectory)
        if found is None:
            return lost
        self.blind.found()
        if not self.model.frozen:
            self.model.render_inactive(found)
            self.model.reactivate(found, lost.maps[self.model.narrow_level].vertex, len(trajectory))
        return replace(lost, T_world_camera=found, tracked=True, reason="", relocalised=True)

    def _set_movers_apart(
        self, located: Located, trajectory: Sequence[TrajectoryPoint], pose_time: float
    ) -> Located:
        """Mark what moves, and track once more without it: it must not steer the camera."""
        maps, T_world_camera, health = located.maps, located.T_world_camera, located.health
        moving = self.moving.mask(maps, trajectory, T_world_camera)
        if moving is not None:
            located = replace(located, maps=with_edges(maps, moving), moving=float(moving.mean()))
        if health is None or located.relocalised or self.model.view is None:
            return located
        view, T_view_world = self.model.view, inverse(self.model.view.T_world_camera)
        T_view_camera = T_view_world @ T_world_camera
        if moving is not None:
            expected = self.motion.expected(trajectory, pose_time, T_view_world)
            still = mask_depth(located.maps, moving)
            T_still, health_still = self.tracker.track(
                still, view, T_view_camera, False, expected, colours=located.colours
            )
            T, t_min = orthonormal(view.T_world_camera @ T_still), self.model.view_t_active
            if not self.check.reason_to_reject(
                located.maps, T, health_still, trajectory, t_min, colours=located.colours
            ):
                T_world_camera, T_view_camera, health = T, T_still, health_still
        self.motion.learn(trajectory, pose_time, T_world_camera, T_view_camera, health.covariance)
        return replace(located, T_world_camera=T_world_camera, health=health)
