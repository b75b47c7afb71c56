"""A pose graph: keyframes on the camera's way, moved so that loops close where tracking was least sure.

Nodes are poses T_world_camera, edges relative poses with the inverse of their covariance. Gauss-Newton on SE(3):
a pose takes a step on its right side, T exp(xi^), and an edge's residual is log(Z^-1 T_i^-1 T_j). The first node
holds still.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from dsmap.fusion.lie import adjoint, exp_se3, inverse, log_se3

_CONVERGED = 1e-9
"""A cost that falls by less than this share has arrived."""


@dataclass(frozen=True)
class PoseEdge:
    """What is known of two nodes."""

    source: int
    target: int
    T_source_target: np.ndarray
    """Takes points of the target's camera into the source's, shape (4, 4)."""
    information: np.ndarray
    """Inverse covariance of xi in T_source_target exp(xi^), (translation, rotation), shape (6, 6)."""


def solve_pose_graph(poses: np.ndarray, edges: list[PoseEdge], iterations: int = 20) -> np.ndarray:
    """The poses that fit all edges best, shape (K, 4, 4); a step that raises the cost ends the search.

    Args:
        poses: T_world_camera of the nodes to begin with, shape (K, 4, 4), every one joined to the first by edges.
    """
    now = np.array(poses, dtype=np.float64)
    cost = graph_cost(now, edges)
    for _ in range(iterations if len(now) > 1 else 0):
        A, b = _normal_equations(now, edges)
        step = splu(A).solve(-b).reshape(-1, 6)
        tried = now.copy()
        for k, xi in enumerate(step, start=1):
            tried[k] = now[k] @ exp_se3(xi)
        new = graph_cost(tried, edges)
        if not new < cost:
            break
        arrived = cost - new <= _CONVERGED * cost
        now, cost = tried, new
        if arrived:
            break
    return now


def graph_cost(poses: np.ndarray, edges: list[PoseEdge]) -> float:
    """Sum of r^T information r over the edges, residuals r of poses (K, 4, 4)."""
    residuals = [(_residual(poses, edge), edge.information) for edge in edges]
    return float(sum(r @ information @ r for r, information in residuals))


def _residual(poses: np.ndarray, edge: PoseEdge) -> np.ndarray:
    T = inverse(poses[edge.source]) @ poses[edge.target]
    return log_se3(inverse(edge.T_source_target) @ T)


def _normal_equations(poses: np.ndarray, edges: list[PoseEdge]) -> tuple[sp.csc_matrix, np.ndarray]:
    """J^T W J and J^T W r of the free poses. Near the minimum residuals are small: log's own Jacobian is left out."""
    size = 6 * (len(poses) - 1)
    b = np.zeros(size)
    rows, columns, values = [], [], []
    own = np.arange(6)
    for edge in edges:
        r, W = _residual(poses, edge), edge.information
        J_source = -adjoint(inverse(poses[edge.target]) @ poses[edge.source])
        ends = [(edge.source - 1, J_source), (edge.target - 1, np.eye(6))]
        free = [(node, J) for node, J in ends if node >= 0]
        for node, J in free:
            b[6 * node : 6 * node + 6] += J.T @ W @ r
            for other, J_other in free:
                block = J.T @ W @ J_other
                rows.append(np.repeat(6 * node + own, 6))
                columns.append(np.tile(6 * other + own, 6))
                values.append(block.ravel())
    where = (np.concatenate(rows), np.concatenate(columns))
    return sp.csc_matrix((np.concatenate(values), where), shape=(size, size)), b


def edges_along(poses: np.ndarray, covariances: np.ndarray, nodes: np.ndarray) -> list[PoseEdge]:
    """The edges between neighbouring nodes of a way as it was tracked.

    Args:
        poses: T_world_camera of every frame, shape (frames, 4, 4).
        covariances: of each frame's step, of xi in T exp(xi^), shape (frames, 6, 6).
        nodes: frame numbers of the nodes, ascending, shape (K,).
    """
    edges = []
    for k in range(len(nodes) - 1):
        start, end = int(nodes[k]), int(nodes[k + 1])
        total, T_end_world = np.zeros((6, 6)), inverse(poses[end])
        for frame in range(start + 1, end + 1):
            carry = adjoint(T_end_world @ poses[frame])
            total += carry @ (covariances[frame]) @ carry.T
        edges.append(PoseEdge(k, k + 1, inverse(poses[start]) @ poses[end], np.linalg.inv(total)))
    return edges


def corrections(before: np.ndarray, after: np.ndarray, nodes: np.ndarray, frames: int) -> np.ndarray:
    """What takes the world as it was at each frame to where it belongs, shape (frames, 4, 4).

    Between two nodes the correction goes from one to the other evenly, as seen from the camera: about the world's
    origin, a turn far away would be a long shift.

    Args:
        before, after: T_world_camera of the nodes, shape (K, 4, 4).
        nodes: their frame numbers, ascending, shape (K,), K >= 2.
        frames: how many.
    """
    moved = np.array([a @ inverse(b) for a, b in zip(after, before, strict=True)])
    out = np.empty((frames, 4, 4))
    for frame in range(frames):
        i = int(np.clip(np.searchsorted(nodes, frame, side="right") - 1, 0, len(nodes) - 2))
        share = float(np.clip((frame - nodes[i]) / (nodes[i + 1] - nodes[i]), 0.0, 1.0))
        T_world_here = np.eye(4)
        T_world_here[:3, 3] = (1 - share) * before[i][:3, 3] + share * before[i + 1][:3, 3]
        T_here_world = inverse(T_world_here)
        start, end = (T_here_world @ moved[k] @ T_world_here for k in (i, i + 1))
        out[frame] = T_world_here @ start @ exp_se3(share * log_se3(inverse(start) @ end)) @ T_here_world
    return out
