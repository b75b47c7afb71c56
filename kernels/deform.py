"""Moving every surfel by an embedded deformation graph (Sumner et al. 2007; Whelan et al. 2015, section 5.2)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from dsmap.kernels.launch import Slice, launch_items
from dsmap.kernels.types import SurfelArrays, SurfelMap

INFLUENCES = 4
"""k: nodes that move a surfel."""
_FAR = wp.constant(1.0e30)

# The k nearest nodes and one more, whose distance is d_max. Sorted, nearest first.
Distances = wp.types.vector(length=INFLUENCES + 1, dtype=wp.float32)
Indices = wp.types.vector(length=INFLUENCES + 1, dtype=wp.int32)


@dataclass
class GraphNodes:
    """A deformation graph as the kernel wants it; N nodes in time order, at least INFLUENCES + 1."""

    position: wp.array  # vec3 [m], g: where the node was sampled
    linear: wp.array  # mat33, A - I
    shift: wp.array  # vec3 [m], t
    window: wp.array  # vec2i: nodes first..end-1 are candidates for a surfel of frame first_time + row
    first_time: int  # frame number of the first row of `window`


def graph_nodes(
    position: np.ndarray,
    linear: np.ndarray,
    shift: np.ndarray,
    window: np.ndarray,
    first_time: int,
    device: Any,
) -> GraphNodes:
    """Copy a graph to a device: position, shift (N, 3) [m], linear A - I (N, 3, 3), window (frames, 2)."""
    return GraphNodes(
        wp.array(position.astype(np.float32), dtype=wp.vec3, device=device),
        wp.array(linear.astype(np.float32), dtype=wp.mat33, device=device),
        wp.array(shift.astype(np.float32), dtype=wp.vec3, device=device),
        wp.array(window.astype(np.int32), dtype=wp.vec2i, device=device),
        first_time,
    )


@wp.func
def _cofactor(F: wp.mat33) -> wp.mat33:
    """det(F) F^-T: takes normals where F takes tangents, and needs no division."""
    a = wp.vec3(F[0, 0], F[0, 1], F[0, 2])
    b = wp.vec3(F[1, 0], F[1, 1], F[1, 2])
    c = wp.vec3(F[2, 0], F[2, 1], F[2, 2])
    return wp.matrix_from_rows(wp.cross(b, c), wp.cross(c, a), wp.cross(a, b))


@wp.kernel
def _deform(
    s: Slice,
    node: wp.array(dtype=wp.vec3),
    linear: wp.array(dtype=wp.mat33),
    shift: wp.array(dtype=wp.vec3),
    window: wp.array(dtype=wp.vec2i),
    first_time: wp.int32,
    m: SurfelArrays,
):
    block = s.first + s.stride * wp.tid()
    for i in range(block * s.step, wp.min((block + 1) * s.step, s.count)):
        if m.weight[i] <= 0.0:
            continue
        p = m.position[i]
        span = window[wp.clamp(m.t_created[i] - first_time, 0, window.shape[0] - 1)]
        distance = Distances(_FAR)
        nearest = Indices(0)
        for j in range(span[0], span[1]):
            d = wp.length_sq(node[j] - p)
            if d < distance[INFLUENCES]:  # insertion into the sorted list; the earlier node wins a tie
                at = int(INFLUENCES)
                while at > 0 and d < distance[at - 1]:
                    distance[at] = distance[at - 1]
                    nearest[at] = nearest[at - 1]
                    at -= 1
                distance[at] = d
                nearest[at] = j
        # w_n(p) = (1 - |p - g_n| / d_max)^2, normalised; d_max: distance of the (k + 1)-th nearest node
        d_max = wp.sqrt(distance[INFLUENCES])
        total = float(0.0)
        for k in range(INFLUENCES):
            w = 1.0 - wp.sqrt(distance[k]) / wp.max(d_max, 1.0e-12)
            distance[k] = w * w
            total += w * w
        # In displacements from the identity, so that a graph at rest moves nothing by a single bit:
        # phi(p) - p = sum_n w_n (A_n (p - g_n) + g_n + t_n) - p = sum_n w_n ((A_n - I)(p - g_n) + t_n)
        moved = wp.vec3(0.0, 0.0, 0.0)
        bend = wp.mat33(0.0)
        for k in range(INFLUENCES):
            w = float(1.0) / float(INFLUENCES)  # all nodes as far as each other: none counts more
            if total > 1.0e-12:
                w = distance[k] / total
            n = nearest[k]
            moved += w * (linear[n] * (p - node[n]) + shift[n])
            bend += w * linear[n]
        m.position[i] = p + moved
        if wp.ddot(bend, bend) > 0.0:
            F = wp.identity(n=3, dtype=wp.float32) + bend
            m.normal[i] = wp.normalize(_cofactor(F) * m.normal[i])


def deform_surfels(surfels: SurfelMap, graph: GraphNodes) -> None:
    """Move positions and turn normals of all living surfels, in place.

    A surfel follows the INFLUENCES nodes nearest in space among the candidates for its t_created. A graph at
    rest (A = I, t = 0) changes nothing, bit for bit.
    """
    m = surfels
    inputs = [graph.position, graph.linear, graph.shift, graph.window, graph.first_time, m.arrays]
    launch_items(_deform, m.count, inputs, [], m.device)
