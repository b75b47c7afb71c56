"""Segments of a map: pieces of surface without a crease that opens towards the viewer, of one colour and class.

Things are mostly convex and meet what they stand on in concave creases, so that convexity parts them without
knowing what they are (Nakajima et al., IROS 2018, section III-B; Tateno et al., IROS 2015). What is as flat as its
wall, as a picture is, differs in colour and in what the network said. Surfels are grouped into cells, cells into
segments.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.spatial import KDTree

from dsmap.fusion.config import SegmentConfig
from dsmap.kernels.segment_graph import join_cells
from dsmap.kernels.types import SurfelMap

_NORMAL_ROUNDS = 2
"""Times that normals are averaged over neighbours: a Kinect's are off by 10 degrees at 3 m."""
_SAME_SIDE = 0.5
"""Cosine between normals from which neighbours are one surface to the average."""
_CONVEX = 0.15
"""A convex bend costs this share of a concave one."""


@dataclass(frozen=True)
class Cells:
    """Surfels of one place that face the same way, and which cells touch."""

    of_surfel: np.ndarray
    """Cell of every surfel, int32, shape (N,); -1 where it is dead."""
    position: np.ndarray
    """Mean [m], shape (C, 3)."""
    normal: np.ndarray
    """Mean over the neighbourhood, unit vectors, shape (C, 3)."""
    colour: np.ndarray
    """Mean RGB in [0, 1], shape (C, 3)."""
    edges: np.ndarray
    """Pairs of touching cells, int32, shape (M, 2)."""

    def __len__(self) -> int:
        return len(self.position)

    def sum(self, values: np.ndarray) -> np.ndarray:
        """Sum of the surfels' values, shape (N, ...), in every cell, shape (C, ...)."""
        there = self.of_surfel >= 0
        return _sum(self.of_surfel[there], values[there], len(self))


def find_cells(surfels: Mapping[str, np.ndarray], cell: float) -> Cells:
    """Group the living surfels of a map (see `SurfelMap.numpy`) by place and by the side they face.

    Args:
        cell: side of a cell [m].
    """
    alive = (surfels["weight"] > 0) & np.isfinite(surfels["position"]).all(axis=1)
    rows = np.flatnonzero(alive)
    of_surfel = np.full(len(alive), -1, np.int32)
    if len(rows) == 0:
        nothing = np.zeros((0, 3))
        return Cells(of_surfel, nothing, nothing, nothing, np.zeros((0, 2), np.int32))
    position, normal = (surfels[name][rows].astype(np.float64) for name in ("position", "normal"))
    normal = np.nan_to_num(normal)
    place = np.floor((position - position.min(axis=0)) / cell).astype(np.int64)
    size = place.max(axis=0) + 1
    axis = np.abs(normal).argmax(axis=1)
    side = 2 * axis + (normal[np.arange(len(rows)), axis] < 0)
    keys = ((place[:, 0] * size[1] + place[:, 1]) * size[2] + place[:, 2]) * 6 + side
    _, of_row = np.unique(keys, return_inverse=True)
    of_surfel[rows] = of_row
    count = int(of_row.max()) + 1
    n = np.bincount(of_row, minlength=count)[:, None]
    centre = _sum(of_row, position, count) / n
    colour = _sum(of_row, surfels["colour"][rows].astype(np.float64), count) / n
    edges = KDTree(centre).query_pairs(2.0 * cell, output_type="ndarray").astype(np.int32)
    smooth = _smooth_normals(_unit(_sum(of_row, normal, count)), edges)
    return Cells(of_surfel, centre, smooth, colour, edges)


def segment_map(
    surfels: Mapping[str, np.ndarray],
    config: SegmentConfig | None = None,
    probabilities: np.ndarray | None = None,
) -> np.ndarray:
    """The segment of every surfel, int32, shape (N,): 1, 2, ... from the largest down; 0: none (dead).

    Args:
        surfels: arrays by the names of SurfelMap, N rows each.
        probabilities: of the 13 classes, shape (N, 13); None: shape and colour alone decide.
    """
    config = config or SegmentConfig()
    cells = find_cells(surfels, config.cell)
    classes = None if probabilities is None else class_means(cells, probabilities, surfels["observations"])
    return segment_cells(cells, config, classes)


