"""Where drift was made: the camera's way as a pose graph, and what the deformation graph is asked to follow."""

from collections.abc import Sequence

import numpy as np

from dsmap.fusion.loops.deformation_graph import Constraints, DeformationGraph
from dsmap.fusion.loops.pose_graph import PoseEdge, corrections, edges_along, solve_pose_graph
from dsmap.fusion.loops.record import LoopRecord

_SPACING = 10
"""A node every so many frames, or"""
_MOST_NODES = 400
"""so many nodes in all, spread evenly; the ends of loops are nodes, too."""
_STEP_M = 5e-4
"""Standard deviation of the median step [m]: tracking's covariances tell steps apart, their scale is too small."""
_LOOP = np.diag(np.repeat(1 / np.square([2e-3, 2e-3]), 3))
"""Information of a loop: 2 mm and 2 mrad."""
_UNKNOWN = np.diag(np.square([0.02] * 3 + [0.02] * 3))
"""Covariance of a step that was not tracked: lost, or found again in the map (m^2, rad^2)."""


class StepCovariances:
    """How surely each frame's step was tracked; NaN where it was not."""

    def __init__(self, values: np.ndarray | None = None) -> None:
        """`values`: of every frame so far, shape (frames, 6, 6)."""
        self._values = [] if values is None else list(np.asarray(values, np.float64))

    def remember(self, time: int, covariance: np.ndarray | None) -> None:
        """Keep the covariance (6, 6) of frame `time`, None for one that was not tracked; frames between are lost."""
        nothing = np.full((6, 6), np.nan)
        del self._values[time:]
        self._values += [nothing] * (time - len(self._values))
        self._values.append(nothing if covariance is None else np.asarray(covariance, np.float64))

    def array(self) -> np.ndarray:
        """Of every frame, shape (frames, 6, 6)."""
        return np.array(self._values).reshape(-1, 6, 6)

    def scaled(self, frames: int) -> np.ndarray:
        """Of `frames` frames, all finite, the median step `_STEP_M` uncertain, shape (frames, 6, 6)."""
        out = np.full((frames, 6, 6), np.nan)
        known = self.array()[:frames]
        out[: len(known)] = known
        size = np.trace(out[:, :3, :3], axis1=1, axis2=2) / 3
        good = np.isfinite(out).all(axis=(1, 2)) & (size > 0)
        median = float(np.median(size[good])) if good.any() else 1.0
        out[good] *= _STEP_M**2 / median
        out[~good] = _UNKNOWN
        return out + 1e-2 * _STEP_M**2 * np.eye(6)


def world_corrections(poses: np.ndarray, covariances: np.ndarray, loops: Sequence[LoopRecord]) -> np.ndarray:
    """What takes the world as mapped at each frame to where it belongs, shape (frames, 4, 4).

    Args:
        poses: T_world_camera of every frame, as bent by earlier loops, shape (frames, 4, 4).
        covariances: of each frame's step, shape (frames, 6, 6).
        loops: all of them, the new one, too.
    """
    last = len(poses) - 1
    evenly = np.arange(0, last, max(_SPACING, last // _MOST_NODES))
    ends = [frame for loop in loops for frame in (loop.frame, loop.frame_destination)]
    inside = [frame for frame in ends if 0 <= frame <= last]
    nodes = np.unique(np.concatenate([evenly, np.array([last, *inside], dtype=np.int64)]))
    row = {int(frame): k for k, frame in enumerate(nodes)}
    edges = edges_along(poses, covariances, nodes)
    edges += [
        PoseEdge(row[loop.frame_destination], row[loop.frame], loop.T_destination_frame, _LOOP)
        for loop in loops
        if loop.frame in row and loop.frame_destination in row and loop.frame != loop.frame_destination
    ]
    after = solve_pose_graph(poses[nodes], edges)
    return corrections(poses[nodes], after, nodes, len(poses))


def follow_way(graph: DeformationGraph, moved: np.ndarray, pairs: Constraints) -> Constraints:
    """Every node goes where the way of its time went, and the two surfaces of the loop meet.

    Args:
        moved: of `world_corrections`, shape (frames, 4, 4).
        pairs: of the loop.
    """
    T = moved[np.clip(graph.times, 0, len(moved) - 1)]
    goal = np.einsum("nij,nj->ni", T[:, :3, :3], graph.positions) + T[:, :3, 3]
    none, every = np.zeros(len(graph), bool), np.ones(len(pairs.pin), bool)
    along = Constraints(graph.positions, goal, graph.times, graph.times, none, none)
    meet = Constraints(pairs.source, pairs.destination, pairs.t_source, pairs.t_destination, ~every, every)
    return Constraints.joined([along, meet])
