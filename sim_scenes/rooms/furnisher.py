"""Rules that rooms share: fill walls, put chairs to tables and desks, lay rugs, hang pictures."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from dsmap.sim_scenes.geometry.shapes import Shape, box
from dsmap.sim_scenes.pieces import lamps, office, seats, storage, tables, wall_art
from dsmap.sim_scenes.rooms.layout import Block, Layout, Wall
from dsmap.sim_scenes.scene import Assembly, TopArea
from dsmap.sim_scenes.textures import art
from dsmap.sim_scenes.textures.palette import Looks

RUG = 0.004
"""Thickness of a rug [m]: furniture stands on the floor through it."""
PieceMaker = Callable[..., Assembly]

CHAIRS = (
    seats.dining_chair,
    seats.dining_chair,
    seats.upholstered_chair,
    seats.shell_chair,
    seats.windsor_chair,
)


@dataclass
class Furnisher:
    """One room being furnished."""

    rng: np.random.Generator
    looks: Looks
    layout: Layout

    def make(self, piece: PieceMaker, *args: float) -> Assembly:
        """A piece, which is called after the function that makes it."""
        made = piece(self.rng, self.looks, *args)
        made.name = piece.__name__
        return made

    def one_of(self, *pieces: PieceMaker) -> Assembly:
        """A piece made by one of these functions."""
        return self.make(pieces[int(self.rng.integers(len(pieces)))])

    def odds(self, chance: float) -> bool:
        """True with this probability."""
        return bool(self.rng.random() < chance)

    def walls(self, without: Sequence[int] = ()) -> list[Wall]:
        """The walls in random order."""
        return [self.layout.walls[k] for k in self.rng.permutation(4) if k not in without]

    def best_wall(self, height: float = 1.0) -> int:
        """Number of a wall with a long stretch free of doors and windows, with some luck in the choice."""
        longest = [
            max([b - a for a, b in self.layout.stretches(w, height)], default=0.0) for w in self.layout.walls
        ]
        return int(np.argmax(np.array(longest) + self.rng.uniform(0, 0.6, 4)))

    def fill(
        self, walls: Sequence[Wall], pieces: Iterable[Assembly], front: float = 0.0
    ) -> list[float | None]:
        """Stand pieces against whichever of the walls has room; returns where along it each came to stand."""
        placed: list[float | None] = []
        for piece in pieces:
            tries = (
                self.layout.against(piece, walls[k], front=front) for k in self.rng.permutation(len(walls))
            )
            placed.append(next((x for x in tries if x is not None), None))
        return placed

    def hang(self, piece: Assembly, bottom: float, walls: Sequence[Wall] | None = None) -> bool:
        """Hang a piece somewhere on one of the walls."""
        return any(self.layout.hang(piece, w, None, bottom) is not None for w in walls or self.walls())

    def put_on(
        self,
        base: Assembly,
        thing: Assembly,
        surface: TopArea,
        x: tuple[float, float],
        y: tuple[float, float],
        yaw: float = 0.0,
    ) -> bool:
        """Stand a thing on a surface off all that is on it; x, y = ranges for its place, 0..1 of the surface."""
        x0, y0, x1, y1, z = surface
        taken = [s.bounds() for s, *_ in base.parts if s.bounds()[1, 2] > z + 0.002]
        for _ in range(8):
            turn = yaw + self.rng.uniform(-0.12, 0.12)
            parts = [s.moved(yaw=turn).bounds() for s, *_ in thing.parts]
            low, high = np.min([p[0] for p in parts], 0), np.max([p[1] for p in parts], 0)
            room = np.array([x0, y0]) - low[:2], np.array([x1, y1]) - high[:2]
            if (room[0] > room[1] + 0.06).any():
                return False
            share = np.array([self.rng.uniform(*x), self.rng.uniform(*y)])
            at = np.array([*(room[0] + share * (room[1] - room[0])), z])
            if not any((t[1] > low + at + [0, 0, 0.001]).all() and (t[0] < high + at).all() for t in taken):
                base.attach(thing, at, turn)
                return True
        return False

    def dining(self, seats_wanted: int = 4, tries: int = 60) -> bool:
        """A table with chairs of one kind pushed towards it, wherever the floor is free."""
        rng, layout = self.rng, self.layout
        round_one = seats_wanted <= 4 and self.odds(0.35)
        board = self.make(tables.round_table) if round_one else self.make(tables.dining_table, seats_wanted)
        for attempt in range(tries):
            yaw = rng.choice([0.0, np.pi / 2]) + rng.uniform(-0.06, 0.06)
            xy = rng.uniform(layout.room.low + 0.4, layout.room.high - 0.4)
            table = layout.stand(board, xy, yaw, room=0.55 if attempt < tries / 2 else 0.25)
            if table is not None:
                break
        else:
            return False
        self.seat(board, table, xy, yaw, seats_wanted)
        return True

    def seat(self, board: Assembly, table: Block, xy: np.ndarray, yaw: float, wanted: int) -> None:
        """Chairs along the sides of a table (board's own frame: x the long side)."""
        width, depth = board.size()[:2]
        a_side = max(1, int(width // 0.62)) if width > depth + 0.1 else 1
        spots = [(side, k) for side in (0, 2) for k in range(a_side)] + [(1, 0), (3, 0)]
        chair = self.one_of(*CHAIRS)
        for side, k in spots[:wanted]:
            shift = ((k + 0.5) / a_side - 0.5) * width * 0.92 if side in (0, 2) else 0.0
            half = (depth if side in (0, 2) else width) / 2
            angle = yaw + side * np.pi / 2
            forward = float(-chair.bounds()[0, 1])
            for out in (-0.18, -0.08, 0.04, 0.16):
                reach = half + forward + out + self.rng.uniform(-0.04, 0.06)
                local = np.array([shift if side == 0 else -shift, -reach])
                c, s = np.cos(angle), np.sin(angle)
                at = xy + np.array([c * local[0] - s * local[1], s * local[0] + c * local[1]])
                if self.layout.stand(chair, at, angle + np.pi + self.rng.uniform(-0.15, 0.15), under=[table]):
                    break

    def desk(self, walls: Sequence[Wall], chairs: Sequence[PieceMaker] = (seats.office_chair,)) -> bool:
        """A work place against a wall: desk, screen, keyboard, lamp, books, and a chair before it."""
        rng, layout = self.rng, self.layout
        desk = self.make(
            (tables.desk, tables.desk, tables.corner_desk, tables.standing_desk)[int(rng.integers(4))]
        )
        top = desk.surfaces[0]
        self._equip(desk, top)
        for wall in walls:
            x = layout.against(desk, wall)
            if x is None:
                continue
            table = next(b for b in reversed(layout.taken) if b.piece >= 0)
            seat = self.one_of(*chairs)
            middle = x + (top[0] + top[2]) / 2
            edge = float(desk.bounds()[1, 1] - top[1])
            for out in (0.16, 0.26, 0.36, 0.48):
                at = wall.point(middle + rng.uniform(-0.18, 0.18), edge + out + rng.uniform(0, 0.08))
                if layout.stand(seat, at, wall.yaw + np.pi + rng.uniform(-0.5, 0.5), under=[table]):
                    break
            return True
        return False

    def _equip(self, desk: Assembly, top: TopArea) -> None:
        screens = (
            office.monitor,
            office.monitor,
            office.dual_monitors,
            office.laptop,
        )
        kind = screens[int(self.rng.integers(4))]
        near = (0.35, 0.6) if kind is office.laptop else (0.9, 1.0)
        self.put_on(desk, self.make(kind), top, (0.35, 0.65), near, 0.0)
        if kind is not office.laptop:
            self.put_on(desk, self.make(office.keyboard), top, (0.4, 0.6), (0.15, 0.4), 0.0)
        for chance, thing in (
            (0.6, lamps.desk_lamp),
            (0.3, office.telephone),
            (0.45, office.paper_tray),
            (0.6, office.paper_stack),
            (0.3, office.printer),
        ):
            if self.odds(chance):
                self.put_on(
                    desk,
                    self.make(thing),
                    top,
                    (0.0, 0.12) if self.odds(0.5) else (0.88, 1.0),
                    (0.3, 1.0),
                    0.0,
                )
        if self.odds(0.3):
            row = storage.row_of_books(self.rng, self.looks, 0.3, 0.3)
            self.put_on(desk, row, top, (0.0, 1.0), (1.0, 1.0), 0.0)

    def rug(self, xy: np.ndarray, yaw: float, width: float, depth: float) -> None:
        """A printed rug on the floor."""
        plate = box((width, depth, RUG))
        uv = np.stack([plate.vertices[:, 0] / width + 0.5, 0.5 - plate.vertices[:, 1] / depth], 1)
        rug = Assembly("floor", name="rug")
        rug.add(
            Shape(plate.vertices, plate.faces, np.clip(uv, 0.003, 0.997)),
            self.looks.printed("rug", art.rug(self.rng), 0.02),
        )
        yaw += self.rng.uniform(-0.04, 0.04)
        corners = self.layout.block(rug, np.asarray(xy, float), yaw).corners
        over = np.maximum(self.layout.room.low + 0.05 - corners, 0).max(0)
        over -= np.maximum(corners - self.layout.room.high + 0.05, 0).max(0)
        self.layout.scene.place(rug, (*(xy + over), 0.0), yaw, room=self.layout.index)

    def pictures(self, count: int) -> None:
        """Hang pictures, posters and now and then a clock or a gallery about eye height."""
        for _ in range(count):
            kinds = (wall_art.picture,) * 6 + (wall_art.gallery, wall_art.poster, wall_art.wall_clock)
            piece = self.one_of(*kinds)
            self.hang(piece, self.rng.uniform(1.4, 1.7) - float(piece.bounds()[1, 2]) / 2)
