"""The depth sensors that can be imitated, by name: their noise, range and camera."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dsmap.frame import Intrinsics
from dsmap.sim_scenes.sensors.azure import azure_depth
from dsmap.sim_scenes.sensors.d435 import d435_depth
from dsmap.sim_scenes.sensors.kinect import kinect_depth

ROOM_M = 8.0
"""Depth range of a rendered room without a sensor's limits [m]."""
DepthNoise = Callable[..., np.ndarray]


@dataclass(frozen=True)
class Sensor:
    """A camera whose colour and depth images are registered to each other."""

    focal: float
    """fx = fy of both images at a width of 640 [px]."""
    depth_max: float
    """Depth beyond which it is not to be trusted [m], for calibration.yaml."""
    noise: DepthNoise | None
    """(true depth, camera, glass, rgb, seed=, frame=) -> depth; None = the true depth."""

    def camera(self, width: int, height: int) -> Intrinsics:
        """The sensor's own intrinsics at an image size: square pixels, principal point in the middle."""
        focal = self.focal * width / 640.0
        return Intrinsics(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)

    def measure(
        self, depth: np.ndarray, camera: Intrinsics, glass: np.ndarray, rgb: np.ndarray, seed: int, frame: int
    ) -> np.ndarray:
        """What the sensor gives in place of the true planar depth [m], float32 (H, W), 0 = nothing."""
        if self.noise is None:
            return depth
        return self.noise(depth, camera, glass, rgb, seed=seed, frame=frame)


def _kinect(
    depth: np.ndarray, camera: Intrinsics, glass: np.ndarray, rgb: np.ndarray, *, seed: int, frame: int
) -> np.ndarray:
    return kinect_depth(depth, camera, glass, seed=seed, frame=frame)


SENSORS = {
    "none": Sensor(525.0, ROOM_M, None),
    "kinect": Sensor(525.0, 5.0, _kinect),
    "d435": Sensor(616.0, 4.0, d435_depth),
    "azure": Sensor(504.0, 5.0, azure_depth),
}
"""By the name that `--noise` takes. Kinect v1 and D435: depth registered to the colour camera (69 degrees wide on
the D435); Azure Kinect: colour registered to the narrow depth camera (504 px at its 640 columns)."""
NOISES = tuple(SENSORS)
