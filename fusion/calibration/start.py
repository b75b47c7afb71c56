"""Poses and points to begin with: corners with depth, and each frame's pose from the points seen before (PnP)."""

from dataclasses import dataclass

import cv2
import numpy as np

from dsmap.fusion.calibration.bundle import Tracks, Window
from dsmap.fusion.calibration.depth_planes import look_up
from dsmap.fusion.calibration.features import Corners
from dsmap.fusion.calibration.rig import Cameras
from dsmap.lens import project_points, undistort_points

_FEWEST = 25
"""Points that a frame's pose must fit."""
_FIT = 4.0
"""A point fits a pose within this [px at 320 pixels' width]: the calibration is not right yet, and rows roll."""
_SHORTEST_TRACK = 4
"""Frames in which a corner must be seen."""
_SHORTEST = 10
"""Frames of the shortest window that is worth anything."""


@dataclass
class _Poses:
    R: list[np.ndarray]
    c: list[np.ndarray]


def start_window(
    times: np.ndarray,
    depth_after_s: np.ndarray,
    planes: np.ndarray,
    corners: Corners,
    cameras: Cameras,
    given_centres: np.ndarray | None = None,
) -> Window | None:
    """A window ready for bundle adjustment, as far as its frames could be placed; None if that is nowhere near.

    Args:
        times, depth_after_s, planes, given_centres: as in `Tracks`.
        corners: followed through the colour images of the same frames.
        cameras: as given.
    """
    straight = undistort_points(corners.pixel, cameras.colour)
    inverse, known = _depth_of_corners(planes, corners, straight, cameras)
    points = np.full((int(corners.track.max(initial=-1)) + 1, 3), np.nan)
    fits = np.zeros(len(corners.frame), bool)
    poses = _Poses([], [])
    for i in range(len(times)):
        at = np.flatnonzero(corners.frame == i)
        placed = _pose(at, straight, corners, points, poses, cameras)
        if placed is None:
            break
        (R, c), fits[at] = placed, _fitting(at, straight, corners, points, placed, cameras)
        poses.R.append(R)
        poses.c.append(c)
        new = at[np.isnan(points[corners.track[at], 0]) & known[at]]
        rays = np.column_stack([straight[new], np.ones(len(new))])
        points[corners.track[new]] = (rays / inverse[new, None]) @ R.T + c
        fits[new] = True
    count = len(poses.R)
    kept, tracks, numbers = _worth_keeping(corners, fits, count)
    if count < _SHORTEST or len(tracks) < _FEWEST:
        return None
    seen = Tracks(
        times[:count], depth_after_s[:count], planes[:count], corners.frame[kept], numbers, corners.pixel[kept],
        None if given_centres is None else given_centres[:count],
    )  # fmt: skip
    return Window(seen, np.array(poses.R), np.array(poses.c), points[tracks])


def _worth_keeping(
    corners: Corners, fits: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the first frames the observations of corners that fit often enough, their corners, and each one's number."""
    fits = fits & (corners.frame < count)
    often = (
        np.bincount(corners.track[fits], minlength=int(corners.track.max(initial=-1)) + 1) >= _SHORTEST_TRACK
    )
    kept = np.flatnonzero(fits & often[corners.track])
    return kept, *np.unique(corners.track[kept], return_inverse=True)


def _depth_of_corners(
    planes: np.ndarray, corners: Corners, straight: np.ndarray, cameras: Cameras
) -> tuple[np.ndarray, np.ndarray]:
    """Inverse depth of corners in the colour camera, (N,), and for which it is known; where a corner lies in the depth
    image depends on its depth."""
    rays = np.column_stack([straight, np.ones(len(straight))])
    inverse = np.full(len(rays), 0.5)
    R, t = cameras.R_color_depth, cameras.t_color_depth
    known = np.zeros(len(rays), bool)
    for _ in range(4):
        pixel = project_points((rays / inverse[:, None] - t) @ R, cameras.depth)
        found, known = look_up(planes, corners.frame, pixel)
        ray = np.column_stack([undistort_points(pixel, cameras.depth), np.ones(len(pixel))])
        depth = (ray / np.where(known, found[:, 0], 1.0)[:, None]) @ R.T + t
        known &= depth[:, 2] > 0
        inverse = np.where(known, 1 / np.where(known, depth[:, 2], 1.0), inverse)
    return inverse, known


def _pose(at, straight, corners: Corners, points, poses: _Poses, cameras: Cameras):
    """Rotation and centre of the next frame; None where too little is seen again."""
    if not poses.R:
        return np.eye(3), np.zeros(3)
    again = at[~np.isnan(points[corners.track[at], 0])]
    if len(again) < _FEWEST:
        return None
    R, c = poses.R[-1], poses.c[-1]
    start = cv2.Rodrigues(R.T)[0], (-R.T @ c).reshape(3, 1)
    cv2.setRNGSeed(0)
    done, turn, shift, inliers = cv2.solvePnPRansac(
        points[corners.track[again]], straight[again].reshape(-1, 1, 2), np.eye(3), None,
        start[0].copy(), start[1].copy(), True, 200, _tolerance(cameras), 0.999,
    )  # fmt: skip
    if not done or inliers is None or len(inliers) < _FEWEST:
        return None
    R = cv2.Rodrigues(turn)[0].T
    return R, -R @ shift.ravel()


def _fitting(at, straight, corners: Corners, points, pose, cameras: Cameras) -> np.ndarray:
    """Which of a frame's corners lie where their points are projected to."""
    R, c = pose
    seen = (points[corners.track[at]] - c) @ R
    ahead = seen[:, 2] > 0
    off = seen[:, :2] / np.where(ahead, seen[:, 2], 1.0)[:, None] - straight[at]
    return ahead & (np.linalg.norm(off, axis=1) < _tolerance(cameras))  # not so for NaN


def _tolerance(cameras: Cameras) -> float:
    """In the plane z = 1."""
    return _FIT * cameras.colour.width / 320 / cameras.colour.fx
