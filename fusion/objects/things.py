"""Things: pieces of a map that are one object of one class, with boxes; and structure, which is planes with extents."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from dsmap.classes import CLASS_NAMES
from dsmap.fusion.config import SegmentConfig
from dsmap.fusion.objects.boxes import Box, fit_box, upright_axes
from dsmap.fusion.objects.pieces import join_pieces
from dsmap.fusion.objects.pooling import pool_probabilities
from dsmap.fusion.objects.segments import Cells, class_means, find_cells, segment_cells

STRUCTURE = ("wall", "floor", "ceiling", "window")
"""Classes that are planes, not things."""
_FLAT = {"ceiling", "floor"}
_PLANE_ROUNDS = 3
_OFF_PLANE = 0.06
"""Farther from its plane [m], a cell belongs to another one."""
_UPRIGHT = 0.5
"""Largest cosine to up of a wall's or window's normal."""


@dataclass(frozen=True)
class Thing:
    """An object of the map."""

    id: int
    """From 1."""
    label: int
    """Its class (see `dsmap.classes`)."""
    probabilities: np.ndarray
    """Of the 13 classes, shape (13,)."""
    box: Box
    centroid: np.ndarray
    """Mean of its surfels [m], shape (3,)."""
    surfels: np.ndarray
    """Rows of its surfels in the map, int64."""
    observations: float
    """Label observations of a surfel, on average."""
    first_seen: int
    """Frame that its first surfel was made in."""
    last_seen: int
    """Frame that a surfel of it was last measured in."""

    @property
    def name(self) -> str:
        """Class and number, for people."""
        return f"{CLASS_NAMES[self.label]} {self.id}"

    @property
    def score(self) -> float:
        """How sure its class is, 0 to 1."""
        return float(self.probabilities[self.label - 1])


@dataclass(frozen=True)
class Plane:
    """A piece of wall, floor, ceiling or window."""

    id: int
    """From 1, counted with the things."""
    label: int
    normal: np.ndarray
    """Towards the room, unit vector, shape (3,)."""
    offset: float
    """normal . x = offset on the plane [m]."""
    corners: np.ndarray
    """The rectangle that it fills, in order [m], shape (4, 3)."""
    extent: tuple[float, float]
    """Sides of the rectangle [m]: along and up a wall."""
    surfels: np.ndarray
    """Rows of its surfels in the map, int64."""

    @property
    def name(self) -> str:
        """Class and number, for people."""
        return f"{CLASS_NAMES[self.label]} {self.id}"


@dataclass(frozen=True)
class SceneObjects:
    """What a map consists of."""

    things: list[Thing]
    planes: list[Plane]
    up: np.ndarray
    """Unit vector in the world's frame, shape (3,)."""
    segment: np.ndarray
    """Geometric segment of every surfel, int32, shape (N,)."""
    cells: Cells
    owner: np.ndarray
    """Id of the thing or plane of every cell, int32, shape (C,); 0: nobody's."""


def find_objects(
    surfels: Mapping[str, np.ndarray],
    probabilities: np.ndarray,
    up: np.ndarray,
    config: SegmentConfig | None = None,
) -> SceneObjects:
    """The things and the structure of a map; none of it is changed.

    Cells that touch and have one class are one thing; their class is what their segment and they themselves say
    together (`pooling`). Surfels without a label, and rows of NaN, belong to nothing.

    Args:
        surfels: arrays by the names of SurfelMap, N rows each.
        probabilities: of the 13 classes, shape (N, 13).
        up: unit vector in the world's frame, shape (3,).
    """
    config = config or SegmentConfig()
    cells = find_cells(surfels, config.cell)
    classes = class_means(cells, probabilities, surfels["observations"])
    segment = segment_cells(cells, config, classes)
    pooled, there = pool_probabilities(probabilities, surfels["observations"], segment, config)
    of_cell = cells.sum(np.where(there[:, None], pooled, 0.0))
    labels = np.where(of_cell.sum(axis=1) > 0, of_cell.argmax(axis=1) + 1, 0)
    structure = np.isin(labels, [CLASS_NAMES.index(name) for name in STRUCTURE])
    group = join_pieces(cells, _components(cells, np.where(structure, 0, labels)), labels, up)
    owner = np.zeros(len(cells), np.int32)
    things: list[Thing] = []
    least = config.least_thing / config.cell**2
    for number in (
        np.argsort(-np.bincount(group[group >= 0]), kind="stable").tolist() if (group >= 0).any() else []
    ):
        inside = group == number
        if np.count_nonzero(inside) < least:
            break
        owner[inside] = len(things) + 1
        things.append(_thing(len(things) + 1, surfels, cells, inside, of_cell, int(labels[inside][0]), up))
    planes = _planes(cells, np.where(structure, labels, 0), up, config, owner, len(things) + 1)
    return SceneObjects(things, planes, np.asarray(up, np.float64), segment, cells, owner)


def _components(cells: Cells, labels: np.ndarray) -> np.ndarray:
    """The connected piece of one label that every cell is in, shape (C,); -1 for label 0."""
    i, j = cells.edges.T
    joined = (labels[i] == labels[j]) & (labels[i] > 0)
    graph = sparse.coo_array((np.ones(joined.sum()), (i[joined], j[joined])), (len(cells),) * 2)
    _, group = connected_components(graph, directed=False) if len(cells) else (0, np.zeros(0, np.int32))
    return np.where(labels > 0, group, -1)


