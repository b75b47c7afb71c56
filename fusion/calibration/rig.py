"""What is calibrated: corrections to a given calibration as one vector, and the cameras that a vector stands for."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from dsmap.frame import Intrinsics
from dsmap.lens import MODELS, model_of
from dsmap.sequences.calibration import Calibration

LENS = ("focal", "cx", "cy", "k1")
"""Corrections of the colour camera: ln of the factor on fx and fy; principal point [px]; first radial coefficient."""
TIMES = ("readout_s", "depth_time_offset_s")
PLACE = ("x", "y", "z", "turn_x", "turn_y", "turn_z")
"""Of the depth camera before the colour camera: translation [m], then rotation vector [rad]."""
_PRIOR = {
    "focal": 0.1, "k1": 0.1, "readout_s": 0.03, "depth_time_offset_s": 0.03, "depth_focal": 0.1,
    **dict.fromkeys(PLACE[:3], 0.05), **dict.fromkeys(PLACE[3:], 0.05),
}  # fmt: skip
"""Standard deviation of what is to be corrected, before any image is seen. Numbers that a recording says nothing
about stay near the given ones instead of running away."""
_PRIOR_CENTRE = 0.01
"""The same of the principal point [image widths]."""


@dataclass(frozen=True)
class Cameras:
    """The cameras of one parameter vector."""

    colour: Intrinsics
    depth: Intrinsics
    R_color_depth: np.ndarray
    t_color_depth: np.ndarray
    readout_s: float
    offset_s: float
    """The correction of the depth stamps: given plus this is the offset."""

    @property
    def T_color_depth(self) -> np.ndarray:
        """Takes points of the depth camera into the colour camera, shape (4, 4)."""
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = self.R_color_depth, self.t_color_depth
        return T


@dataclass(frozen=True)
class Rig:
    """A given calibration, and which corrections are sought."""

    given: Calibration
    places: bool
    """Whether the place of the depth camera is sought; if not, it is as given."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters, in the vector's order."""
        own = ("depth_focal",) if self.given.color_camera is not None else ()
        return (*LENS, *own, *TIMES, *(PLACE if self.places else ()))

    @property
    def prior_sigma(self) -> np.ndarray:
        """Standard deviations of the parameters before any image is seen; their mean is zero. Shape (S,)."""
        width = self.given.stored_colour.width
        return np.array([_PRIOR.get(name, _PRIOR_CENTRE * width) for name in self.names])

    @property
    def steps(self) -> np.ndarray:
        """Small changes for numerical derivatives, shape (S,)."""
        return 1e-4 * self.prior_sigma

    def cameras(self, vector: np.ndarray) -> Cameras:
        """The cameras with corrections, shape (S,)."""
        value = dict(zip(self.names, map(float, vector), strict=True))
        given = self.given
        colour = corrected(given.stored_colour, value["focal"], value["cx"], value["cy"], value["k1"])
        if given.color_camera is None:
            depth = colour  # one camera's pixels, or the same numbers are stated for both
        else:
            depth = corrected(given.intrinsics, value["depth_focal"], 0.0, 0.0, 0.0)
        T = np.eye(4) if given.T_color_depth is None else given.T_color_depth
        turn = Rotation.from_rotvec([value.get(name, 0.0) for name in PLACE[3:]]).as_matrix()
        return Cameras(
            colour,
            depth,
            T[:3, :3] @ turn,
            T[:3, 3] + [value.get(name, 0.0) for name in PLACE[:3]],
            given.readout_s + value["readout_s"],
            value["depth_time_offset_s"],
        )


def corrected(camera: Intrinsics, focal: float, cx: float, cy: float, k1: float) -> Intrinsics:
    """A camera with other focal lengths (ln of the factor), principal point [px] and first radial coefficient."""
    distortion = camera.distortion
    if k1 and distortion is None:
        distortion = (0.0,) * len(MODELS["radtan"])
    if k1 and distortion is not None:
        distortion = (distortion[MODELS[model_of(distortion)].index("k1")] + k1, *distortion[1:])
    factor = float(np.exp(focal))
    return replace(
        camera, fx=camera.fx * factor, fy=camera.fy * factor, cx=camera.cx + cx, cy=camera.cy + cy,
        distortion=distortion,
    )  # fmt: skip
