"""A judge of poses that looks at no depth: do features of two colour images lie on each other's epipolar lines?

Depth consistency shares its errors with the depth images: a sensor whose depth is bent favours the poses that bend the
same way, be they estimated or given. Points of interest of the colour images, matched between frames that are far
apart, know nothing of that. What they see of a pose is its rotation and the direction of its motion.
"""

from typing import Any

import cv2
import numpy as np

from dsmap.errors import InputError
from dsmap.features import Features, matched_points
from dsmap.frame import Intrinsics
from dsmap.fusion.evaluate.rolling_rows import rows_of
from dsmap.fusion.runs.read_run import evenly_spread
from dsmap.lens import undistort_points
from dsmap.sequences import Sequence
from dsmap.sequences.images import read_colour

_PAIRS = 20
"""Pairs of frames looked at for each step."""
_FEATURES = 1500
"""SIFT features of an image, at most."""
_CONTRAST = 0.02
"""Fainter ones than usual: indoor walls have few."""
_INLIER_PX = 1.5
"""Matches further from the epipolar geometry that fits most of them are wrong ones [px]."""
_MIN_MATCHES = 20
_MIN_BASELINE_M = 0.02
"""Without motion every point is on its line."""

Matches = dict[tuple[int, int], tuple[np.ndarray, np.ndarray]]
"""Pixels (N, 2) in the first and in the second frame of a pair, by the pair's frame numbers."""


def match_frames(reference: Sequence, frames: list[int], step: int) -> Matches:
    """Matched features of colour images `step` frames apart, evenly spread over the recording.

    What disagrees with every epipolar geometry is left out (MAGSAC), without a look at any pose. Pixels are those
    of a camera without distortion.
    """
    starts = max(len(frames) - step, 0)
    camera, found = reference.calibration.stored_colour, {}
    for k in evenly_spread(starts, _PAIRS):
        a, b = frames[k], frames[k + step]
        try:
            pixels = _match(read_colour(reference.entries[a].rgb), read_colour(reference.entries[b].rgb))
        except InputError:
            continue  # a damaged frame says nothing about the motion
        if pixels is not None:
            found[a, b] = tuple(_undistorted(p, camera) for p in pixels)
    return found


def epipolar_error(
    reference: Sequence, matches: Matches, poses: dict[int, np.ndarray], readout_s: float = 0.0
) -> float | None:
    """Median distance of matched features from their epipolar lines [px of the colour images], or None.

    The first-order distance of Sampson, median of a pair, then of the pairs.

    Args:
        matches: of `match_frames`.
        poses: T_world_camera by frame of the reference. They are taken for those of the colour images, as tracking
            takes them; a sensor whose colour is exposed at another time gives true poses an error.
        readout_s: time from an image's first row to its last [s].
    """
    camera, T_color_frame = reference.calibration.stored_colour, reference.calibration.T_color_frame
    medians = []
    for (a, b), pixels in matches.items():
        T_b_a = np.linalg.inv(poses[b]) @ poses[a]
        rows_a, rows_b = (rows_of(reference, poses, j, readout_s, camera.height) for j in (a, b))
        if rows_a is not None:
            T_b_a = T_b_a @ rows_a.T_middle_row(pixels[0][:, 1])
        if rows_b is not None:
            T_b_a = rows_b.T_row_middle(pixels[1][:, 1]) @ T_b_a
        T_b_a = T_color_frame @ T_b_a @ np.linalg.inv(T_color_frame)
        if np.median(np.linalg.norm(T_b_a[..., :3, 3], axis=-1)) > _MIN_BASELINE_M:
            medians.append(np.median(sampson_distance(*pixels, T_b_a, camera)))
    return float(np.median(medians)) if medians else None


def epipolar_table(
    reference: Sequence,
    poses: dict[int, np.ndarray],
    given: dict[int, np.ndarray],
    steps: tuple[int, ...],
    readout_s: float = 0.0,
) -> dict[str, Any]:
    """`epipolar_px` and `epipolar_given_px`: the error by step of estimated and of given poses."""
    tables: dict[str, dict[str, float | None]] = {"epipolar_px": {}, "epipolar_given_px": {}}
    for step in steps:
        matches = match_frames(reference, sorted(poses), step)
        for name, trajectory in zip(tables, (poses, given), strict=True):
            known = {pair: pixels for pair, pixels in matches.items() if set(pair) <= trajectory.keys()}
            tables[name][str(step)] = epipolar_error(reference, known, trajectory, readout_s)
    return tables


def sampson_distance(
    pixels_a: np.ndarray, pixels_b: np.ndarray, T_b_a: np.ndarray, camera: Intrinsics
) -> np.ndarray:
    """First-order distance [px] of pairs of pixels, (N, 2) each, from the epipolar geometry of T_b_a; shape (N,).

    T_b_a: shape (4, 4), or (N, 4, 4), each pair its own.
    """
    x, y, z = np.moveaxis(T_b_a[..., :3, 3], -1, 0)
    zero, inverse_K = np.zeros_like(x), np.linalg.inv(camera.K)
    t_hat = np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), (0, 1), (-2, -1))
    F = inverse_K.T @ t_hat @ T_b_a[..., :3, :3] @ inverse_K
    a, b = (np.column_stack([p, np.ones(len(p))]) for p in (pixels_a, pixels_b))
    lines_b, lines_a = (F @ a[..., None])[..., 0], (np.swapaxes(F, -1, -2) @ b[..., None])[..., 0]
    slope = (lines_b[:, :2] ** 2).sum(axis=1) + (lines_a[:, :2] ** 2).sum(axis=1)
    return np.abs((b * lines_b).sum(axis=1)) / np.sqrt(np.maximum(slope, 1e-30))


def _match(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    described = (
        Features(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), _FEATURES, _CONTRAST) for image in (first, second)
    )
    a, b = matched_points(*described)
    if len(a) < _MIN_MATCHES:
        return None
    cv2.setRNGSeed(0)
    try:
        F, fits = cv2.findFundamentalMat(a, b, cv2.USAC_MAGSAC, _INLIER_PX, 0.999, 5000)
    except cv2.error:  # OpenCV's own assertion, where no geometry fits at all (seen with images of two rooms)
        return None
    if F is None or fits.sum() < _MIN_MATCHES:
        return None
    return a[fits.ravel() > 0], b[fits.ravel() > 0]


def _undistorted(pixels: np.ndarray, camera: Intrinsics) -> np.ndarray:
    if camera.distortion is None:
        return pixels
    return undistort_points(pixels, camera) * (camera.fx, camera.fy) + (camera.cx, camera.cy)
