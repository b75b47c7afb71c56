"""The map: surfels, where they lie, what they look like, and how a frame changes them."""

from typing import Any

import numpy as np
import warp as wp

from dsmap.frame import Intrinsics
from dsmap.fusion.config import MapConfig
from dsmap.fusion.stage_clock import StageClock
from dsmap.fusion.surfels.integrator import Integrator
from dsmap.fusion.surfels.model_view import ModelView
from dsmap.fusion.surfels.views import Views, pyramid_cameras, view_is_stale
from dsmap.kernels.compact import Compaction
from dsmap.kernels.coverage import MapView
from dsmap.kernels.culling import Blocks
from dsmap.kernels.fuse import FusedColours
from dsmap.kernels.reactivate import reactivate
from dsmap.kernels.runtime import chosen_device
from dsmap.kernels.types import FrameMaps, SurfelMap

LEVELS = 3
"""Pyramid levels of tracking."""
_VIEW = ("vertex", "normal", "colour")


class SurfelModel:
    """Owns the surfels and all that follows from them: blocks, compaction, views, and the view predicted last.

    Args:
        config: every parameter.
        intrinsics: of the frames.
        surfels: a map to go on with, on the configured device; None: an empty one.
        frozen: the map stays as it is, whatever frames come.

    Raises:
        InputError: the device is not there.
    """

    def __init__(
        self,
        config: MapConfig,
        intrinsics: Intrinsics,
        surfels: SurfelMap | None = None,
        frozen: bool = False,
    ):
        self.config, self.frozen = config, frozen
        self.device = chosen_device(config.device)
        self.cameras = pyramid_cameras(intrinsics, LEVELS)
        self.surfels = SurfelMap.empty(self.device) if surfels is None else surfels
        self.blocks = Blocks(self.surfels, config.stable_weight, config.surfels.resolution > 0)
        self.views = Views(config, self.blocks, self.cameras)
        self.integrator = Integrator(config, self.views)
        narrow = [level for level, c in enumerate(self.cameras) if c.width <= config.track.view_width]
        self.view_level = min(narrow, default=LEVELS - 1)
        """The pyramid level that frames are registered on at last."""
        self.predict_every = config.track.predict_every
        """Frames from one prediction to the next at most; a live session that has to keep up changes it."""
        self.maps = self.views.empty(self.view_level)
        """The active model as predicted last, on that level."""
        self.view: ModelView | None = None
        """The same as a pyramid; None before the first prediction."""
        self.view_t_active = 0
        """Surfels updated since this frame are in `view`."""
        self.last_fused = -1
        """The last frame that was fused."""
        self._grown = False
        """Whether the map has grown since `view` was predicted."""
        self._ages = config.loops.mode != "off" and config.poses == "track" and not frozen
        narrow = [level for level, c in enumerate(self.cameras) if c.width <= config.loops.view_width]
        self.narrow_level = min(narrow, default=LEVELS - 1)
        """The pyramid level that active and inactive part are compared on."""
        self.inactive = self.views.empty(self.narrow_level)
        """The inactive model as `render_inactive` rendered it last."""

    @property
    def t_active(self) -> int:
        """Surfels updated since this frame are active; lost frames do not make the map older."""
        return max(self.last_fused + 1 - self.config.surfels.active_window, 0) if self._ages else 0

    @property
    def compaction(self) -> Compaction:
        """The compaction under way."""
        return self.integrator.compaction

    def integrate(
        self,
        maps: FrameMaps,
        T_world_camera: np.ndarray,
        time: int,
        clock: StageClock,
        colours: FusedColours = FusedColours.ALL,
    ) -> int:
        """Take a frame into the map: associate, fuse, clean up; returns how many surfels are new."""
        t_active = self.t_active
        if self.frozen:
            self.integrator.visible = self.views.visible(T_world_camera)
            return 0
        with clock.stage("associate"):
            self.integrator.associate(T_world_camera, maps, t_active)
        with clock.stage("fuse"):
            grows = self.view is None or not self._grown or self.config.surfels.resolution == 0
            inserted = self.integrator.fuse(T_world_camera, maps, time, self._map_view, grows, colours)
            self._grown = self._grown or grows
        with clock.stage("clean up"):
            self.integrator.clean_up(T_world_camera, maps, time, t_active)
        return inserted

    def label(self, maps: FrameMaps, T_world_camera: np.ndarray, probabilities: np.ndarray | None) -> bool:
        """Fuse class probabilities of the frame, where there are any, into the surfels it sees."""
        return self.integrator.label(T_world_camera, maps, probabilities, self.t_active)

    def is_stale(self, T_world_camera: np.ndarray, time: int) -> bool:
        """Whether the view is to be predicted anew: in its turn, or where the camera has left it."""
        track = self.config.track
        if self.view is None or time % self.predict_every == 0:
            return True
        return view_is_stale(track, self.view.T_world_camera, T_world_camera)

    def predict(self, T_world_camera: np.ndarray) -> ModelView:
        """The active model's view from the camera, which the next frame is tracked against."""
        self.view_t_active = self.t_active
        visible = self.integrator.visible
        self.views.render(
            T_world_camera, self.maps, level=self.view_level, t_min=self.view_t_active, visible=visible
        )
        self.view = self.views.pyramid(T_world_camera, self.maps, self.view_level)
        self._grown = False
        return self.view

    @property
    def _map_view(self) -> MapView | None:
        if self.view is None:
            return None
        camera = self.cameras[self.view_level]
        return MapView(camera, self.view.T_world_camera, self.maps.vertex, self.maps.normal)

    def has_moved(self, T_world_camera: np.ndarray) -> None:
        """The surfels were bent, or became active: see from the camera what is there now."""
        self.integrator.visible = self.views.visible(T_world_camera)
        self.predict(T_world_camera)

    def has_inactive(self, T_world_camera: np.ndarray) -> bool:
        """Whether blocks with inactive surfels may be in view."""
        return self.views.visible(T_world_camera, self.t_active - 1).shape[0] > 0

    def render_inactive(self, T_world_camera: np.ndarray) -> None:
        """Render the inactive part into `inactive`."""
        self.views.render(
            T_world_camera, self.inactive, level=self.narrow_level, t_max=self.t_active - 1
        )  # fmt: skip

    def reactivate(self, T_world_camera: np.ndarray, active_vertex: wp.array, time: int) -> int:
        """Make active what of `inactive` lies where the active part, or a frame, sees a surface; how many are."""
        surfels = self.config.surfels
        return reactivate(
            self.surfels, self.cameras[self.narrow_level], T_world_camera, self.inactive.vertex, active_vertex,
            time=time, t_min=self.t_active, distance=surfels.max_ray_distance, distance_z2=surfels.ray_distance_z2,
            visible=self.views.visible(T_world_camera),
        )  # fmt: skip

    def state(self) -> dict[str, Any]:
        """What is carried from frame to frame besides the surfels."""
        state: dict[str, Any] = {
            "last_fused": self.last_fused,
            "view_t_active": self.view_t_active,
            "sweep": list(self.compaction.cursor),
            "grown": self._grown,
        }
        if self.view is not None:
            state["view.T_world_camera"] = self.view.T_world_camera
            state |= {f"view.{name}": getattr(self.maps, name).numpy() for name in _VIEW}
        return state

    def load_state(self, state: dict[str, Any]) -> None:
        """Go on where `state` was taken, with the surfels of then."""
        self.last_fused, self.view_t_active = state["last_fused"], state["view_t_active"]
        self.compaction.cursor = tuple(state["sweep"])
        self._grown = bool(state.get("grown", True))
        # A file of a time when views were of another size has none that could be used: the next frame predicts one.
        if "view.T_world_camera" in state and state["view.vertex"].shape[:2] == self.maps.vertex.shape:
            for name in _VIEW:
                getattr(self.maps, name).assign(state[f"view.{name}"])
            self.view = self.views.pyramid(state["view.T_world_camera"], self.maps, self.view_level)