def _thing(
    number: int, surfels: Mapping[str, np.ndarray], cells: Cells, inside: np.ndarray, of_cell: np.ndarray,
    label: int, up: np.ndarray,
) -> Thing:  # fmt: skip
    rows = _rows(cells, inside)
    total = of_cell[inside].sum(axis=0)
    return Thing(
        number, label, total / total.sum(), fit_box(cells.position[inside], up), cells.position[inside].mean(axis=0),
        rows, float(surfels["observations"][rows].mean()), int(surfels["t_created"][rows].min()),
        int(surfels["t_updated"][rows].max()),
    )  # fmt: skip


def _rows(cells: Cells, inside: np.ndarray) -> np.ndarray:
    return np.flatnonzero(np.append(inside, False)[cells.of_surfel])


def _planes(
    cells: Cells, labels: np.ndarray, up: np.ndarray, config: SegmentConfig, owner: np.ndarray, number: int
) -> list[Plane]:
    """The planes of every class of structure, largest first; writes their ids into `owner`."""
    planes: list[Plane] = []
    least = config.least_plane / config.cell**2
    for name in STRUCTURE:
        label = CLASS_NAMES.index(name)
        left = np.flatnonzero(labels == label)
        while len(left) >= least:
            found, normal, offset = _largest_plane(cells, left, up, name in _FLAT)
            if len(found) < least:
                break
            owner[found] = number
            corners, extent = _rectangle(cells.position[found], normal, offset, up)
            inside = np.zeros(len(cells), bool)
            inside[found] = True
            planes.append(Plane(number, label, normal, offset, corners, extent, _rows(cells, inside)))
            number += 1
            left = np.setdiff1d(left, found, assume_unique=True)
    return planes


def _largest_plane(
    cells: Cells, rows: np.ndarray, up: np.ndarray, flat: bool
) -> tuple[np.ndarray, np.ndarray, float]:
    """Cells of the plane with most of them, its normal, its offset: floors are level, walls stand upright."""
    position, normals = cells.position[rows], cells.normal[rows]
    upright = normals @ up
    if flat:
        sign = np.sign(np.median(upright)) or 1.0
        directions = [sign * np.asarray(up, np.float64)]
    else:
        axes = upright_axes(up)
        side = normals[np.abs(upright) < _UPRIGHT] @ axes[:2].T
        if len(side) == 0:
            return rows[:0], np.asarray(up), 0.0
        count, edges = np.histogram(np.arctan2(side[:, 1], side[:, 0]), 72, (-np.pi, np.pi))
        angles = (edges[:-1] + edges[1:])[
            np.argsort(-(count + np.roll(count, 1) + np.roll(count, -1)))[:4]
        ] / 2
        directions = [np.cos(a) * axes[0] + np.sin(a) * axes[1] for a in angles]
    best: tuple[np.ndarray, np.ndarray, float] = rows[:0], directions[0], 0.0
    for normal in directions:
        found, n, offset = _refined(position, normals, normal, up, flat)
        if found.sum() > len(best[0]):
            best = rows[found], n, offset
    return best


def _refined(
    position: np.ndarray, normals: np.ndarray, normal: np.ndarray, up: np.ndarray, flat: bool
) -> tuple[np.ndarray, np.ndarray, float]:
    facing = normals @ normal > 0.8
    if not facing.any():
        return facing, normal, 0.0
    along = position[facing] @ normal
    count, edges = np.histogram(along, max(int(np.ptp(along) / 0.03), 1))
    peak = int(count.argmax())
    offset = float((edges[peak] + edges[peak + 1]) / 2)
    found = facing & (np.abs(position @ normal - offset) < _OFF_PLANE)
    for _ in range(_PLANE_ROUNDS if found.sum() > 2 else 0):
        centre = position[found].mean(axis=0)
        if not flat:  # the horizontal direction in which the cells spread least
            axes = upright_axes(up)
            _, _, across = np.linalg.svd((position[found] - centre) @ axes[:2].T, full_matrices=False)
            turned = across[-1] @ axes[:2]
            normal = turned * (np.sign(turned @ normal) or 1.0)
        offset = float(centre @ normal)
        found = (normals @ normal > 0.8) & (np.abs(position @ normal - offset) < _OFF_PLANE)
        if found.sum() < 3:
            break
    return found, normal, offset


def _rectangle(
    points: np.ndarray, normal: np.ndarray, offset: float, up: np.ndarray
) -> tuple[np.ndarray, tuple[float, float]]:
    """Corners of the rectangle on the plane about the points, shape (4, 3), and its sides [m]."""
    if abs(normal @ up) > _UPRIGHT:
        box = fit_box(points, up)
        u, v = box.T_world_box[:3, 0], box.T_world_box[:3, 1]
    else:
        v = up - (up @ normal) * normal
        v /= np.linalg.norm(v)
        u = np.cross(v, normal)
    low, high = np.percentile(points @ np.stack([u, v], axis=1), [1, 99], axis=0)
    at = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    corners = at[:, :1] * u + at[:, 1:] * v + offset * normal
    return corners, (float(high[0] - low[0]), float(high[1] - low[1]))
