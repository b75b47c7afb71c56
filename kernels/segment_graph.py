"""Segments of a graph by Felzenszwalb and Huttenlocher (IJCV 2004): neighbours join while no seam speaks against it.

The edges are walked in order of their cost, one after the other: a union-find is sequential, so one CPU thread does
it, in about 20 ns an edge.
"""

import numpy as np
import warp as wp

import dsmap.kernels.runtime  # noqa: F401  (Warp's settings come before its first use)


@wp.func
def _root(parent: wp.array(dtype=wp.int32), i: int) -> int:
    while parent[i] != i:
        parent[i] = parent[parent[i]]  # halves the path
        i = parent[i]
    return i


@wp.kernel
def _join(
    scale: float,
    small: float,
    small_cost: float,
    edges: wp.array2d(dtype=wp.int32),
    cost: wp.array(dtype=wp.float32),
    parent: wp.array(dtype=wp.int32),
    size: wp.array(dtype=wp.float32),
    inner: wp.array(dtype=wp.float32),
):
    for e in range(edges.shape[0]):
        a = _root(parent, edges[e, 0])
        b = _root(parent, edges[e, 1])
        if a != b and cost[e] <= wp.min(inner[a] + scale / size[a], inner[b] + scale / size[b]):
            parent[b] = a
            size[a] = size[a] + size[b]
            inner[a] = cost[e]
    # What is too small to be a thing of its own joins the neighbour it is least parted from.
    for e in range(edges.shape[0]):
        a = _root(parent, edges[e, 0])
        b = _root(parent, edges[e, 1])
        if a != b and cost[e] <= small_cost and wp.min(size[a], size[b]) < small:
            parent[b] = a
            size[a] = size[a] + size[b]
    for i in range(parent.shape[0]):
        parent[i] = _root(parent, i)


def join_cells(
    edges: np.ndarray, cost: np.ndarray, size: np.ndarray, *, scale: float, small: float, small_cost: float
) -> np.ndarray:
    """The segment of every node, numbers 0, 1, ... without gaps, int32, shape (N,).

    Two segments join along an edge whose cost is at most min over both of (largest cost inside + scale / size)
    (Felzenszwalb and Huttenlocher 2004, Eq. 3-4); then segments below `small` join a neighbour along their
    cheapest edge of at most `small_cost`.

    Args:
        edges: pairs of nodes, shape (M, 2).
        cost: of each edge, >= 0, shape (M,).
        size: of each node, > 0, shape (N,).
        scale: in cost times size; larger makes larger segments.
    """
    count = len(size)
    if count == 0:
        return np.zeros(0, np.int32)
    order = np.argsort(cost, kind="stable")
    parent = wp.array(np.arange(count, dtype=np.int32), device="cpu")
    arrays = [
        wp.array(np.ascontiguousarray(edges[order], np.int32).reshape(-1, 2), dtype=wp.int32, device="cpu"),
        wp.array(np.ascontiguousarray(cost[order], np.float32), dtype=wp.float32, device="cpu"),
        parent,
        wp.array(np.array(size, np.float32), dtype=wp.float32, device="cpu"),
        wp.zeros(count, dtype=wp.float32, device="cpu"),
    ]
    wp.launch(_join, dim=1, inputs=[float(scale), float(small), float(small_cost), *arrays], device="cpu")
    _, segment = np.unique(parent.numpy(), return_inverse=True)
    return segment.astype(np.int32)
