"""A box-shaped room of surfels with a camera path in it, to test export, pictures and the viewer on."""

import numpy as np

from dsmap.kernels.types import SurfelMap

WALL, FLOOR, CEILING, TABLE = 12, 5, 3, 10
SIZE = np.array([4.0, 3.0, 2.4])
"""Inner size of the room [m], world z up."""


def room_arrays(spacing: float = 0.03) -> dict[str, np.ndarray]:
    """Surfels on the inside of floor, ceiling, walls and a table top, by the names of SurfelMap."""
    parts = []
    for axis in range(3):
        a, b = [i for i in range(3) if i != axis]
        u, v = np.meshgrid(np.arange(0, SIZE[a], spacing), np.arange(0, SIZE[b], spacing))
        for side in (0, 1):
            position = np.zeros((u.size, 3))
            position[:, a], position[:, b], position[:, axis] = u.ravel(), v.ravel(), side * SIZE[axis]
            normal = np.zeros_like(position)
            normal[:, axis] = 1 - 2 * side
            label = WALL if axis < 2 else (FLOOR, CEILING)[side]
            parts.append((position, normal, np.full(u.size, label)))
    u, v = np.meshgrid(np.arange(1.5, 2.5, spacing), np.arange(1.0, 2.0, spacing))
    top = np.stack([u.ravel(), v.ravel(), np.full(u.size, 0.75)], axis=1)
    parts.append((top, np.tile([0.0, 0.0, 1.0], (u.size, 1)), np.full(u.size, TABLE)))
    position, normal, label = (np.concatenate(column) for column in zip(*parts, strict=True))
    count = len(position)
    return {
        "position": position.astype(np.float32),
        "normal": normal.astype(np.float32),
        "colour": (position / SIZE).astype(np.float32),
        "weight": np.linspace(1, 60, count, dtype=np.float32),
        "radius": np.full(count, spacing, np.float32),
        "t_created": np.linspace(0, 90, count).astype(np.int32),
        "t_updated": np.full(count, 99, np.int32),
        "label": label.astype(np.uint8),
        "segment": label.astype(np.int32),
    }


def room_map(spacing: float = 0.03) -> SurfelMap:
    """The same as a SurfelMap on the CPU."""
    return map_of(room_arrays(spacing))


def map_of(arrays: dict[str, np.ndarray]) -> SurfelMap:
    """A SurfelMap on the CPU with the given arrays; those not named stay zero."""
    surfels = SurfelMap.empty("cpu", capacity=max(1, len(arrays["weight"])))
    surfels.count = len(arrays["weight"])
    for name, values in arrays.items():
        surfels.numpy()[name][:] = values
    return surfels


def camera_path(count: int = 30) -> list[tuple[float, np.ndarray, bool]]:
    """Rows (time, T_world_camera, tracked): a half circle at 1.5 m, looking outwards and level."""
    rows = []
    for i, angle in enumerate(np.linspace(0, np.pi, count)):
        forward = np.array([np.cos(angle), np.sin(angle), 0.0])
        down = np.array([0.0, 0.0, -1.0])
        T = np.eye(4)
        T[:3, :3] = np.stack([np.cross(down, forward), down, forward], axis=1)
        T[:3, 3] = np.array([2.0, 1.5, 1.5]) + 0.5 * forward
        rows.append((1.0 + i / 30, T, i != 7))
    return rows
