"""Loop closure: the part of the map that is in use now is fitted to the part that was mapped long ago.

Local: the active model's view is registered to the inactive model's view from the same pose (Whelan et al.
2015, section 5). Global: a keyframe that looks like the view says where the camera may be. Either way the
inactive view from the pose found is rendered, the active view must register to it once more, and then the
deformation graph moves the active part onto the inactive one (Eq. 4); what agreed becomes active again.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import warp as wp

from dsmap.frame import Intrinsics, orthonormal
from dsmap.fusion.config import MapConfig
from dsmap.fusion.lie import inverse
from dsmap.fusion.loops.constraints import ClosedLoops, constraints
from dsmap.fusion.loops.deformation_graph import Constraints, DeformationGraph
from dsmap.fusion.loops.gates import Overlap, explained_rms, objection, overlap, rms_shift
from dsmap.fusion.loops.record import LoopRecord, Match, Moment
from dsmap.fusion.places.ferns import FernDatabase, small_size, small_view
from dsmap.fusion.places.relocalise import Relocaliser
from dsmap.fusion.places.rotation_search import swept
from dsmap.fusion.places.sightings import Sightings
from dsmap.fusion.surfels.model_view import ModelView
from dsmap.fusion.surfels.views import Views
from dsmap.fusion.tracking.tracker import Health, Tracker
from dsmap.fusion.trajectory import TrajectoryPoint, extrapolated, poses_of, way
from dsmap.kernels.deform import INFLUENCES
from dsmap.kernels.preprocess import intensity_map
from dsmap.kernels.reactivate import reactivate
from dsmap.kernels.types import FrameMaps

_VGA_PIXELS = 640 * 480
"""Published pixel counts are those of this image size."""
_MIN_STRIP = 0.004
"""Share of the image from which an inactive surface that comes into view is looked at."""
_LEAST_DRIFT = 0.05
"""Drift [m] that is likely after no way at all."""
_NEVER = -(10**9)
_TURNED = 3
"""So many of the guesses that were turned to where a lost frame fits are verified."""
_TIGHT = 0.01
"""So far a second registration may move the camera, and a strip of surface that comes into view may lie beside the
active one [m RMS]: registration of two noisy views is no better than 0.5-1 cm."""


class LoopCloser:
    """Closes loops; owns the keyframes. Everything it remembers is `ferns`, `sightings`, `records`,
    `closed`, `verified` and `refused`.

    Args:
        config: every parameter.
        intrinsics: of the frames.
        views: of the map.
    """

    def __init__(self, config: MapConfig, intrinsics: Intrinsics, views: Views):
        self.config, self.loops, self.views = config, config.loops, views
        cameras = views.cameras
        narrow = [level for level, c in enumerate(cameras) if c.width <= self.loops.view_width]
        self.level = min(narrow, default=len(cameras) - 1)
        self.camera = cameras[self.level]
        iterations = (self.loops.iterations,) * len(cameras)
        # The gates here are the loops' own, not those of tracking.
        self._tracker = Tracker(
            replace(config.track, iterations=iterations, min_inlier_fraction=0.0), cameras
        )
        self._inactive, self._active = views.empty(self.level), views.empty(self.level)
        size = small_size(intrinsics, config.ferns.width)
        self.ferns = FernDatabase(config.ferns, size, (config.depth_min, config.depth_max), config.ferns.seed)
        self._relocaliser = Relocaliser(config.relocalise, config.track, cameras, intrinsics, size)
        self.sightings = Sightings(config.relocalise)
        self.records: list[LoopRecord] = []
        self.closed = ClosedLoops()
        self.verified = _NEVER
        """Last frame in which the active and the inactive view were found to agree."""
        self.refused = _NEVER
        """Frame of the last registration that was not believed."""
        self.rejected = ""
        """Why the last attempt was given up, in words."""

    def looks(self, time: int, T_world_camera: np.ndarray, t_active: int) -> bool:
        """Whether `close` has anything to do with this frame: keyframes are asked, or something inactive is near."""
        return time % self.loops.global_every == 0 or self._is_near(T_world_camera, t_active)

    def close(self, now: Moment) -> bool:
        """Close a loop where there is one.

        Returns:
            Whether the map has changed: surfels became active, or were moved, and the trajectory with them.
        """
        self.rejected = ""
        changed = self._local(now)
        if self.rejected:
            self.refused = now.time
        if self.loops.mode in ("on", "global"):
            changed = self._global(now, try_it=not changed) or changed
        return changed

    def relocalise(
        self, frame: Sequence[FrameMaps], time: int, trajectory: list[TrajectoryPoint]
    ) -> np.ndarray | None:
        """T_world_camera of a frame that tracking lost, found in the whole map, or None.

        Sought where the last motion would have led, turned to where the frame fits; then by keyframes. A pose that is
        not certain has to be found in several frames in a row.
        """
        small = small_view(frame[0].colour.numpy(), frame[0].vertex.numpy()[..., 2], self.ferns.size)
        candidates = self.ferns.candidates(self.ferns.encode(small), time, min_age=0)
        likely = extrapolated(trajectory)
        turned = swept(frame[-1], self.views.cameras[-1], likely, self._coarse)[:_TURNED]
        guesses = [*turned, *likely[:1]]
        found = self._relocaliser.relocalise(frame, small, candidates, self._whole, guesses)
        return self.sightings.pose(time, found)

    def wake(self, frame: Sequence[FrameMaps], T_world_camera: np.ndarray, time: int, t_active: int) -> None:
        """Make the map that a relocalised frame sees active again."""
        self._render_inactive(T_world_camera, t_active)
        self._reactivate(T_world_camera, frame[self.level].vertex, time, t_active)

    def _local(self, now: Moment) -> bool:
        if not self._is_near(now.T_world_camera, now.t_active):
            return False  # the usual case costs no view
        self._render_inactive(now.T_world_camera, now.t_active)
        seen = overlap(now.view.levels[self.level], (self._inactive.vertex,))
        if seen.both < _MIN_STRIP:
            return False
        inactive = self.views.pyramid(now.T_world_camera, self._inactive, self.level)
        if self._is_attached(now) and self._agrees(now, inactive, seen):
            return self._wake_view(now)
        if seen.both * _VGA_PIXELS < self.loops.min_inliers:
            return False
        if now.time - self.refused < self.loops.retry:
            return False
        T_inactive_active, health = self._register(now, inactive)
        self.rejected = objection(health, self.loops)
        return not self.rejected and self._try(
            "local", now, orthonormal(now.T_world_camera @ T_inactive_active)
        )

    def _global(self, now: Moment, try_it: bool) -> bool:
        small = small_view(now.maps.colour.numpy(), now.maps.vertex.numpy()[..., 2], self.ferns.size)
        code = self.ferns.encode(small)
        self.ferns.add_if_novel(code, small, now.T_world_camera, now.time)
        if not try_it or self._is_attached(now) or now.time % self.loops.global_every:
            return False
        candidates = self.ferns.candidates(code, now.time)
        if not candidates:
            return False

        def inactive_at(T_world_camera: np.ndarray) -> ModelView:
            return self._whole(T_world_camera, t_max=now.t_active - 1)

        found = self._relocaliser.relocalise(now.frame, small, candidates, inactive_at)
        if found is None or not found.certain:
            self.rejected = "; ".join(self._relocaliser.rejected)
            return False
        return self._try("global", now, found.T_world_camera, found.similarity)

    def _try(self, kind: str, now: Moment, T_found: np.ndarray, similarity: float = 1.0) -> bool:
        """Close the loop that puts the camera at T_found, if every check says yes."""
        # Once more, from where the first registration puts the camera: a true match stays where it is.
        self._render_inactive(T_found, now.t_active)
        inactive = self.views.pyramid(T_found, self._inactive, self.level)
        T_inactive_active, health = self._register(now, inactive)
        points = now.view.levels[self.level][0].numpy()
        again = rms_shift(points, T_inactive_active)
        seen = overlap(now.view.levels[self.level], inactive.levels[self.level], colours=True)
        self.rejected = objection(health, self.loops, seen, again, _TIGHT)
        if self.rejected:
            return False
        T_found = orthonormal(T_found @ T_inactive_active)
        shift = rms_shift(points, inverse(now.T_world_camera) @ T_found)
        match = Match(kind, T_found, shift, health, similarity)
        if shift < self.loops.negligible:
            self._note_agreement(now, match)
            self._render_inactive(now.T_world_camera, now.t_active)
            return self._wake_view(now)
        if seen.both < self.loops.min_overlap:
            self.rejected = f"the views share only {seen.both:.0%} of the image"
            return False
        if self.loops.mode == "global" and kind == "local":
            return False
        return self._deform(now, match)

    def _note_agreement(self, now: Moment, match: Match) -> None:
        """A revisit after which nothing has to be bent is a loop, too, unless it is the same revisit as before."""
        if self._is_attached(now):
            return
        self._render_inactive(match.T_world_camera, now.t_active)
        found = self._constraints(now, match.T_world_camera)
        if found is not None:
            self.records.append(match.record(now, found[1]))

    def _deform(self, now: Moment, match: Match) -> bool:
        T_found = match.T_world_camera
        self._render_inactive(T_found, now.t_active)
        found = self._constraints(now, T_found)
        if found is None:
            self.rejected = "too few constraints"
            return False
        pairs, frame_destination = found
        poses = poses_of(now.trajectory)
        limit = self.loops.max_drift * way(poses[frame_destination:]) + _LEAST_DRIFT
        if match.shift_m > limit:
            self.rejected = f"{match.shift_m * 100:.1f} cm of drift, at most {limit * 100:.1f} cm are likely"
            return False
        graph = self._bent_graph(pairs)
        if graph is None:
            return False
        self.records.append(match.record(now, frame_destination, len(graph)))
        self._bend(graph, now, poses, T_found)
        self.closed.add(pairs)
        self.views.render(T_found, self._active, level=self.level, t_min=now.t_active)
        self._render_inactive(T_found, now.t_active)
        self._reactivate(T_found, self._active.vertex, now.time, now.t_active)
        return True

    def _constraints(self, now: Moment, T_found: np.ndarray) -> tuple[Constraints, int] | None:
        return constraints(
            now.maps, self._inactive, self.camera, self.views.surfels, now.T_world_camera, T_found,
            self.loops.constraint_grid,
        )  # fmt: skip

    def _bent_graph(self, pairs: Constraints) -> DeformationGraph | None:
        """A graph that brings the pairs together and keeps closed what was closed before; None if it would tear."""
        surfels, config = self.views.surfels, self.config
        if np.count_nonzero(surfels.numpy()["weight"] > 0) <= INFLUENCES:
            return None
        scale = self.views.cameras[0].width * self.views.cameras[0].height / _VGA_PIXELS
        sized = replace(config.graph, spacing=max(int(config.graph.spacing * scale), 1))
        graph = DeformationGraph.build(surfels, sized, config.surfels.stable_weight)
        fit = graph.optimise(Constraints.joined([pairs, self.closed.constraints()]))
        self.rejected = fit.reason
        return graph if fit.accepted else None

    def _bend(self, graph: DeformationGraph, now: Moment, poses: np.ndarray, T_found: np.ndarray) -> None:
        """Move all that lies in the world: surfels, trajectory, keyframes, earlier constraints, the camera."""
        graph.apply_to_surfels(self.views.surfels)
        self.views.blocks.forget()
        self.closed.move(graph)
        self.ferns.poses = graph.apply_to_poses(self.ferns.poses, self.ferns.times)
        moved = graph.apply_to_poses(poses, np.arange(len(poses)))
        moved[-1] = T_found
        for point, T_world_camera in zip(now.trajectory, moved, strict=True):
            point.T_world_camera = T_world_camera

    def _agrees(self, now: Moment, inactive: ModelView, seen: Overlap) -> bool:
        """Whether what comes into view needs no registration: it lies where the active view says."""
        rms, share = explained_rms(self._tracker, self.level, now.view, inactive, seen)
        return rms < _TIGHT and share > self.loops.min_agreement

    def _wake_view(self, now: Moment) -> bool:
        active = now.view.levels[self.level][0]
        return self._reactivate(now.T_world_camera, active, now.time, now.t_active) > 0

    def _reactivate(
        self, T_world_camera: np.ndarray, active_vertex: wp.array, time: int, t_active: int
    ) -> int:
        surfels = self.config.surfels
        self.verified = time
        return reactivate(
            self.views.surfels, self.camera, T_world_camera, self._inactive.vertex, active_vertex, time=time,
            t_min=t_active, distance=surfels.max_ray_distance, distance_z2=surfels.ray_distance_z2,
            visible=self.views.visible(T_world_camera),
        )  # fmt: skip

    def _register(self, now: Moment, inactive: ModelView) -> tuple[np.ndarray, Health]:
        return self._tracker.register(now.view.surface, inactive, np.eye(4))

    def _is_attached(self, now: Moment) -> bool:
        """Whether the active and the inactive part were found to agree a moment ago."""
        return now.time - self.verified <= self.loops.trust

    def _is_near(self, T_world_camera: np.ndarray, t_active: int) -> bool:
        return self.views.visible(T_world_camera, t_active - 1).shape[0] > 0

    def _render_inactive(self, T_world_camera: np.ndarray, t_active: int) -> None:
        self.views.render(T_world_camera, self._inactive, level=self.level, t_max=t_active - 1)

    def _coarse(self, T_world_camera: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The whole map on the coarsest level: intensity, and where there is a surface."""
        last = len(self.views.cameras) - 1
        maps = self.views.empty(last)
        self.views.render(T_world_camera, maps, level=last)
        return intensity_map(maps.colour).numpy(), maps.vertex.numpy()[..., 2] > 0

    def _whole(self, T_world_camera: np.ndarray, **window: int) -> ModelView:
        maps = self.views.empty()
        self.views.render(T_world_camera, maps, **window)
        return self.views.pyramid(T_world_camera, maps)
