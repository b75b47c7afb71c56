"""Is a tracked pose to be believed: a second look at the whole image where the motion surprises.

Registration reports how well the pixels fit that it has matched. It may slide along a wall, or lock on to the
wrong place after a gap, with hundreds of pixels that fit. So after lost frames, where the motion departs
from the last one, or where few pixels match, the model is rendered from the new pose and compared with the
whole frame. Elsewhere this costs nothing.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dsmap.fusion.config import MapConfig
from dsmap.fusion.lie import inverse, pose_difference
from dsmap.fusion.surfels.views import Views
from dsmap.fusion.tracking.agreement import agreement, reason_to_reject_pose
from dsmap.fusion.tracking.image_content import Colours
from dsmap.fusion.tracking.tracker import Health
from dsmap.fusion.trajectory import TrajectoryPoint
from dsmap.kernels.preprocess import intensity_map
from dsmap.kernels.types import FrameMaps

_WIDTH = 320
"""Views are compared on the finest pyramid level that is not wider [px]."""
_ONE_SURFACE = 0.9
"""The depths agree if they do in this share of what the map covers."""
_BLURRED = 0.75
"""Colours of a blurred map correlate by this share of what sharp ones do."""


class PoseCheck:
    """Compares a frame with the map from the pose that tracking found, where there is reason to doubt it.

    Args:
        config: every parameter.
        views: of the map.
    """

    def __init__(self, config: MapConfig, views: Views):
        self.config, self.views = config, views
        narrow = [level for level, camera in enumerate(views.cameras) if camera.width <= _WIDTH]
        self._level = min(narrow, default=len(views.cameras) - 1)
        self._maps = views.empty(self._level)

    def reason_to_reject(
        self,
        frame: Sequence[FrameMaps],
        T_world_camera: np.ndarray,
        health: Health,
        trajectory: Sequence[TrajectoryPoint],
        t_min: int,
        doubted: bool = False,
        colours: Colours = Colours.GOOD,
        followed: bool = False,
    ) -> str:
        """Why the pose is not believed, in words; empty if it is.

        Args:
            frame: maps of the frame, finest first.
            trajectory: of all frames before this one.
            t_min: surfels updated since then take part.
            doubted: look at the whole image in any case.
            colours: what the frame's are good for.
            followed: the last frames tell where a camera is whose rows are read one after the other: where all depths
                agree, its map may be blurred.
        """
        if not health.tracked:
            return health.reason
        if not doubted and not self.surprising(T_world_camera, health, trajectory):
            return ""
        config = self.config.relocalise
        self.views.render(T_world_camera, self._maps, level=self._level, t_min=t_min)
        found = agreement(frame[self._level], self._maps.vertex, intensity_map(self._maps.colour), config)
        by_colour = health.comparable and colours is Colours.GOOD
        if followed and found.same >= _ONE_SURFACE and found.seen_through < config.certain_seen_through:
            config = replace(
                config, min_ncc=_BLURRED * config.min_ncc, min_texture=_BLURRED * config.min_texture
            )
        return reason_to_reject_pose(found, config, by_colour)

    def surprising(
        self, T_world_camera: np.ndarray, health: Health, trajectory: Sequence[TrajectoryPoint]
    ) -> bool:
        """Whether frames were lost before, the motion differs much from the last one, or few pixels match."""
        config = self.config.track
        if len(trajectory) < 2:
            return False
        if not trajectory[-1].tracked or health.inlier_fraction < config.doubt_inlier_fraction:
            return True
        before, last = (point.T_world_camera for point in trajectory[-2:])
        expected = last @ inverse(before) @ last if trajectory[-2].tracked else last
        distance, angle = pose_difference(expected, T_world_camera)
        return distance > config.doubt_distance or angle > config.doubt_angle_deg
