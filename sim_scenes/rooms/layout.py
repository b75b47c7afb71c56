"""Where things go: a plan of one room that keeps furniture apart, ways free and pictures off cupboards."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dsmap.sim_scenes.geometry.shapes import rotation_z
from dsmap.sim_scenes.physics.colliders import colliders_of, touch
from dsmap.sim_scenes.scene import Assembly, Room, Scene
from dsmap.sim_scenes.space.walkable import HALF_WIDTH, Walkable

GAP = 0.03
"""Air between furniture and a wall or a neighbour [m]."""
SKIRTING = 0.025
"""What stands on the floor keeps this far from walls: skirting boards are nearly as thick [m]."""
FLAT = 0.03
"""Things lower than this are walked over, and furniture may stand on them (rugs) [m]."""


@dataclass
class Wall:
    """One wall as seen from inside: x to the right of an assembly that stands against it, z up."""

    centre: np.ndarray
    """Middle of its foot [m], shape (2,)."""
    normal: np.ndarray
    """Into the room, shape (2,)."""
    length: float
    height: float
    thickness: float = 0.16
    """From its face inside to its back [m]."""
    busy: list[tuple[float, float, float, float]] = field(default_factory=list)
    """Rectangles x0, x1, z0, z1 that nothing may be hung on."""

    @property
    def yaw(self) -> float:
        """The turn that makes an assembly's front (-y) look into the room [rad]."""
        return float(np.arctan2(self.normal[1], self.normal[0]) + np.pi / 2)

    @property
    def along(self) -> np.ndarray:
        """Unit vector of growing x, shape (2,)."""
        return np.array([-self.normal[1], self.normal[0]])

    def point(self, x: float, out: float) -> np.ndarray:
        """Floor position `x` along the wall and `out` metres into the room, shape (2,)."""
        return self.centre + x * self.along + out * self.normal

    def local(self, xy: np.ndarray) -> float:
        """The x of a floor position (2,)."""
        return float((xy - self.centre) @ self.along)

    def free(self, x0: float, x1: float, z0: float, z1: float, margin: float = 0.06) -> bool:
        """Whether nothing hangs on or stands before that rectangle."""
        return all(
            x1 + margin < a or b + margin < x0 or z1 + margin < c or d + margin < z0
            for a, b, c, d in self.busy
        )


def walls_of(room: Room) -> list[Wall]:
    """The four walls of a room: at its lowest y, highest x, highest y, lowest x."""
    centre, half = (room.low + room.high) / 2, (room.high - room.low) / 2
    normals = np.array([[0, 1], [-1, 0], [0, -1], [1, 0]], float)
    return [Wall(centre - n * half, n, 2 * float(half[i % 2]), room.height) for i, n in enumerate(normals)]


@dataclass(frozen=True)
class Block:
    """Room taken by a piece: a turned rectangle on the floor times a range of heights."""

    corners: np.ndarray
    """Counter-clockwise [m], shape (4, 2)."""
    low: float
    high: float
    """Heights [m]."""
    piece: int = -1
    """Index into `Scene.pieces` of what stands there; -1 = floor that is kept free."""

    def meets(self, other: "Block", gap: float) -> bool:
        """Whether two blocks come nearer to each other than `gap` sideways (and overlap in height)."""
        if self.high <= other.low or other.high <= self.low:
            return False
        for edge in np.concatenate([np.diff(self.corners[:3], axis=0), np.diff(other.corners[:3], axis=0)]):
            axis = edge / np.linalg.norm(edge)
            a, b = self.corners @ axis, other.corners @ axis
            if a.max() + gap <= b.min() or b.max() + gap <= a.min():
                return False
        return True


def strip(wall: Wall, x0: float, x1: float, near: float, far: float) -> np.ndarray:
    """Corners of the floor before a stretch of wall, shape (4, 2)."""
    return np.array([wall.point(x1, near), wall.point(x0, near), wall.point(x0, far), wall.point(x1, far)])


