"""Pairing images by time stamp, and poses at the stamps of images."""

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

MAX_DIFFERENCE_S = 0.02
"""Colour, depth, labels and poses belong together when their stamps are at most this far apart [s]."""
_MAX_INTERPOLATION_S = 0.1
"""Poses further apart than this are not interpolated between [s]; the nearer one is taken."""
_GAP_FACTOR = 3.0


def associate(
    first: np.ndarray, second: np.ndarray, max_difference: float = MAX_DIFFERENCE_S
) -> list[tuple[int, int]]:
    """One-to-one pairs of stamps, nearest first, at most `max_difference` apart.

    Args:
        first, second: stamps [s], sorted, shapes (N,) and (M,).

    Returns:
        pairs of indices, in the order of `first`.
    """
    low = np.searchsorted(second, first - max_difference, side="left")
    high = np.searchsorted(second, first + max_difference, side="right")
    candidates = [
        (abs(first[i] - second[j]), i, j) for i in range(len(first)) for j in range(low[i], high[i])
    ]
    used_first: set[int] = set()
    used_second: set[int] = set()
    pairs = []
    for _, i, j in sorted(candidates):
        if i not in used_first and j not in used_second:
            used_first.add(i)
            used_second.add(j)
            pairs.append((i, int(j)))
    return sorted(pairs)


def poses_at(
    times: np.ndarray, pose_times: np.ndarray, poses: np.ndarray, max_difference: float = MAX_DIFFERENCE_S
) -> list[np.ndarray | None]:
    """Poses at given stamps: interpolated between neighbours (slerp), None where no stamp is near.

    Args:
        times: stamps that ask for a pose [s], shape (N,).
        pose_times: sorted stamps of the poses [s], shape (M,).
        poses: x y z qx qy qz qw, shape (M, 7), camera to world.

    Returns:
        N poses, each float64 of shape (4, 4), or None.
    """
    result: list[np.ndarray | None] = []
    for t in times:
        after = int(np.searchsorted(pose_times, t))
        around = [i for i in (after - 1, after) if 0 <= i < len(pose_times)]
        nearest = min(around, key=lambda i: abs(pose_times[i] - t), default=None)
        if nearest is None or abs(pose_times[nearest] - t) > max_difference:
            result.append(None)
        elif len(around) == 2 and 0 < pose_times[after] - pose_times[after - 1] <= _MAX_INTERPOLATION_S:
            result.append(_interpolate(t, pose_times[around], poses[around]))
        else:
            result.append(pose_matrix(poses[nearest]))
    return result


def pose_matrix(pose: np.ndarray) -> np.ndarray:
    """x y z qx qy qz qw, shape (7,), as a (4, 4) matrix."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(pose[3:7]).as_matrix()
    T[:3, 3] = pose[:3]
    return T


def pose_vector(T: np.ndarray) -> np.ndarray:
    """A (4, 4) pose as x y z qx qy qz qw, shape (7,)."""
    return np.concatenate([T[:3, 3], Rotation.from_matrix(T[:3, :3]).as_quat()])


def gaps(times: np.ndarray) -> list[tuple[float, float]]:
    """Intervals longer than three times the median one, as (stamp before the gap, length) [s]."""
    if len(times) < 3:
        return []
    steps = np.diff(times)
    return [
        (float(times[i]), float(steps[i])) for i in np.flatnonzero(steps > _GAP_FACTOR * np.median(steps))
    ]


def _interpolate(t: float, times: np.ndarray, poses: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Slerp(times, Rotation.from_quat(poses[:, 3:7]))(t).as_matrix()
    share = (t - times[0]) / (times[1] - times[0])
    T[:3, 3] = (1 - share) * poses[0, :3] + share * poses[1, :3]
    return T
