"""A fully connected CRF over points in space: mean field with two Gaussian kernels (Kraehenbuehl and Koltun 2011).

The kernels of a map reach 5 cm (McCormac et al., ICRA 2017, section III-D), next to nothing of its size. So the few
hundred neighbours of every point are listed once, with the exact weights of both kernels in one number, and a mean
field step is a sum over that list. A permutohedral lattice, made for kernels that reach across the image, would
approximate the sum.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

from dsmap.kernels.label import vec13
from dsmap.kernels.launch import Slice, launch_items
from dsmap.kernels.runtime import struct


@struct
class Kernels:
    """Two Gaussian kernels: of position and colour, of position and normal."""

    reach: float  # [m]: farther points are no neighbours
    position: float  # 1 / (2 sigma^2), [1/m^2]
    colour: float  # 1 / (2 sigma^2), RGB in [0, 1]
    normal: float  # 1 / (2 sigma^2), [1/rad^2], of the difference of unit vectors
    weight_colour: float
    weight_normal: float
    least: float  # neighbours whose kernels are both smaller are left out


@dataclass(frozen=True)
class Neighbours:
    """For every point those that its label depends on: a sparse matrix by rows."""

    first: wp.array  # int32, (N + 1,): where the row of each point begins
    index: wp.array  # int32
    weight: wp.array  # float32: both kernels, normalised, times their weights


@wp.func
def _kernels(
    k: Kernels, i: int, j: int,
    position: wp.array(dtype=wp.vec3), colour: wp.array(dtype=wp.vec3), normal: wp.array(dtype=wp.vec3),
) -> wp.vec2:  # fmt: skip
    d = position[i] - position[j]
    far = wp.dot(d, d)
    if far > k.reach * k.reach:
        return wp.vec2(0.0, 0.0)
    c = colour[i] - colour[j]
    n = normal[i] - normal[j]
    near = -k.position * far
    return wp.vec2(wp.exp(near - k.colour * wp.dot(c, c)), wp.exp(near - k.normal * wp.dot(n, n)))


@wp.kernel
def _measure(
    s: Slice, grid: wp.uint64, k: Kernels,
    position: wp.array(dtype=wp.vec3), colour: wp.array(dtype=wp.vec3), normal: wp.array(dtype=wp.vec3),
    mass: wp.array(dtype=wp.float32),
    count: wp.array(dtype=wp.int32), total: wp.array(dtype=wp.vec2),
):  # fmt: skip
    block = s.first + s.stride * wp.tid()
    for i in range(block * s.step, wp.min((block + 1) * s.step, s.count)):
        n = int(0)
        sums = wp.vec2(0.0, 0.0)
        for j in wp.hash_grid_query(grid, position[i], k.reach):
            e = _kernels(k, i, j, position, colour, normal)
            if wp.max(e[0], e[1]) >= k.least:
                n += 1
                sums += mass[j] * e
        count[i] = n
        total[i] = sums


@wp.kernel
def _list(
    s: Slice, grid: wp.uint64, k: Kernels,
    position: wp.array(dtype=wp.vec3), colour: wp.array(dtype=wp.vec3), normal: wp.array(dtype=wp.vec3),
    mass: wp.array(dtype=wp.float32), total: wp.array(dtype=wp.vec2), first: wp.array(dtype=wp.int32),
    index: wp.array(dtype=wp.int32), weight: wp.array(dtype=wp.float32),
):  # fmt: skip
    block = s.first + s.stride * wp.tid()
    for i in range(block * s.step, wp.min((block + 1) * s.step, s.count)):
        at = first[i]
        for j in wp.hash_grid_query(grid, position[i], k.reach):
            e = _kernels(k, i, j, position, colour, normal)
            if wp.max(e[0], e[1]) >= k.least:
                a = k.weight_colour * e[0] / wp.sqrt(total[i][0] * total[j][0])
                b = k.weight_normal * e[1] / wp.sqrt(total[i][1] * total[j][1])
                index[at] = j
                weight[at] = (a + b) * mass[j]
                at += 1


@wp.kernel
def _messages(
    s: Slice, first: wp.array(dtype=wp.int32), index: wp.array(dtype=wp.int32), weight: wp.array(dtype=wp.float32),
    q: wp.array(dtype=vec13), message: wp.array(dtype=vec13),
):  # fmt: skip
    block = s.first + s.stride * wp.tid()
    for i in range(block * s.step, wp.min((block + 1) * s.step, s.count)):
        m = vec13()
        for at in range(first[i], first[i + 1]):
            m += weight[at] * q[index[at]]
        message[i] = m


@wp.kernel
def _soften(
    s: Slice, log_p: wp.array(dtype=vec13), message: wp.array(dtype=vec13), q: wp.array(dtype=vec13)
):  # fmt: skip
    block = s.first + s.stride * wp.tid()
    for i in range(block * s.step, wp.min((block + 1) * s.step, s.count)):
        e = log_p[i] + message[i]
        top = wp.max(e)
        total = float(0.0)
        for k in range(13):
            e[k] = wp.exp(e[k] - top)
            total += e[k]
        q[i] = e / total


def find_neighbours(
    kernels: Kernels,
    position: np.ndarray,
    colour: np.ndarray,
    normal: np.ndarray,
    mass: np.ndarray,
    device: object,
) -> Neighbours:
    """Neighbours of every point, itself included, with w_1 k_1 + w_2 k_2, each kernel symmetrically normalised.

    Normalised, a point's weights sum to about w_1 + w_2, however densely its surroundings were sampled.

    Args:
        position [m], colour (RGB in [0, 1]), normal (unit vectors): shapes (N, 3), N >= 1.
        mass: how many surfels each point stands for, shape (N,).
    """
    n = len(position)
    vectors = [
        wp.array(np.ascontiguousarray(a, np.float32), dtype=wp.vec3, device=device)
        for a in (position, colour, normal)
    ]
    of_point = wp.array(np.ascontiguousarray(mass, np.float32), dtype=wp.float32, device=device)
    grid = wp.HashGrid(128, 128, 128, device=device)
    grid.build(vectors[0], kernels.reach)
    count = wp.empty(n, dtype=wp.int32, device=device)
    total = wp.empty(n, dtype=wp.vec2, device=device)
    launch_items(_measure, n, [grid.id, kernels, *vectors, of_point], [count, total], device)
    ends = np.concatenate([[0], np.cumsum(count.numpy(), dtype=np.int64)])
    first = wp.array(ends.astype(np.int32), device=device)
    index = wp.empty(int(ends[-1]), dtype=wp.int32, device=device)
    weight = wp.empty(int(ends[-1]), dtype=wp.float32, device=device)
    launch_items(_list, n, [grid.id, kernels, *vectors, of_point, total, first], [index, weight], device)
    return Neighbours(first, index, weight)


def mean_field(neighbours: Neighbours, log_p: np.ndarray, iterations: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean field with a Potts model (Kraehenbuehl and Koltun 2011, Algorithm 1, every point at once).

    Args:
        log_p: log of the unary probabilities, shape (N, 13).

    Returns:
        The probabilities Q and the last message to each point, float32, shapes (N, 13): Q is the softmax of
        log_p + message.
    """
    device, n = neighbours.first.device, len(log_p)
    unary = wp.array(np.ascontiguousarray(log_p, np.float32), dtype=vec13, device=device)
    message, q = wp.zeros(n, dtype=vec13, device=device), wp.empty(n, dtype=vec13, device=device)
    launch_items(_soften, n, [unary, message], [q], device)
    for _ in range(iterations):
        launch_items(
            _messages, n, [neighbours.first, neighbours.index, neighbours.weight, q], [message], device
        )
        launch_items(_soften, n, [unary, message], [q], device)
    return q.numpy(), message.numpy()
