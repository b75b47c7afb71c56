"""Lens distortion by OpenCV's models; how many coefficients there are says which one it is."""

import cv2
import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics

MODELS = {
    "radtan": ("k1", "k2", "p1", "p2", "k3"),
    "rational": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "fisheye": ("k1", "k2", "k3", "k4"),
}
"""Names of the coefficients of each model, in OpenCV's order."""
_ALIASES = {
    "plumb_bob": "radtan", "brown_conrady": "radtan", "radial_tangential": "radtan", "opencv": "radtan",
    "rational_polynomial": "rational", "full_opencv": "rational",
    "equidistant": "fisheye", "kannala_brandt": "fisheye", "kannala_brandt4": "fisheye", "kb4": "fisheye",
    "opencv_fisheye": "fisheye",
}  # fmt: skip
"""Names that other programs give them (ROS, RealSense, COLMAP, Kalibr)."""
_NONE = ("pinhole", "none", "")
LENS_NAMES = (*MODELS, *_ALIASES, "pinhole")
"""Every name that is understood."""


def model_named(name: str) -> str | None:
    """The key of `MODELS` by any of its names; None for a pinhole camera. Raises InputError: an unknown name."""
    plain = name.strip().lower().replace("-", "_").replace(" ", "_")
    if plain in _NONE:
        return None
    model = _ALIASES.get(plain, plain)
    if model not in MODELS:
        raise InputError(f"unknown distortion model {name!r}; expected one of: {', '.join(LENS_NAMES)}")
    return model


def model_of(distortion: tuple[float, ...] | None) -> str:
    """`pinhole`, or the key of `MODELS` with that many coefficients."""
    if distortion is None:
        return "pinhole"
    return next(name for name, keys in MODELS.items() if len(keys) == len(distortion))


def coefficients(
    name: str, values: "np.ndarray | tuple[float, ...] | list[float]"
) -> tuple[float, ...] | None:
    """What `Intrinsics.distortion` holds for a model's coefficients in OpenCV's order; missing ones are 0.

    Returns None where there is no distortion.

    Raises:
        InputError: an unknown name, or more coefficients than the model has.
    """
    found = [float(v) for v in np.ravel(values)]
    while found and found[-1] == 0:
        found.pop()
    model = model_named(name)
    if model is None or not found:
        return None
    if model == "radtan" and len(found) > 5:  # ROS and OpenCV write both under one name
        model = "rational"
    keys = MODELS[model]
    if len(found) > len(keys):
        raise InputError(
            f"found {len(found)} coefficients of distortion {name!r}, expected at most {len(keys)}"
        )
    return tuple(found + [0.0] * (len(keys) - len(found)))


def undistort_points(pixels: np.ndarray, camera: Intrinsics) -> np.ndarray:
    """Where pixels of a distorted camera lie in the plane z = 1 of the camera, shape (N, 2), from (N, 2)."""
    points = np.asarray(pixels, np.float64).reshape(-1, 1, 2)
    if camera.distortion is None:
        straight = (points[:, 0] - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
        return straight
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-9)
    D = np.array(camera.distortion)
    if model_of(camera.distortion) == "fisheye":
        return cv2.fisheye.undistortPoints(points, camera.K, D, criteria=criteria)[:, 0]
    return cv2.undistortPoints(points, camera.K, D, criteria=criteria)[:, 0]


def project_points(points: np.ndarray, camera: Intrinsics) -> np.ndarray:
    """Pixels (x, y), shape (N, 2), of points before the camera [m], shape (N, 3), its distortion included."""
    if camera.distortion is None:
        return points[:, :2] / points[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    D, still, points = (
        np.array(camera.distortion),
        np.zeros(3),
        np.asarray(points, np.float64).reshape(-1, 1, 3),
    )
    project = cv2.fisheye.projectPoints if model_of(camera.distortion) == "fisheye" else cv2.projectPoints
    return project(points, still, still, camera.K, D)[0].reshape(-1, 2)


def undistort_maps(camera: Intrinsics) -> tuple[np.ndarray, np.ndarray]:
    """For cv2.remap: x and y in the distorted image of every pixel of the pinhole camera of the same K, (H, W)."""
    size = (camera.width, camera.height)
    K, D = camera.K, np.array(camera.distortion, np.float64)
    if model_of(camera.distortion) == "fisheye":
        return cv2.fisheye.initUndistortRectifyMap(K, D, np.eye(3), K, size, cv2.CV_32FC1)
    return cv2.initUndistortRectifyMap(K, D, np.eye(3), K, size, cv2.CV_32FC1)
