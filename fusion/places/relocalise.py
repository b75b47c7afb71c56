"""Where is this frame in the map: keyframes that look like it, then registration, then strict checks.

Serves global loop closure and recovery after tracking was lost. A wrong answer ruins the map and a missing
one costs only time, so every step may say no: the candidate's small view must register; the model, predicted
where that puts the camera, must register at full size; and the whole depth and colour image must then agree
with the model, because look-alike places agree where they were registered and differ elsewhere.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from dsmap.frame import Intrinsics, orthonormal
from dsmap.fusion.config import RelocaliseConfig, TrackConfig
from dsmap.fusion.places.ferns import Keyframe, SmallView, small_view
from dsmap.fusion.surfels.model_view import ModelView
from dsmap.fusion.tracking.agreement import Agreement, agreement, reason_to_reject_pose
from dsmap.fusion.tracking.tracker import Health, Tracker
from dsmap.kernels.camera import make_camera
from dsmap.kernels.preprocess import preprocess
from dsmap.kernels.types import FrameMaps

_SMALL_LEVELS = 2
"""Pyramid levels of a small view: 80x60 and 40x30."""
_GUESS = -1
"""Index of a keyframe that is a guess."""
_CPU = wp.get_device("cpu")


@dataclass
class Relocation:
    """A pose found in the map, and why it is believed."""

    T_world_camera: np.ndarray
    keyframe: Keyframe
    similarity: float
    health: Health
    agreement: Agreement
    certain: bool
    """Whether it is to be believed by itself; else see `sightings`."""


class Relocaliser:
    """Finds camera poses in a map without a guess.

    Args:
        config: gates.
        track: of the tracker; registration uses the same terms with all pixels and more iterations.
        cameras: of the pyramid, finest first.
        intrinsics: of the frames.
        size: (h, w) of the database's small views.
    """

    def __init__(
        self,
        config: RelocaliseConfig,
        track: TrackConfig,
        cameras: Sequence[Any],
        intrinsics: Intrinsics,
        size: tuple[int, int],
    ):
        self.config = config
        self._size = h, w = size
        self._small_cameras = [
            make_camera(intrinsics.scaled(w >> level, h >> level)) for level in range(_SMALL_LEVELS)
        ]
        # The small view only has to come near: the gates are wide, the verdict falls at full size.
        small = replace(
            track, iterations=(10, 15), stride=(1,) * _SMALL_LEVELS, min_gradient=(5.0, 3.0), max_distance=0.5,
            max_angle_deg=40.0, so3=True, min_inlier_fraction=config.small_inlier_fraction, max_rms=0.1,
            max_std=0.1,
        )  # fmt: skip
        self._small = Tracker(small, self._small_cameras)
        self._full = Tracker(replace(track, so3=False, max_std=config.max_std), cameras)
        self.rejected: list[str] = []
        """Why each candidate of the last call was refused, in words."""

    def relocalise(
        self,
        maps: Sequence[FrameMaps],
        view: SmallView,
        candidates: Sequence[tuple[Keyframe, float]],
        predict_at: Callable[[np.ndarray], ModelView],
        guesses: Sequence[np.ndarray] = (),
    ) -> Relocation | None:
        """The pose of a frame in the map, or None: the first certain one, else the first that passes.

        Args:
            maps: of the frame, finest first.
            view: the frame's small view.
            candidates: of the fern database, best first.
            predict_at: renders the model at T_world_camera; all of it, or its inactive part only.
            guesses: poses T_world_camera near which the camera may be, tried first.
        """
        self.rejected, uncertain = [], None
        imagined = ((self._imagined(predict_at(T)), 1.0) for T in guesses)
        for keyframe, similarity in itertools.chain(imagined, candidates):
            found = self._verify(maps, view, keyframe, similarity, predict_at)
            if isinstance(found, Relocation):
                if found.certain:
                    return found
                uncertain = uncertain or found
                found = f"uncertain, {found.agreement.seen_through:.0%} of the model is seen through"
            name = "guess" if keyframe.index == _GUESS else f"keyframe {keyframe.index}"
            self.rejected.append(f"{name}: {found}")
        return uncertain

    def _verify(
        self,
        maps: Sequence[FrameMaps],
        view: SmallView,
        keyframe: Keyframe,
        similarity: float,
        predict_at: Callable[[np.ndarray], ModelView],
    ) -> Relocation | str:
        config = self.config
        T_keyframe_camera, health = self._align_small(view, keyframe.view)
        if not health.tracked:
            return f"its small view does not fit: {health.reason}"
        T = orthonormal(keyframe.T_world_camera @ T_keyframe_camera)
        for _ in range(config.rounds):
            # Predicted anew where the camera is now thought to be, so that the views overlap as tracking's do.
            model = predict_at(T)
            T_model_camera, health = self._full.track(maps, model)
            if not health.tracked:
                return f"the model does not fit: {health.reason}"
            T = orthonormal(model.T_world_camera @ T_model_camera)
        if health.inlier_fraction < config.min_inlier_fraction:
            return f"only {health.inlier_fraction:.0%} of the pixels match the model"
        if health.rms_icp > config.max_rms:
            return f"point-to-plane RMS {health.rms_icp * 1e3:.1f} mm"
        seen = predict_at(T).level(0)
        found = agreement(maps[0], seen.vertex, seen.intensity, config)
        if not found.coloured:  # shapes alone are alike in many places
            return "frame or model show nothing by their colours"
        certain = found.seen_through <= config.certain_seen_through
        return reason_to_reject_pose(found, config) or Relocation(
            T, keyframe, similarity, health, found, certain
        )

    def _imagined(self, model: ModelView) -> Keyframe:
        """A keyframe that was never taken: the model rendered from a guessed pose."""
        seen = model.level(0)
        grey = np.repeat(seen.intensity.numpy()[..., None], 3, axis=2)
        view = small_view(grey, seen.vertex.numpy()[..., 2], self._size)
        return Keyframe(_GUESS, view, model.T_world_camera, _GUESS)

    def _align_small(self, view: SmallView, keyframe: SmallView) -> tuple[np.ndarray, Health]:
        """T_keyframe_camera from the two small views: rotation only first, then all six."""
        last = preprocess(keyframe.rgb, keyframe.depth, self._small_cameras, _CPU)
        model = ModelView(last[0].vertex, last[0].normal, last[0].intensity, _SMALL_LEVELS, np.eye(4))
        self._small.remember(last[-1].surface)
        return self._small.track(preprocess(view.rgb, view.depth, self._small_cameras, _CPU), model)