class Layout:
    """Places assemblies in one room of a scene and remembers the space they take."""

    def __init__(self, scene: Scene, rng: np.random.Generator, room: int = 0) -> None:
        self.scene = scene
        self.rng = rng
        self.index = room
        self.room = scene.rooms[room]
        self.walls = walls_of(self.room)
        self.taken: list[Block] = []
        # A little wider than needed: settled things slide, and what hangs on walls is not in this plan.
        self.floor = Walkable(self.room.low, self.room.high, HALF_WIDTH + 0.05)

    @property
    def size(self) -> np.ndarray:
        """Inner width (x), depth (y), height (z) of the room [m]."""
        return np.array([*(self.room.high - self.room.low), self.room.height])

    @property
    def centre(self) -> np.ndarray:
        """Middle of the floor [m], shape (2,)."""
        return (self.room.low + self.room.high) / 2

    def block(self, piece: Assembly, xy: np.ndarray, yaw: float, z: float = 0.0) -> Block:
        """The space that a piece takes."""
        low, high = piece.bounds()
        x, y = [low[0], high[0], high[0], low[0]], [low[1], low[1], high[1], high[1]]
        c, s = np.cos(yaw), np.sin(yaw)
        return Block(np.stack([x, y], 1) @ np.array([[c, s], [-s, c]]) + xy, z + low[2], z + high[2])

    def keep_out(self, wall: Wall, x0: float, x1: float, out: float, height: float = 2.1) -> None:
        """Leave the floor before a stretch of wall free; people may walk there."""
        self.taken.append(Block(strip(wall, x0, x1, 0.0, out), 0.0, height))

    def fits(
        self, block: Block, gap: float = GAP, ignore: Sequence[Block] = (), wall: float = SKIRTING
    ) -> bool:
        """Whether a block lies inside the room, `wall` off its walls where it stands low, and off what was placed."""
        off = (wall if block.low < 0.1 and block.high > FLAT else 0.0) - 1e-6
        if (block.corners < self.room.low + off).any() or (block.corners > self.room.high - off).any():
            return False
        return not any(t.meets(block, gap) for t in self.taken if not any(t is one for one in ignore))

    def stand(
        self,
        piece: Assembly,
        xy: Iterable[float],
        yaw: float,
        under: Sequence[Block] = (),
        room: float = 0.0,
        top: float = np.inf,
    ) -> Block | None:
        """Stand a piece on the floor if it fits and leaves the doors joined; returns the space it took.

        Args:
            under: blocks that it may reach into as far as nothing touches (the table of a chair).
            room: air that it needs around it [m].
            top: height to which it counts; what stands higher on it is slim (taps before a window) [m].
        """
        xy = np.asarray(tuple(xy), float)
        block = self.block(piece, xy, yaw)
        block = replace(block, high=min(block.high, top))
        if not self.fits(block, max(GAP, room), under) or self._touches(piece, xy, yaw, under):
            return None
        if block.high > FLAT:
            if not self.floor.stays_open([block.corners]):
                return None
            self.floor.block(block.corners)
            block = replace(block, piece=len(self.scene.pieces))
            self.taken.append(block)
        low, high = piece.bounds()
        self.scene.place(piece, (*xy, max(0.0, -float(low[2]))), yaw, room=self.index)
        if block.high > FLAT:
            self.scene.targets.append(np.array([*block.corners.mean(0), 0.3 * low[2] + 0.7 * high[2]]))
        return block

    def _touches(self, piece: Assembly, xy: np.ndarray, yaw: float, under: Sequence[Block]) -> bool:
        """Whether a piece here would touch the pieces that stand in these blocks."""
        if not under:
            return False
        T = np.eye(4)
        T[:3, :3], T[:2, 3] = rotation_z(yaw), xy
        own = [c.moved(T) for c in colliders_of(piece)]
        for block in under:
            other = self.scene.pieces[block.piece]
            if touch(own, [c.moved(other.T_world_piece) for c in colliders_of(other.assembly)], 0.004):
                return True
        return False

    def against(
        self,
        piece: Assembly,
        wall: Wall,
        x: float | None = None,
        out: float = GAP,
        front: float = 0.0,
        top: float = np.inf,
    ) -> float | None:
        """Stand a piece with its back to a wall, at `x` or at a random free place; returns x or None.

        Args:
            out: air behind it [m].
            front: floor before it that stays free for whoever uses it [m].
            top: as of `stand`.
        """
        low, high = piece.bounds()
        tall = min(float(high[2]), top)
        reach = float(high[1] - low[1]) + out
        for at in self._tries(wall, low[0] - GAP, high[0] + GAP, x, 24):
            left, right = float(at + low[0]), float(at + high[0])
            if not wall.free(left, right, 0.0, tall, 0.0):
                continue
            apron = Block(strip(wall, left, right, reach, reach + front), 0.0, 1.0)
            if front and not self.fits(apron, 0.0, [b for b in self.taken if b.piece < 0]):
                continue
            if self.stand(piece, wall.point(at, float(high[1]) + out), wall.yaw, top=top):
                wall.busy.append((left, right, 0.0, tall))
                if front:
                    self.taken.append(apron)
                return at
        return None

    def stretches(self, wall: Wall, height: float) -> list[tuple[float, float]]:
        """Parts x0..x1 of a wall that nothing lower than `height` takes, neither on it nor before it; widest first."""
        edges = np.arange(-wall.length / 2 + GAP, wall.length / 2 - GAP, 0.05)
        free = [
            wall.free(x, x + 0.05, 0.0, height, 0.0)
            and self.fits(Block(strip(wall, x, x + 0.05, 0.05, 0.6), 0.0, height), 0.0)
            for x in edges
        ]
        found, start = [], None
        for x, good in zip([*edges, edges[-1] + 0.05], [*free, False], strict=True):
            if good and start is None:
                start = float(x)
            elif not good and start is not None:
                found.append((start, float(x)))
                start = None
        return sorted(found, key=lambda s: s[0] - s[1])

    def hang(self, piece: Assembly, wall: Wall, x: float | None, bottom: float) -> float | None:
        """Hang a piece with its lower edge `bottom` metres up, at `x` or at a random free place."""
        low, high = piece.bounds()
        for at in self._tries(wall, low[0] - 0.05, high[0] + 0.05, x, 16):
            left, right = float(at + low[0]), float(at + high[0])
            xy = wall.point(at, float(high[1]) + 0.002)
            block = self.block(piece, xy, wall.yaw, bottom)
            if block.high > wall.height - 0.09 or block.low < 0.1:
                return None
            if wall.free(left, right, block.low, block.high, 0.02) and self.fits(block, 0.02):
                self.scene.place(piece, (*xy, bottom), wall.yaw, room=self.index)
                wall.busy.append((left, right, block.low, block.high))
                self.taken.append(block)
                middle = (block.low + block.high) / 2
                if len(wall.busy) % 2:  # every other one is looked at: most of such a view is bare wall
                    self.scene.targets.append(np.array([*wall.point(at, 0.0), min(middle, 1.25)]))
                return at
        return None

    def _tries(self, wall: Wall, low: float, high: float, x: float | None, count: int) -> list[float]:
        """Places along a wall for something that reaches from x + low to x + high."""
        least, most = -wall.length / 2 - low, wall.length / 2 - high
        if x is not None:
            return [x] if least - 0.05 <= x <= most + 0.05 else []
        return self.rng.uniform(least, most, count).tolist() if least < most else []
