"""The finished map as a camera sees it."""

import numpy as np
import warp as wp

from dsmap.classes import VOID
from dsmap.frame import Intrinsics
from dsmap.fusion.runs.read_run import SavedRun
from dsmap.kernels.camera import make_camera
from dsmap.kernels.index_map import render_index


class MapRenderer:
    """Renders the finished map into a camera: which surfel a pixel sees, its class, its class probabilities."""

    def __init__(self, run: SavedRun, camera: Intrinsics):
        self.run = run
        self.camera = make_camera(camera)
        self.probabilities = run.probabilities()
        self.label: np.ndarray = run.surfels.numpy()["label"]
        self._index = wp.full((camera.height, camera.width), -1, dtype=wp.int32, device=run.surfels.device)

    def index(self, T_world_camera: np.ndarray) -> np.ndarray:
        """Surfel that each pixel sees, int32 (H, W), -1 where none; overwritten by the next call."""
        render_index(
            self.run.surfels, self.camera, T_world_camera, max_depth=self.run.config.depth_range[1],
            index=self._index, stable_weight=self.run.config.stable_weight,
        )  # fmt: skip
        return np.asarray(self._index.numpy())

    def labels(self, T_world_camera: np.ndarray) -> np.ndarray:
        """Class ids, uint8 (H, W), 0 where no labelled surfel is seen."""
        index = self.index(T_world_camera)
        return np.where(index >= 0, self.label[index], VOID).astype(np.uint8)

    def __call__(self, T_world_camera: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What `labels` gives, and class probabilities, shape (H, W, 13)."""
        label = self.labels(T_world_camera)
        return label, self.probabilities[np.asarray(self._index.numpy(), np.int32)]
