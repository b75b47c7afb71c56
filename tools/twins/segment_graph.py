"""The slow twin of `dsmap.kernels.segment_graph`."""

import numpy as np


def join_cells(edges, cost, count: int, *, scale: float, small: float, small_cost: float) -> np.ndarray:
    """Felzenszwalb and Huttenlocher by relabelling everything at each join."""
    segment = np.arange(count)
    inner = np.zeros(count)
    order = np.argsort(cost, kind="stable")
    for e in order:
        a, b = segment[edges[e]]
        size_a, size_b = (segment == a).sum(), (segment == b).sum()
        if a != b and cost[e] <= min(inner[a] + scale / size_a, inner[b] + scale / size_b):
            segment[segment == b] = a
            inner[a] = cost[e]
    for e in order:
        a, b = segment[edges[e]]
        if a != b and cost[e] <= small_cost and min((segment == a).sum(), (segment == b).sum()) < small:
            segment[segment == b] = a
    return np.unique(segment, return_inverse=True)[1]