def class_means(cells: Cells, probabilities: np.ndarray, observations: np.ndarray) -> np.ndarray:
    """Class probabilities of every cell, the mean over its labelled surfels, uniform without any; shape (C, 13)."""
    own = labelled(probabilities, observations)
    total = cells.sum(np.where(own[:, None], probabilities, 0.0))
    count = total.sum(axis=1, keepdims=True)
    return np.where(count > 0, total / np.maximum(count, 1e-9), 1.0 / probabilities.shape[1])


def labelled(probabilities: np.ndarray, observations: np.ndarray) -> np.ndarray:
    """Surfels that were observed and whose row is a distribution, bool, shape (N,): NaN and zeros are none."""
    usable = np.all(np.isfinite(probabilities), axis=1)
    return usable & (np.where(usable[:, None], probabilities, 0).sum(axis=1) > 1e-6) & (observations > 0)


def set_segments(surfels: SurfelMap, segment: np.ndarray) -> None:
    """Give every surfel its segment, int32, shape (N,)."""
    if surfels.count:
        surfels.segment[: surfels.count].assign(segment)


def segment_cells(cells: Cells, config: SegmentConfig, classes: np.ndarray | None = None) -> np.ndarray:
    """As `segment_map`, of cells that are there already; classes: of `class_means`."""
    i, j = cells.edges.T
    cost = bend_cost(cells) + config.colour * np.linalg.norm(cells.colour[i] - cells.colour[j], axis=1)
    if classes is not None:  # 1 - Bhattacharyya coefficient
        cost += config.label * (1.0 - np.einsum("ij,ij->i", np.sqrt(classes[i]), np.sqrt(classes[j])))
    segment = join_cells(
        cells.edges, cost, np.ones(len(cells)), scale=config.scale, small=config.min_area / config.cell**2,
        small_cost=config.small_cost,
    )  # fmt: skip
    order = np.argsort(-np.bincount(segment), kind="stable") if len(cells) else np.zeros(0, np.int64)
    number = np.empty(len(order) + 1, np.int32)
    number[order], number[-1] = np.arange(1, len(order) + 1), 0
    of_cell = np.append(segment, len(order))
    return number[of_cell[cells.of_surfel]]


def bend_cost(cells: Cells) -> np.ndarray:
    """How much speaks for a seam along every edge: 1 - cosine of a concave bend, less of a convex one; shape (M,).

    A bend is concave where each surface sees the other: n_i . d > 0 > n_j . d for d from i to j
    (Stein et al., CVPR 2014, Eq. 1). What lies off both planes is a step, and costs as much.
    """
    i, j = cells.edges.T
    d = cells.position[j] - cells.position[i]
    d /= np.maximum(np.linalg.norm(d, axis=1, keepdims=True), 1e-9)
    cosine = np.einsum("ij,ij->i", cells.normal[i], cells.normal[j])
    up, down = (np.einsum("ij,ij->i", cells.normal[k], d) for k in (i, j))
    bend = 1.0 - cosine
    convex = up - down < 0
    step = np.minimum(np.abs(up), np.abs(down)) ** 2
    return np.where(convex & (cosine > -0.2), _CONVEX * bend, bend) + step


def _smooth_normals(normal: np.ndarray, edges: np.ndarray) -> np.ndarray:
    for _ in range(_NORMAL_ROUNDS):
        i, j = edges.T
        alike = np.einsum("ij,ij->i", normal[i], normal[j]) > _SAME_SIDE
        i, j = i[alike], j[alike]
        matrix = sparse.coo_array((np.ones(2 * len(i)), (np.r_[i, j], np.r_[j, i])), (len(normal),) * 2)
        normal = _unit(normal + matrix.tocsr() @ normal)
    return normal


def _sum(group: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    matrix = sparse.csr_array((np.ones(len(group)), group, np.arange(len(group) + 1)), (len(group), count))
    return np.asarray(matrix.T @ values)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9)
