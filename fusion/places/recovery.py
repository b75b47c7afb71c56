"""Finding the camera in the whole map: by its last motion, by turning guesses, and by keyframes that look alike."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.fusion.config import MapConfig
from dsmap.fusion.places.ferns import FernDatabase, small_size, small_view
from dsmap.fusion.places.relocalise import Relocaliser, Relocation
from dsmap.fusion.places.rotation_search import search_rotation
from dsmap.fusion.places.sightings import Sightings
from dsmap.fusion.state import part_of, with_prefix
from dsmap.fusion.surfels.model_view import ModelView
from dsmap.fusion.surfels.views import Views
from dsmap.fusion.trajectory import TrajectoryPoint, extrapolated
from dsmap.kernels.index_map import ALWAYS
from dsmap.kernels.preprocess import intensity_map
from dsmap.kernels.types import FrameMaps, ModelMaps

_TURNED = 3
"""So many of the guesses that were turned to where a lost frame fits are verified."""


class Recovery:
    """Owns the keyframes, and finds lost frames with them; does nothing where loops are off or poses given.

    Args:
        config: every parameter.
        intrinsics: of the frames.
        views: of the map.
    """

    def __init__(self, config: MapConfig, intrinsics: Intrinsics, views: Views):
        self.enabled = config.loops.mode != "off" and config.poses == "track"
        self.views = views
        self._config = config.ferns
        size = small_size(intrinsics, config.ferns.width)
        self.ferns = FernDatabase(config.ferns, size, config.depth_range, config.ferns.seed)
        self._relocaliser = Relocaliser(config.relocalise, config.track, views.cameras, intrinsics, size)
        self.sightings = Sightings(config.relocalise)

    @property
    def rejected(self) -> list[str]:
        """Why each candidate of the last search was refused, in words."""
        return self._relocaliser.rejected

    def find(
        self, frame: Sequence[FrameMaps], time: int, trajectory: Sequence[TrajectoryPoint]
    ) -> np.ndarray | None:
        """T_world_camera of a frame that tracking lost, found in the whole map, or None.

        Sought where the last motion would have led, turned to where the frame fits; then by keyframes. A pose that is
        not certain has to be found in several frames in a row.
        """
        if not self.enabled:
            return None
        small = small_view(frame[0].colour.numpy(), frame[0].vertex.numpy()[..., 2], self.ferns.size)
        candidates = self.ferns.candidates(self.ferns.encode(small), time, min_age=0)
        likely = extrapolated(trajectory)
        turned = search_rotation(frame[-1], self.views.cameras[-1], likely, self._coarse)[:_TURNED]
        guesses = [*turned, *likely[:1]]
        found = self._relocaliser.relocalise(frame, small, candidates, self.whole, guesses)
        return self.sightings.pose(time, found)

    def remember_view(
        self, maps: ModelMaps, T_world_camera: np.ndarray, time: int
    ) -> Callable[[Sequence[FrameMaps], Callable[[np.ndarray], ModelView]], Relocation | str | None]:
        """Keep a predicted view as a keyframe if it is a new one.

        Returns:
            A search by keyframes that look like it: a function of a frame and of what renders the model, which gives
            a place; None where no keyframe looks like it; or why all were refused, in words.
        """
        small = small_view(maps.colour.numpy(), maps.vertex.numpy()[..., 2], self.ferns.size)
        code = self.ferns.encode(small)
        self.ferns.add_if_novel(code, small, T_world_camera, time)

        def search(
            frame: Sequence[FrameMaps], predict_at: Callable[[np.ndarray], ModelView]
        ) -> Relocation | str | None:
            candidates = self.ferns.candidates(code, time)
            if not candidates:
                return None
            found = self._relocaliser.relocalise(frame, small, candidates, predict_at)
            return found if found is not None and found.certain else "; ".join(self.rejected)

        return search

    def whole(self, T_world_camera: np.ndarray, t_max: int = ALWAYS) -> ModelView:
        """The whole map from a pose, or the part that was last updated in frame t_max or before."""
        maps = self.views.empty()
        self.views.render(T_world_camera, maps, t_max=t_max)
        return self.views.pyramid(T_world_camera, maps)

    def state(self) -> dict[str, Any]:
        """What is carried from frame to frame."""
        if not self.enabled:
            return {}
        seen = [[time, T.tolist()] for time, T in self.sightings.seen]
        return with_prefix("ferns.", self.ferns.state()) | {"sightings": seen}

    def load_state(self, state: dict[str, Any]) -> None:
        """Go on where `state` was taken."""
        if self.enabled:
            self.ferns = FernDatabase.from_state(self._config, self.ferns.size, part_of(state, "ferns."))
            self.sightings.seen = [(time, np.array(T)) for time, T in state.get("sightings", [])]

    def check_fits(self, state: dict[str, Any], where: str) -> None:
        """Make sure that a frame of this camera can be found by the keyframes of a saved map.

        Raises:
            InputError: there are none, or they were taken with a camera of another shape.
        """
        if not self.enabled or not len(state.get("ferns.codes", ())):
            raise InputError(
                f"{where}: this map has no keyframes; expected one that was made with --loops on"
            )
        theirs, ours = state["ferns.rgb"].shape[1:3], self.ferns.size
        if theirs != ours:
            raise InputError(
                f"{where}: its keyframes are {theirs[1]}x{theirs[0]}, those of this recording {ours[1]}x{ours[0]}; "
                "expected images of the same aspect ratio"
            )

    def _coarse(self, T_world_camera: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The whole map on the coarsest level: intensity, and where there is a surface."""
        last = len(self.views.cameras) - 1
        maps = self.views.empty(last)
        self.views.render(T_world_camera, maps, level=last)
        return intensity_map(maps.colour).numpy(), maps.vertex.numpy()[..., 2] > 0
