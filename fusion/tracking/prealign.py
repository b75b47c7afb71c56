"""How the camera turned between two frames, from their small images alone (SO(3) pre-alignment).

From an image 20 pixels wide, in which a turn of 6 degrees is two pixels, up to tracking's coarsest level. At
200 degrees a second and 30 frames a second the result is right to 0.9 degrees; alignment on an image 80 pixels
wide alone is off by up to 7, further than registration can mend. A turn is believed only if the images fit better
with it than without: before a bare wall, in the dark, there is nothing to align but noise.
"""

import numpy as np
import warp as wp

from dsmap.fusion.lie import exp_so3, solve
from dsmap.kernels.camera import Camera, half_camera
from dsmap.kernels.odometry import gradient, rotation_normal_equations
from dsmap.kernels.preprocess import half_image

_COARSEST = 20
"""Width of the smallest image [px]."""
_ITERATIONS = 6
_CONVERGED = 1e-3
"""A rotation step [rad] below this ends a level: a sixth of a pixel at a width of 160."""
_MIN_PIXELS = 100
_GAIN = 0.95
"""A turn has to bring the mean squared difference of the images down to this share of what it is without one."""


class RotationAligner:
    """Estimates R_prev_cur between two intensity images of one camera, coarse to fine.

    Args:
        camera: of the finest images that are used, say 80 to 160 pixels wide.
    """

    def __init__(self, camera: Camera):
        self.cameras = [camera]
        while self.cameras[-1].width // 2 >= _COARSEST:  # type: ignore[operator]  # Warp's int32 is an int here
            self.cameras.append(half_camera(self.cameras[-1]))

    def pyramid(self, intensity: wp.array) -> list[tuple[wp.array, wp.array]]:
        """(intensity, gradient) of an image at every level, finest first; the image has the camera's size."""
        images = [intensity]
        for _ in self.cameras[1:]:
            images.append(half_image(images[-1]))
        return [(image, gradient(image)) for image in images]

    def rotation(
        self, current: list[tuple[wp.array, wp.array]], last: list[tuple[wp.array, wp.array]]
    ) -> np.ndarray:
        """R_prev_cur, shape (3, 3), that best turns the current image's pyramid into the last one's.

        No turn where the images do not fit better with one.
        """
        R_prev_cur = np.eye(3)
        for camera, (intensity, _), (last_intensity, last_gradient) in zip(
            self.cameras[::-1], current[::-1], last[::-1], strict=True
        ):
            R_prev_cur = _align(camera, R_prev_cur, intensity, last_intensity, last_gradient)
        equations = rotation_normal_equations(self.cameras[0], current[0][0], *last[0])
        turned, at_rest = (
            found.squares / max(found.count, 1) for found in (equations(R_prev_cur), equations(np.eye(3)))
        )
        return R_prev_cur if turned < _GAIN * at_rest else np.eye(3)


def _align(
    camera: Camera,
    R_prev_cur: np.ndarray,
    intensity: wp.array,
    last_intensity: wp.array,
    last_gradient: wp.array,
) -> np.ndarray:
    best, best_cost = R_prev_cur, np.inf
    equations = rotation_normal_equations(camera, intensity, last_intensity, last_gradient)
    for _ in range(_ITERATIONS):
        found = equations(R_prev_cur)
        if found.count < _MIN_PIXELS or found.squares / found.count >= best_cost:
            break
        best, best_cost = R_prev_cur, found.squares / found.count
        w = solve(found.A, found.b)
        if w is None:
            break
        R_prev_cur = exp_so3(w) @ R_prev_cur
        if np.abs(w).max() < _CONVERGED:
            return R_prev_cur
    return best
