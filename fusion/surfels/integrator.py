"""Taking a frame into the map: associate, fuse, clean up, write labels."""

from typing import Any

import numpy as np
import warp as wp

from dsmap.fusion.config import MapConfig
from dsmap.fusion.surfels.views import Views
from dsmap.kernels.associate import associate_surfels
from dsmap.kernels.compact import Compaction
from dsmap.kernels.coverage import MapView, thin_out
from dsmap.kernels.fuse import FusedColours, fuse_frame
from dsmap.kernels.label import update_labels
from dsmap.kernels.label_smooth import smooth_probabilities
from dsmap.kernels.prune import prune
from dsmap.kernels.types import FrameMaps


class Integrator:
    """Changes the surfels of a map by one frame after the other, from poses that are known.

    Call `associate_surfels`, `fuse`, `clean_up` and `label` in this order. `visible` is then the list of blocks that
    the frame may see, with its new surfels.

    Args:
        config: surfel and label parameters.
        views: of the map.
    """

    def __init__(self, config: MapConfig, views: Views):
        self.config, self.views = config, views
        self.compaction = Compaction(views.surfels, views.blocks)
        self.visible: wp.array | None = None
        camera = self._camera = views.cameras[0]
        number: Any = wp.int32  # Warp's hint knows float alone
        self._match = wp.empty((camera.height, camera.width), dtype=number, device=views.surfels.device)

    def associate(self, T_world_camera: np.ndarray, maps: FrameMaps, t_active: int) -> None:
        """Find the surfel, updated since frame `t_active`, that every pixel of the frame measures again."""
        surfels = self.config.surfels
        self.visible = self.views.visible(T_world_camera)
        associate_surfels(
            self.views.surfels, self._camera, T_world_camera, maps, match=self._match,
            max_ray_distance=surfels.max_ray_distance,
            max_ray_distance_z2=surfels.ray_distance_z2, max_angle=surfels.max_angle, t_min=t_active,
            visible=self.visible,
        )  # fmt: skip

    def fuse(
        self,
        T_world_camera: np.ndarray,
        maps: FrameMaps,
        time: int,
        view: MapView | None,
        grows: bool,
        colours: FusedColours = FusedColours.ALL,
    ) -> int:
        """Average the frame into its surfels and insert what is new; returns how many surfels are.

        view: of the map as it is, None if that is empty; grows: whether surfels may be inserted, which in a map with a
        finest resolution is only so where the view shows all there are.
        """
        return fuse_frame(
            self.views.surfels, self._camera, T_world_camera, maps, self._match, time=time, colours=colours,
            resolution=self.config.surfels.resolution, view=view, grows=grows,
        )  # fmt: skip

    def clean_up(self, T_world_camera: np.ndarray, maps: FrameMaps, time: int, t_active: int) -> None:
        """Take out what was never confirmed, what the frame sees through and what is there twice."""
        surfels, walk = self.config.surfels, self.visible
        assert walk is not None
        if time % surfels.clean_every == 0:
            if surfels.resolution > 0:
                thin_out(self.views.surfels, self._camera, maps, self._match, surfels.resolution)
            walk = self.views.blocks.to_clean(walk, time, surfels.unstable_frames)
            prune(
                self.views.surfels, self._camera, T_world_camera, maps, self._match, time=time,
                stable_weight=self.config.stable_weight, max_unseen=surfels.unstable_frames, t_min=t_active,
                margin=surfels.max_ray_distance, margin_z2=surfels.ray_distance_z2, walk=walk,
            )  # fmt: skip
        self.views.blocks.measure(walk)
        self.compaction.step()
        self.visible = self.views.visible(T_world_camera)

    def label(
        self, T_world_camera: np.ndarray, maps: FrameMaps, probabilities: np.ndarray | None, t_active: int
    ) -> bool:
        """Fuse class probabilities of the frame, where there are any, into the surfels it sees."""
        if probabilities is None:
            return False
        labels, surfels = self.config.labels, self.config.surfels
        observed: Any = probabilities
        if labels.smooth > 0:
            observed = smooth_probabilities(
                probabilities, self._camera, maps.vertex, maps.normal, radius=labels.smooth
            )
        update_labels(
            self.views.surfels, self._camera, T_world_camera, maps, observed,
            rule=labels.rule, floor=labels.floor,
            sureness=0.0 if labels.rule == "bayes" else labels.sureness, max_distance=surfels.max_ray_distance,
            max_distance_z2=surfels.ray_distance_z2, t_min=t_active, visible=self.visible,
        )  # fmt: skip
        return True
