"""Where to look at a map from: the up direction, and an overview from outside that shows the inside.

Surfels are seen from their front only, so the walls and the ceiling between an outside camera and a room
vanish by themselves: it is enough to pick a direction that most surfels face.
"""

from dataclasses import dataclass

import numpy as np

from dsmap.frame import Intrinsics
from dsmap.gravity import estimate_up

_FOV_DEG = 32.0
"""Vertical field of view of virtual cameras: narrow, so that a room is drawn with little distortion."""
_FILL = 0.94
"""Share of the image's width or height that a map fills."""
_SAMPLE = 60_000
"""Surfels that decide about a view; more do not change it."""


@dataclass(frozen=True)
class View:
    """A virtual camera."""

    intrinsics: Intrinsics
    T_world_camera: np.ndarray
    """Pose, float64, shape (4, 4)."""


def up_direction(normal: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """The world's up direction, a unit vector, shape (3,).

    Cameras are held upright on average, so the search begins at the mean of their -y axes.

    Args:
        normal: surfel normals, shape (N, 3).
        poses: T_world_camera of the frames, shape (M, 4, 4).
    """
    return estimate_up(normal, -poses[:, :3, 1].mean(axis=0) if len(poses) else (0.0, 0.0, 1.0)).direction


def level_axes(normal: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Rotation from the world to level axes (x and y along the walls, z up), shape (3, 3)."""
    first = np.eye(3)[np.argmin(np.abs(up))]
    x = _unit(np.cross(first, up))
    frame = np.stack([x, np.cross(up, x), up])
    level = normal @ frame.T
    walls = level[np.abs(level[:, 2]) < 0.2]
    if len(walls) == 0:
        return frame
    # Walls stand at right angles: four times their angle is one direction, whose mean no wall can bias.
    angle = np.angle(np.exp(4j * np.arctan2(walls[:, 1], walls[:, 0])).mean()) / 4
    turn = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return turn @ frame


def overview(
    surfels: dict[str, np.ndarray],
    poses: np.ndarray,
    width: int,
    height: int,
    elevation_deg: float = 42.0,
    up: np.ndarray | None = None,
) -> View:
    """A camera outside the map, above and obliquely to the walls, from where most surface is seen.

    Where the recording's cameras looked to one side, the overview is rather taken from their side.

    Args:
        surfels: position, normal and radius of N > 0 surfels, by name.
        poses: T_world_camera of the frames, shape (M, 4, 4).
        width, height: image size [px].
        up: in the world's frame, shape (3,); None: by `up_direction`.
    """
    rows = np.linspace(0, len(surfels["position"]) - 1, min(_SAMPLE, len(surfels["position"]))).astype(int)
    position = surfels["position"][rows].astype(np.float64)
    normal = surfels["normal"][rows].astype(np.float64)
    area = surfels["radius"][rows].astype(np.float64) ** 2
    up = up_direction(normal, poses) if up is None else up
    axes = level_axes(normal, up)
    elevation = np.radians(elevation_deg)
    behind = -poses[:, :3, 2].mean(axis=0) if len(poses) else np.zeros(3)
    best, best_score = up, -1.0
    for azimuth in np.radians([33, 57, 123, 147, 213, 237, 303, 327]):
        flat = np.array([np.cos(azimuth), np.sin(azimuth), 0.0]) * np.cos(elevation)
        direction = axes.T @ (flat + [0, 0, np.sin(elevation)])
        score = (area * np.maximum(normal @ direction, 0)).sum() * (1 + 0.7 * float(behind @ direction))
        if score > best_score:
            best, best_score = direction, score
    facing = normal @ best > 0.1
    shown = position[facing] if facing.sum() > 100 else position
    return frame_points(shown, poses[:, :3, 3], best, up, width, height)


def frame_points(
    position: np.ndarray, path: np.ndarray, direction: np.ndarray, up: np.ndarray, width: int, height: int
) -> View:
    """A camera in `direction` from the points, at the distance at which they fill the image.

    All of the path (M, 3) is in the image, and all points (N, 3) but the outermost 0.05 % on each
    side: stray surfels must not make the map small.
    """
    focal = 0.5 * height / np.tan(np.radians(_FOV_DEG) / 2)
    intrinsics = Intrinsics(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
    z = -_unit(direction)
    x = _unit(np.cross(z, up))
    rotation = np.stack([x, np.cross(z, x), z], axis=1)  # camera axes as columns: right, down, forward
    middle = position.mean(axis=0)
    low, high = np.percentile((position - middle) @ rotation, [0.05, 99.95], axis=0)
    trimmed = ((position - middle) @ rotation).clip(low, high)
    local = np.concatenate([trimmed, (path - middle) @ rotation])
    slope = _FILL * np.array([width, height]) / (2 * focal)
    centre, distance = np.zeros(2), 0.0
    for _ in range(8):
        # Each point asks for the distance at which it touches the image border; the farthest demand wins.
        reach = np.abs(local[:, :2] - centre) / slope - local[:, 2:]
        distance = max(float(reach.max()), 1e-3 - float(local[:, 2].min()))
        ratio = (local[:, :2] - centre) / (local[:, 2:] + distance)
        centre = centre + 0.5 * (ratio.min(axis=0) + ratio.max(axis=0)) * distance
    T = np.eye(4)
    T[:3, :3] = rotation
    T[:3, 3] = middle + rotation @ np.array([centre[0], centre[1], -distance])
    return View(intrinsics, T)


def _unit(v: np.ndarray) -> np.ndarray:
    return v / max(float(np.linalg.norm(v)), 1e-12)
