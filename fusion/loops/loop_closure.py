"""Loop closure: the part of the map that is in use now is fitted to the part that was mapped long ago.

Local: the active model's view is registered to the inactive model's view from the same pose (Whelan et al.
2015, section 5). Global: a keyframe that looks like the view says where the camera may be. Either way the
inactive view from the pose found is rendered, the active view must register to it once more, and then the
deformation graph moves the active part onto the inactive one (Eq. 4); what agreed becomes active again.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from dsmap.frame import orthonormal
from dsmap.fusion.config import MapConfig
from dsmap.fusion.lie import inverse
from dsmap.fusion.loops.constraints import ClosedLoops, constraints
from dsmap.fusion.loops.corrected_way import StepCovariances, follow_way, world_corrections
from dsmap.fusion.loops.deformation_graph import Constraints, DeformationGraph
from dsmap.fusion.loops.gates import Overlap, explained_rms, reason_to_reject_loop, rms_shift, view_overlap
from dsmap.fusion.loops.record import LoopCandidate, LoopQuery, LoopRecord, record_values
from dsmap.fusion.places.recovery import Recovery
from dsmap.fusion.surfels.model import SurfelModel
from dsmap.fusion.surfels.model_view import ModelView
from dsmap.fusion.tracking.tracker import Health, Tracker
from dsmap.fusion.trajectory import path_length, pose_array
from dsmap.kernels.deform import INFLUENCES

_VGA_PIXELS = 640 * 480
"""Published pixel counts are those of this image size."""
_MIN_STRIP = 0.004
"""Share of the image from which an inactive surface that comes into view is looked at."""
_LEAST_DRIFT = 0.05
"""Drift [m] that is likely after no way at all."""
_NEVER = -(10**9)
_TIGHT = 0.01
"""So far a second registration may move the camera, and a strip of surface that comes into view may lie beside the
active one [m RMS]: registration of two noisy views is no better than 0.5-1 cm."""


class LoopCloser:
    """Closes loops; does nothing where they are off or the map is frozen. Everything it remembers is `records`,
    `closed`, `verified` and `refused`.

    Args:
        config: every parameter.
        model: the map.
        recovery: keeps the keyframes.
    """

    def __init__(self, config: MapConfig, model: SurfelModel, recovery: Recovery):
        self.config, self.loops, self.model, self.views = config, config.loops, model, model.views
        self.recovery = recovery
        self.enabled = recovery.enabled and not model.frozen
        self.level = model.narrow_level
        self.camera = model.cameras[self.level]
        iterations = (self.loops.iterations,) * len(model.cameras)
        # The gates here are the loops' own, not those of tracking.
        self._tracker = Tracker(
            replace(config.track, iterations=iterations, min_inlier_fraction=0.0), model.cameras
        )
        self._active = self.views.empty(self.level)
        self.records: list[LoopRecord] = []
        self.closed = ClosedLoops()
        self.steps = StepCovariances()
        """Of every frame, with `loops.pose_graph`."""
        self.verified = _NEVER
        """Last frame in which the active and the inactive view were found to agree."""
        self.refused = _NEVER
        """Frame of the last registration that was not believed."""
        self.rejected = ""
        """Why the last attempt was given up, in words."""

    def is_due(self, time: int, T_world_camera: np.ndarray) -> bool:
        """Whether `close` has anything to do with this frame: keyframes are asked, or something inactive is near."""
        if not self.recovery.enabled:
            return False
        return time % self.loops.global_every == 0 or self.model.has_inactive(T_world_camera)

    def remember_step(self, time: int, health: Health | None, tracked: bool) -> None:
        """Note how surely a frame's step was tracked: a pose graph spreads corrections accordingly."""
        if self.enabled and self.loops.pose_graph:
            self.steps.remember(time, health.covariance if tracked and health else None)

    def close(self, now: LoopQuery) -> LoopRecord | None:
        """Close a loop where there is one; the map, the trajectory and the model's view change with it.

        Returns:
            The loop; None if there is none, or surfels became active without one.
        """
        if not self.enabled:
            return None
        if now.relocalised:
            self.verified = now.time
        before = len(self.records)
        self.rejected = ""
        changed = self._local(now)
        if self.rejected:
            self.refused = now.time
        if self.loops.mode in ("on", "global"):
            changed = self._global(now, try_it=not changed) or changed
        if changed:
            self.model.has_moved(now.trajectory[-1].T_world_camera)
        return self.records[-1] if len(self.records) > before else None

    def state(self) -> dict[str, Any]:
        """What is carried from frame to frame."""
        if not self.recovery.enabled:
            return {}
        state = {"closed.points": self.closed.points, "closed.times": self.closed.times}
        loops = [record_values(record) for record in self.records]
        if self.loops.pose_graph:
            state["step_covariances"] = self.steps.array()
        return state | {"verified": self.verified, "refused": self.refused, "loops": loops}

    def load_state(self, state: dict[str, Any]) -> None:
        """Go on where `state` was taken."""
        if not self.recovery.enabled:
            return
        self.closed.points, self.closed.times = state["closed.points"], state["closed.times"]
        self.verified, self.refused = state["verified"], state["refused"]
        self.steps = StepCovariances(state.get("step_covariances"))
        self.records[:] = [
            LoopRecord(**values | {"T_destination_frame": np.array(values["T_destination_frame"])})
            for values in state["loops"]
        ]

    def _local(self, now: LoopQuery) -> bool:
        if not self.model.has_inactive(now.T_world_camera):
            return False  # the usual case costs no view
        self.model.render_inactive(now.T_world_camera)
        seen = view_overlap(now.view.level(self.level), self.model.inactive)
        if seen.both < _MIN_STRIP:
            return False
        inactive = self.views.pyramid(now.T_world_camera, self.model.inactive, self.level)
        if self._is_attached(now) and self._agrees(now, inactive, seen):
            return self._reactivate_view(now)
        if seen.both * _VGA_PIXELS < self.loops.min_inliers:
            return False
        if now.time - self.refused < self.loops.retry:
            return False
        T_inactive_active, health = self._register(now, inactive)
        self.rejected = reason_to_reject_loop(health, self.loops)
        return not self.rejected and self._try(
            "local", now, orthonormal(now.T_world_camera @ T_inactive_active)
        )

    def _global(self, now: LoopQuery, try_it: bool) -> bool:
        search = self.recovery.remember_view(now.maps, now.T_world_camera, now.time)
        if not try_it or self._is_attached(now) or now.time % self.loops.global_every:
            return False
        t_max = self.model.t_active - 1
        found = search(now.frame, lambda T_world_camera: self.recovery.whole(T_world_camera, t_max=t_max))
        if found is None:
            return False
        if isinstance(found, str):
            self.rejected = found
            return False
        return self._try("global", now, found.T_world_camera, found.similarity)

    def _try(self, kind: str, now: LoopQuery, T_found: np.ndarray, similarity: float = 1.0) -> bool:
        """Close the loop that puts the camera at T_found, if every check says yes."""
        # Once more, from where the first registration puts the camera: a true match stays where it is.
        self.model.render_inactive(T_found)
        inactive = self.views.pyramid(T_found, self.model.inactive, self.level)
        T_inactive_active, health = self._register(now, inactive)
        points = now.view.level(self.level).vertex.numpy()
        again = rms_shift(points, T_inactive_active)
        seen = view_overlap(now.view.level(self.level), inactive.level(self.level), colours=True)
        self.rejected = reason_to_reject_loop(health, self.loops, seen, again, _TIGHT)
        if self.rejected:
            return False
        T_found = orthonormal(T_found @ T_inactive_active)
        shift = rms_shift(points, inverse(now.T_world_camera) @ T_found)
        match = LoopCandidate(kind, T_found, shift, health, similarity)
        if shift < self.loops.negligible:
            self._note_agreement(now, match)
            self.model.render_inactive(now.T_world_camera)
            return self._reactivate_view(now)
        if seen.both < self.loops.min_overlap:
            self.rejected = f"the views share only {seen.both:.0%} of the image"
            return False
        if self.loops.mode == "global" and kind == "local":
            return False
        return self._deform(now, match)

    def _note_agreement(self, now: LoopQuery, match: LoopCandidate) -> None:
        """A revisit after which nothing has to be bent is a loop, too, unless it is the same revisit as before."""
        if self._is_attached(now):
            return
        self.model.render_inactive(match.T_world_camera)
        found = self._constraints(now, match.T_world_camera)
        if found is not None:
            self.records.append(match.record(now, found[1]))

    def _deform(self, now: LoopQuery, match: LoopCandidate) -> bool:
        T_found = match.T_world_camera
        self.model.render_inactive(T_found)
        found = self._constraints(now, T_found)
        if found is None:
            self.rejected = "too few constraints"
            return False
        pairs, frame_destination = found
        poses = pose_array(now.trajectory)
        limit = self.loops.max_drift * path_length(poses[frame_destination:]) + _LEAST_DRIFT
        if match.shift_m > limit:
            self.rejected = f"{match.shift_m * 100:.1f} cm of drift, at most {limit * 100:.1f} cm are likely"
            return False
        record = match.record(now, frame_destination)
        graph, moved = self._graph_along_way(poses, record, pairs) if self.loops.pose_graph else (None, None)
        if graph is None:
            moved = None
            graph = self._bent_graph(lambda _: pairs)
        if graph is None:
            return False
        self.records.append(replace(record, nodes=len(graph)))
        T = self._bend(graph, now, poses, T_found, moved)
        if moved is not None:  # what the loop was found on has moved, too
            pairs = replace(pairs, destination=graph.apply_to_points(pairs.destination, pairs.t_destination))
        self.closed.add(pairs)
        self.views.render(T, self._active, level=self.level, t_min=self.model.t_active)
        self.model.render_inactive(T)
        self._reactivate(T, self._active.vertex, now.time)
        return True

    def _graph_along_way(
        self, poses: np.ndarray, record: LoopRecord, pairs: Constraints
    ) -> tuple[DeformationGraph | None, np.ndarray]:
        """A graph that follows the pose graph of all loops (None: it would tear); and what moves each frame's world."""
        moved = world_corrections(poses, self.steps.scaled(len(poses)), [*self.records, record])
        return self._bent_graph(lambda graph: follow_way(graph, moved, pairs)), moved

    def _constraints(self, now: LoopQuery, T_found: np.ndarray) -> tuple[Constraints, int] | None:
        return constraints(
            now.maps, self.model.inactive, self.camera, self.model.surfels, now.T_world_camera, T_found,
            self.loops.constraint_grid,
        )  # fmt: skip

    def _bent_graph(self, wanted: Callable[[DeformationGraph], Constraints]) -> DeformationGraph | None:
        """A graph that does what is wanted of it and keeps closed what was closed before; None if it would tear."""
        surfels, config = self.model.surfels, self.config
        if np.count_nonzero(surfels.numpy()["weight"] > 0) <= INFLUENCES:
            return None
        scale = self.model.cameras[0].width * self.model.cameras[0].height / _VGA_PIXELS
        sized = replace(config.graph, spacing=max(int(config.graph.spacing * scale), 1))
        graph = DeformationGraph.build(surfels, sized, config.stable_weight)
        fit = graph.optimise(Constraints.joined([wanted(graph), self.closed.constraints()]))
        self.rejected = fit.reason
        return graph if fit.accepted else None

    def _bend(
        self,
        graph: DeformationGraph,
        now: LoopQuery,
        poses: np.ndarray,
        T_found: np.ndarray,
        moved: np.ndarray | None,
    ) -> np.ndarray:
        """Move all that lies in the world: surfels, trajectory, keyframes, earlier constraints, the camera.

        Returns:
            Where the camera is now: T_found, or, where a pose graph has `moved` each frame's world, where that says.
        """
        graph.apply_to_surfels(self.model.surfels)
        self.model.blocks.forget()
        self.closed.move(graph)
        ferns = self.recovery.ferns
        if moved is not None:
            ferns.poses = moved[ferns.times.clip(0, len(moved) - 1)] @ ferns.poses
            after = moved @ poses
        else:
            ferns.poses = graph.apply_to_poses(ferns.poses, ferns.times)
            after = graph.apply_to_poses(poses, np.arange(len(poses)))
            after[-1] = T_found
        now.trajectory.set_poses(after)
        return after[-1]

    def _agrees(self, now: LoopQuery, inactive: ModelView, seen: Overlap) -> bool:
        """Whether what comes into view needs no registration: it lies where the active view says."""
        rms, share = explained_rms(self._tracker, self.level, now.view, inactive, seen)
        return rms < _TIGHT and share > self.loops.min_agreement

    def _reactivate_view(self, now: LoopQuery) -> bool:
        active = now.view.level(self.level).vertex
        return self._reactivate(now.T_world_camera, active, now.time) > 0

    def _reactivate(self, T_world_camera: np.ndarray, active_vertex: wp.array, time: int) -> int:
        self.verified = time
        return self.model.reactivate(T_world_camera, active_vertex, time)

    def _register(self, now: LoopQuery, inactive: ModelView) -> tuple[np.ndarray, Health]:
        return self._tracker.register(now.view.levels, inactive, np.eye(4))

    def _is_attached(self, now: LoopQuery) -> bool:
        """Whether the active and the inactive part were found to agree a moment ago."""
        return now.time - self.verified <= self.loops.trust
