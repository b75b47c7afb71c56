"""Slow, readable NumPy twins of the deformation graph: one point at a time, dense residuals."""

import numpy as np

K = 4


def candidates(node_times, t: int, window: int) -> list[int]:
    """Nodes that may move a point of frame t: those nearest in time, and window / 2 to either side."""
    count = len(node_times)
    t = min(max(t, node_times[0]), node_times[-1])
    gaps = [abs(int(time) - t) for time in node_times]
    nearest_time = min(time for time, gap in zip(node_times, gaps, strict=True) if gap == min(gaps))
    same = [i for i in range(count) if node_times[i] == nearest_time]
    first, end = same[0] - window // 2, same[-1] + 1 + window // 2
    least = min(window + 1, count)
    first = min(max(first, 0), count - least)
    return list(range(first, max(min(end, count), first + least)))


def influences(positions, node_times, window, p, t) -> list[tuple[int, float]]:
    """(node, weight) of a point: w = (1 - |p - g| / d_max)^2 over the k nearest, normalised."""
    order = sorted(candidates(node_times, t, window), key=lambda n: (np.linalg.norm(p - positions[n]), n))
    d_max = max(np.linalg.norm(p - positions[order[K]]), 1e-12)
    raw = [(1 - float(np.linalg.norm(p - positions[n])) / float(d_max)) ** 2 for n in order[:K]]
    if sum(raw) <= 1e-12:
        return [(n, 1 / K) for n in order[:K]]
    return [(n, w / sum(raw)) for n, w in zip(order, raw, strict=False)]


def affine(deformation) -> tuple[np.ndarray, np.ndarray]:
    """A (N, 3, 3) and t (N, 3) of the stored rows: columns of A - I, then t."""
    return deformation[:, :3].transpose(0, 2, 1) + np.eye(3), deformation[:, 3]


def move(positions, node_times, window, deformation, p, t):
    """phi(p) = sum_n w_n (A_n (p - g_n) + g_n + t_n), and the matrix F = sum_n w_n A_n."""
    A, shift = affine(deformation)
    moved, F = np.zeros(3), np.zeros((3, 3))
    for n, w in influences(positions, node_times, window, p, t):
        moved += w * (A[n] @ (p - positions[n]) + positions[n] + shift[n])
        F += w * A[n]
    return moved, F


def deform(graph, s) -> dict[str, np.ndarray]:
    """Positions and normals of all surfels after the graph has moved them."""
    position, normal = s["position"].copy(), s["normal"].copy()
    for i in range(len(position)):
        if s["weight"][i] <= 0:
            continue
        position[i], F = move(
            graph.positions,
            graph.times,
            graph.config.window,
            graph.deformation,
            position[i],
            s["t_created"][i],
        )
        n = np.linalg.inv(F).T @ normal[i]
        normal[i] = n / np.linalg.norm(n)
    return {"position": position, "normal": normal}


def energy_residuals(graph, constraints, deformation) -> np.ndarray:
    """All residuals times the square roots of their weights; E is their sum of squares."""
    config, g = graph.config, graph.positions
    A, shift = affine(deformation)
    rot, reg, con = [], [], []
    for a in A:
        c = a.T  # columns
        rot += [c[0] @ c[1], c[0] @ c[2], c[1] @ c[2], c[0] @ c[0] - 1, c[1] @ c[1] - 1, c[2] @ c[2] - 1]
    for n in range(len(g)):
        first = min(max(n - K // 2, 0), len(g) - K - 1)
        for m in range(first, first + K + 1):
            if m != n:
                reg += list(A[n] @ (g[m] - g[n]) + g[n] + shift[n] - (g[m] + shift[m]))
    relative = (
        constraints.relative if constraints.relative is not None else np.zeros(len(constraints.pin), bool)
    )
    for q_s, q_d, t_s, t_d, pin, meet in zip(
        constraints.source, constraints.destination, constraints.t_source, constraints.t_destination,
        constraints.pin, relative, strict=True,
    ):  # fmt: skip
        source = move(g, graph.times, config.window, deformation, q_s, t_s)[0]
        destination = move(g, graph.times, config.window, deformation, q_d, t_d)[0]
        con += list(source - (destination if meet else q_d))
        if pin:
            con += list(destination - q_d)
    return np.concatenate(
        [
            np.sqrt(config.w_rot) * np.array(rot),
            np.sqrt(config.w_reg) * np.array(reg),
            np.sqrt(config.w_con) * np.array(con),
        ]
    )
