"""Pairing images by time stamp, and poses at the stamps of images."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

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
    # Of the pairs by (distance, index, index) those that are the best of both their stamps are taken at once; the rest
    # is asked again. Equal stamps are one group, paired in their order: a thousand of them cost no more than one.
    rows, columns = _Groups.of(first), _Groups.of(second)
    pairs: list[np.ndarray] = []
    while len(rows.times) and len(columns.times):
        to_column, is_near = _nearest(rows.times, columns.times, max_difference, 1)
        to_row, _ = _nearest(columns.times, rows.times, max_difference, -1)
        best = np.flatnonzero((to_row[to_column] == np.arange(len(rows.times))) & is_near)
        if not len(best):
            break
        partner = to_column[best]
        count = np.minimum(rows.count[best], columns.count[partner])
        pairs.append(np.column_stack([rows.taken(best, count), columns.taken(partner, count)]))
    found = np.concatenate(pairs) if pairs else np.empty((0, 2), np.int64)
    return [(int(i), int(j)) for i, j in found[np.argsort(found[:, 0], kind="stable")]]


@dataclass
class _Groups:
    """Equal stamps, each with those of its indices that have no partner yet."""

    times: np.ndarray
    begin: np.ndarray
    """First index without a partner."""
    count: np.ndarray

    @classmethod
    def of(cls, times: np.ndarray) -> "_Groups":
        different, begin, count = np.unique(times, return_index=True, return_counts=True)
        return cls(different, begin, count)

    def taken(self, chosen: np.ndarray, count: np.ndarray) -> np.ndarray:
        """The next `count` indices of some groups, one group after the other; groups that are used up are dropped."""
        within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        found = np.repeat(self.begin[chosen], count) + within
        self.begin[chosen] += count
        self.count[chosen] -= count
        left = self.count > 0
        self.times, self.begin, self.count = self.times[left], self.begin[left], self.count[left]
        return found


def _nearest(
    times: np.ndarray, others: np.ndarray, max_difference: float, sign: int
) -> tuple[np.ndarray, np.ndarray]:
    """Index of the other stamp that is nearest to each, the earlier one of two, and whether it is near enough.

    Args:
        sign: 1 where `times` are the first of the pairs, -1 where the others are: rounding decides at the very limit.
    """
    after = np.searchsorted(others, times)
    sides = np.clip(np.stack([after - 1, after]), 0, len(others) - 1)
    first, second = (times, others[sides]) if sign > 0 else (others[sides], times)
    is_near = (second >= first - max_difference) & (second <= first + max_difference)
    distance = np.where(is_near, np.abs(others[sides] - times), np.inf)
    later = distance[1] < distance[0]
    return np.where(later, sides[1], sides[0]), is_near[later.astype(np.int64), np.arange(len(times))]


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
    result: list[np.ndarray | None] = [None] * len(times)
    if not len(pose_times) or not len(times):
        return result
    after = np.searchsorted(pose_times, times)
    last = len(pose_times) - 1
    low, high = np.clip(after - 1, 0, last), np.clip(after, 0, last)
    nearest = np.where(np.abs(pose_times[high] - times) < np.abs(pose_times[low] - times), high, low)
    known = np.abs(pose_times[nearest] - times) <= max_difference
    step = pose_times[high] - pose_times[low]
    between = known & (after > 0) & (after <= last) & (step > 0) & (step <= _MAX_INTERPOLATION_S)
    T = np.tile(np.eye(4), (len(times), 1, 1))
    share = np.where(between, (times - pose_times[low]) / np.where(step > 0, step, 1.0), 0.0)[:, None]
    start = np.where(between, low, nearest)
    T[:, :3, :3] = Rotation.from_quat(poses[start, 3:7]).as_matrix()
    T[:, :3, 3] = poses[start, :3]
    if between.any():
        a, b = (Rotation.from_quat(poses[side[between], 3:7]) for side in (low, high))
        turn = Rotation.from_rotvec((a.inv() * b).as_rotvec() * share[between])  # slerp
        T[between, :3, :3] = (a * turn).as_matrix()
        T[between, :3, 3] = (1 - share[between]) * poses[low[between], :3] + share[between] * poses[
            high[between], :3
        ]
    for i in np.flatnonzero(known):
        result[i] = T[i]
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
