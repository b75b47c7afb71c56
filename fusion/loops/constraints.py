"""The constraints of a loop (Eq. 4), and those of the loops closed before."""

from typing import Any

import numpy as np

from dsmap.fusion.loops.deformation_graph import Constraints, DeformationGraph
from dsmap.kernels.types import ModelMaps, SurfelMap

_MIN_CONSTRAINTS = 12
_KEPT = 24
"""Constraints of a closed loop that later loops must not tear open."""
_GATE = 0.05
"""A pair whose depths differ by more [m] after registration is none."""


def constraints(
    active: ModelMaps,
    inactive: ModelMaps,
    camera: Any,
    surfels: SurfelMap,
    T_world_camera: np.ndarray,
    T_found: np.ndarray,
    columns: int,
) -> tuple[Constraints, int] | None:
    """Pairs (Q_s; Q_d; t_s; t_d) of Eq. 4 on a grid of pixels.

    Args:
        active: the active model from T_world_camera, finest level.
        inactive: the inactive model from T_found; `camera` is the one it was rendered with.
        T_found: where registration puts the camera: T_ina of Eq. 4.
        columns: of the grid.

    Returns:
        The constraints with their destinations pinned, and the frame that saw the inactive surface last (the
        median of the pairs); None if there are too few.
    """
    height, width = active.index.shape
    step = width / columns
    y, x = ((np.arange(int(n / step)) + 0.5) * step for n in (height, width))
    y, x = np.meshgrid(y.astype(int), x.astype(int), indexing="ij")
    of_active, points = active.index.numpy()[y, x].ravel(), active.vertex.numpy()[y, x].reshape(-1, 3)
    keep = of_active >= 0
    of_active, points = of_active[keep], points[keep].astype(np.float64)
    # The inactive view is rendered from T_found, so P(u, D_t^a) falls into it where it falls into the active one.
    u = np.rint(camera.fx * points[:, 0] / points[:, 2] + camera.cx).astype(int).clip(0, camera.width - 1)
    v = np.rint(camera.fy * points[:, 1] / points[:, 2] + camera.cy).astype(int).clip(0, camera.height - 1)
    of_inactive = inactive.index.numpy()[v, u]
    gap = np.abs(inactive.vertex.numpy()[v, u, 2] - points[:, 2])
    keep = (of_inactive >= 0) & (gap < _GATE)
    if np.count_nonzero(keep) < _MIN_CONSTRAINTS:
        return None
    of_active, of_inactive, points = of_active[keep], of_inactive[keep], points[keep]
    created = surfels.numpy()["t_created"]
    seen = np.sort(inactive.time.numpy()[v, u][keep])
    pairs = Constraints(
        source=points @ T_world_camera[:3, :3].T + T_world_camera[:3, 3],
        destination=points @ T_found[:3, :3].T + T_found[:3, 3],
        t_source=created[np.asarray(of_active, np.intp)].astype(np.int64),
        t_destination=created[np.asarray(of_inactive, np.intp)].astype(np.int64),
        pin=np.ones(len(points), dtype=bool),
    )
    return pairs, int(seen[len(seen) // 2])


class ClosedLoops:
    """A few pairs of points of every closed loop: they are one surface and stay together."""

    def __init__(self) -> None:
        self.points = np.zeros((0, 2, 3))
        """Source and destination [m], world frame, shape (M, 2, 3)."""
        self.times = np.zeros((0, 2), dtype=np.int64)

    def add(self, pairs: Constraints) -> None:
        """Keep some pairs of a loop that has just been closed: source and destination are one point now."""
        rows = np.linspace(0, len(pairs.source) - 1, min(_KEPT, len(pairs.source))).astype(int)
        both = np.repeat(pairs.destination[rows, None], 2, axis=1)
        self.points = np.concatenate([self.points, both])
        times = np.stack([pairs.t_source[rows], pairs.t_destination[rows]], axis=1)
        self.times = np.concatenate([self.times, times])

    def move(self, graph: DeformationGraph) -> None:
        """The points ride along with the map."""
        for side in range(2) if len(self.points) else ():
            self.points[:, side] = graph.apply_to_points(self.points[:, side], self.times[:, side])

    def constraints(self) -> Constraints:
        """Relative constraints: the pairs meet wherever the graph takes them."""
        count = len(self.points)
        return Constraints(
            self.points[:, 0], self.points[:, 1], self.times[:, 0], self.times[:, 1],
            np.zeros(count, dtype=bool), np.ones(count, dtype=bool),
        )  # fmt: skip
