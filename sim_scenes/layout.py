"""Where things go: a plan of the room that keeps furniture apart, doors free and pictures off cupboards."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from dsmap.sim_scenes.scene import Assembly, Scene
from dsmap.sim_scenes.textures import Rng

GAP = 0.03
"""Air between furniture and a wall or a neighbour [m]."""


@dataclass
class Wall:
    """One wall as seen from inside: x to the right of an assembly that stands against it, z up."""

    centre: np.ndarray
    """Middle of its foot [m], shape (2,)."""
    normal: np.ndarray
    """Into the room, shape (2,)."""
    length: float
    height: float
    busy: list[tuple[float, float, float, float]] = field(default_factory=list)
    """Rectangles x0, x1, z0, z1 that nothing may be hung on."""

    @property
    def yaw(self) -> float:
        """The turn that makes an assembly's front (-y) look into the room [rad]."""
        return float(np.arctan2(self.normal[1], self.normal[0]) + np.pi / 2)

    def point(self, x: float, out: float) -> np.ndarray:
        """Floor position `x` along the wall and `out` metres into the room, shape (2,)."""
        along = np.array([np.cos(self.yaw), np.sin(self.yaw)])
        return self.centre + x * along + out * self.normal

    def free(self, x0: float, x1: float, z0: float, z1: float, margin: float = 0.06) -> bool:
        """Whether nothing hangs on or stands before that rectangle."""
        return all(
            x1 + margin < a or b + margin < x0 or z1 + margin < c or d + margin < z0
            for a, b, c, d in self.busy
        )


def walls_of(size: np.ndarray) -> list[Wall]:
    """The four walls of a room of inner `size` centred on the origin."""
    half = size[:2] / 2
    normals = np.array([[0, 1], [-1, 0], [0, -1], [1, 0]], float)
    return [Wall(-n * half, n, float(size[i % 2]), float(size[2])) for i, n in enumerate(normals)]


class Layout:
    """Places assemblies in a scene and remembers the floor they take."""

    def __init__(self, scene: Scene, rng: Rng) -> None:
        self.scene = scene
        self.rng = rng
        self.walls = walls_of(scene.size)
        self.taken: list[np.ndarray] = []

    def footprint(self, piece: Assembly, xy: np.ndarray, yaw: float) -> np.ndarray:
        """Axis-aligned floor rectangle of a piece [m], shape (2, 2): low, high corner."""
        low, high = piece.bounds()[:, :2]
        corners = np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])])
        c, s = np.cos(yaw), np.sin(yaw)
        corners = corners @ np.array([[c, s], [-s, c]]) + xy
        return np.array([corners.min(0), corners.max(0)])

    def fits(self, rect: np.ndarray, gap: float = GAP) -> bool:
        """Whether a floor rectangle lies inside the room and off everything that was placed."""
        half = self.scene.size[:2] / 2
        if (rect[0] < -half).any() or (rect[1] > half).any():
            return False
        return all((rect[1] + gap <= t[0]).any() or (rect[0] - gap >= t[1]).any() for t in self.taken)

    def stand(self, piece: Assembly, xy: Iterable[float], yaw: float) -> bool:
        """Stand a piece on the floor if there is room for it."""
        xy = np.asarray(tuple(xy), float)
        rect = self.footprint(piece, xy, yaw)
        if not self.fits(rect):
            return False
        self.taken.append(rect)
        self.scene.place(piece, (*xy, 0.0), yaw)
        low, high = piece.bounds()
        self.scene.targets.append(np.array([*rect.mean(0), 0.3 * low[2] + 0.7 * high[2]]))
        return True

    def against(self, piece: Assembly, wall: Wall, x: float | None = None, out: float = GAP) -> float | None:
        """Stand a piece with its back to a wall, at `x` or at a random free place; returns x or None."""
        low, high = piece.bounds()
        reach = wall.length / 2
        tries = (
            [x]
            if x is not None
            else self.rng.uniform(-reach - low[0] + GAP, reach - high[0] - GAP, 24).tolist()
        )
        for at in tries:
            left, right = at + low[0], at + high[0]
            if left < -reach or right > reach or not wall.free(left, right, 0.0, float(high[2]), 0.0):
                continue
            if self.stand(piece, wall.point(at, float(high[1]) + out), wall.yaw):
                wall.busy.append((left, right, 0.0, float(high[2])))
                return at
        return None

    def hang(self, piece: Assembly, wall: Wall, x: float | None, centre: float) -> bool:
        """Hang a piece with its middle `centre` metres up, at `x` or at a random free place."""
        low, high = piece.bounds()
        bottom = centre - float(high[2]) / 2
        reach = wall.length / 2 - 0.1
        tries = [x] if x is not None else self.rng.uniform(-reach - low[0], reach - high[0], 16).tolist()
        for at in tries:
            left, right = at + low[0], at + high[0]
            if wall.free(left, right, bottom, bottom + float(high[2])):
                self.scene.place(piece, (*wall.point(at, float(high[1])), bottom), wall.yaw)
                wall.busy.append((left, right, bottom, bottom + float(high[2])))
                self.scene.targets.append(np.array([*wall.point(at, 0.0), min(centre, 1.25)]))
                return True
        return False
