"""The depth sensors that can be imitated, by name: their noise, range and camera."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dsmap.frame import Intrinsics
from dsmap.sim_scenes import sensor_noise

ROOM_M = 8.0
"""Depth range of a rendered room without a sensor's limits [m]."""
Noise = Callable[..., np.ndarray]


@dataclass(frozen=True)
class Sensor:
    """A depth camera whose depth images are registered to its colour images."""

    focal: float
    """fx = fy of the colour camera at a width of 640 [px]."""
    depth_max: float
    """Depth beyond which it is not to be trusted [m], for calibration.yaml."""
    noise: Noise | None
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
    return sensor_noise.kinect_depth(depth, camera, glass, seed=seed, frame=frame)


SENSORS = {
    "none": Sensor(525.0, ROOM_M, None),
    "kinect": Sensor(525.0, ROOM_M, _kinect),
}
"""By the name that `--noise` takes."""
NOISES = tuple(SENSORS)
