"""Boxes that stand upright: the smallest one about some points, turned about the vertical, and how far two overlap."""

from dataclasses import dataclass

import cv2
import numpy as np

_TRIM = 1.0
"""Percent of the points that may lie outside on each side: stray surfels must not make a thing large."""
_THINNEST = 0.02
"""[m]"""


@dataclass(frozen=True)
class Box:
    """A box with one edge along up."""

    T_world_box: np.ndarray
    """Its frame: origin in its middle, z up, x along its longer horizontal side; shape (4, 4)."""
    extent: np.ndarray
    """Sides along x, y, z of its frame [m], shape (3,)."""

    @property
    def volume(self) -> float:
        """[m^3]"""
        return float(self.extent.prod())

    def corners(self) -> np.ndarray:
        """[m], world frame, shape (8, 3); bit k of a corner's number is the side along axis k."""
        unit = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)]) - 0.5
        return unit * self.extent @ self.T_world_box[:3, :3].T + self.T_world_box[:3, 3]

    def at_least(self, side: float) -> "Box":
        """The same box with no side shorter than this [m]."""
        return Box(self.T_world_box, np.maximum(self.extent, side))


EDGES = [(a, a | 1 << k) for a in range(8) for k in range(3) if not a >> k & 1]
"""The twelve edges of a box, as pairs of its corners."""


def upright_axes(up: np.ndarray) -> np.ndarray:
    """Rotation from the world to axes with z up, shape (3, 3); rows are the axes."""
    up = np.asarray(up, np.float64) / np.linalg.norm(up)
    x = np.cross(np.eye(3)[np.argmin(np.abs(up))], up)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(up, x), up])


def fit_box(points: np.ndarray, up: np.ndarray, trim: float = _TRIM) -> Box:
    """The upright box of least ground area about the points, the outermost `trim` percent left out on each side.

    Args:
        points: [m], shape (N, 3), N >= 1.
        up: unit vector, shape (3,).
    """
    axes = upright_axes(up)
    level = points @ axes.T
    _, _, angle = cv2.minAreaRect(np.ascontiguousarray(_core(level[:, :2], trim), np.float32))
    turn = _about_z(np.radians(angle))
    local = level @ turn
    low, high = np.percentile(local, [trim, 100 - trim], axis=0)
    if high[0] - low[0] < high[1] - low[1]:  # x is the longer one
        turn = turn @ _about_z(np.pi / 2)
        local = level @ turn
        low, high = np.percentile(local, [trim, 100 - trim], axis=0)
    T = np.eye(4)
    T[:3, :3] = axes.T @ turn
    T[:3, 3] = T[:3, :3] @ (low + high) / 2
    return Box(T, np.maximum(high - low, _THINNEST))


def box_overlap(a: Box, b: Box) -> float:
    """Intersection over union of the volumes of two boxes with the same up, 0 to 1."""
    if (
        np.linalg.norm(a.T_world_box[:3, 3] - b.T_world_box[:3, 3])
        > (np.linalg.norm(a.extent) + np.linalg.norm(b.extent)) / 2
    ):
        return 0.0
    axes = a.T_world_box[:3, :3].T
    first, second = (_rectangle(axes, box) for box in (a, b))
    kind, region = cv2.rotatedRectangleIntersection(first[0], second[0])
    if kind == cv2.INTERSECT_NONE or region is None:
        return 0.0
    area = cv2.contourArea(cv2.convexHull(region))
    height = min(first[2], second[2]) - max(first[1], second[1])
    common = area * max(height, 0.0)
    return float(common / max(a.volume + b.volume - common, 1e-12))


def _rectangle(axes: np.ndarray, box: Box) -> tuple[tuple, float, float]:
    """The box's ground rectangle in level axes, as OpenCV has them, its lowest and its highest point."""
    centre, x = axes @ box.T_world_box[:3, 3], axes @ box.T_world_box[:3, 0]
    angle = float(np.degrees(np.arctan2(x[1], x[0])))
    half = box.extent[2] / 2
    sides = (float(box.extent[0]), float(box.extent[1]))
    return ((float(centre[0]), float(centre[1])), sides, angle), centre[2] - half, centre[2] + half


def _core(points: np.ndarray, trim: float) -> np.ndarray:
    """Points that lie inside the given percentiles in each of eight directions."""
    angles = np.arange(8) * np.pi / 8
    along = points @ np.stack([np.cos(angles), np.sin(angles)])
    low, high = np.percentile(along, [trim, 100 - trim], axis=0)
    kept = ((along >= low - 1e-9) & (along <= high + 1e-9)).all(axis=1)
    return points[kept] if kept.any() else points


def _about_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
