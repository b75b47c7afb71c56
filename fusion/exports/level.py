"""The level frame of a map: z up, x and y along the walls, the floor at z = 0."""

import copy

import numpy as np

from dsmap.fusion.pictures.viewpoint import level_axes, up_direction
from dsmap.fusion.runs.read_run import SavedRun
from dsmap.fusion.trajectory import Trajectory


def level_transform(run: SavedRun) -> np.ndarray:
    """T_level_world of a run, shape (4, 4); its origin lies below that of the world.

    Up and the floor are those of the whole map. A map too small to say is level by its normals, its floor the lowest
    that was seen.
    """
    surfels = run.surfels.numpy()
    alive = surfels["weight"] > 0
    position, normal = surfels["position"][alive], surfels["normal"][alive]
    gravity = copy.copy(run.gravity)
    points = Trajectory.of_arrays(run.times, run.poses, run.tracked, np.full(len(run.times), np.nan))
    gravity.update(run.surfels, run.config.stable_weight, points)
    up, floor = gravity.up, gravity.floor
    if up is None:
        up = up_direction(normal, run.poses)
        floor = float(np.percentile(position @ up, 1)) if len(position) else 0.0
    T = np.eye(4)
    T[:3, :3] = level_axes(normal, up)
    T[2, 3] = -floor
    return T


def transformed(T: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (N, 3) under a rigid transform (4, 4)."""
    return points @ T[:3, :3].T + T[:3, 3]
