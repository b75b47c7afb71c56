"""Rules that rooms share: fill walls, put chairs to tables and desks, lay rugs, hang pictures."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from dsmap.sim_scenes import decor, furniture, storage, textures_art
from dsmap.sim_scenes.layout import Layout, Wall
from dsmap.sim_scenes.looks import Looks
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.shapes import Shape, box
from dsmap.sim_scenes.textures import Rng

RUG = 0.004
"""Thickness of a rug [m]: furniture stands on the floor through it."""
Make = Callable[..., Assembly]


@dataclass
class Furnisher:
    """One room being furnished."""

    rng: Rng
    looks: Looks
    layout: Layout

    def make(self, piece: Make, *args: float) -> Assembly:
        """A piece, which is called after the function that makes it."""
        made = piece(self.rng, self.looks, *args)
        made.name = made.name or piece.__name__
        return made

    def walls(self, first: int = 0, without: Sequence[int] = ()) -> list[Wall]:
        """The walls in random order, the ones before `first` in theirs."""
        order = [k for k in self.rng.permutation(4) if k not in without]
        return [self.layout.walls[k] for k in [*order[:first], *order[first:]]]

    def longest_free_wall(self, exclude: Sequence[int] = ()) -> int:
        """Number of a wall with much length free of doors and windows, with some luck in the choice."""
        score = []
        for k, wall in enumerate(self.layout.walls):
            taken = sum(b - a for a, b, z, _ in wall.busy if z < 1.2)
            score.append((-9 if k in exclude else 0) + wall.length - taken + self.rng.uniform(0, 0.8))
        return int(np.argmax(score))

    def fill(self, walls: Sequence[Wall], pieces: Iterable[Assembly]) -> list[Assembly]:
        """Stand pieces against whichever of the walls has room; returns those that found a place."""
        placed = []
        for piece in pieces:
            for k in self.rng.permutation(len(walls)):
                if self.layout.against(piece, walls[k]) is not None:
                    placed.append(piece)
                    break
        return placed

    def dining(self, seats: int = 4, tries: int = 60) -> bool:
        """A table with chairs pushed towards it, wherever the floor is free."""
        rng, layout = self.rng, self.layout
        width = rng.uniform(0.75, 0.95) if seats < 3 else rng.uniform(0.95, 1.4)
        depth = width if width < 1.15 else rng.uniform(0.75, 0.85)
        board = self.make(furniture.table, width, depth, rng.uniform(0.72, 0.76))
        board.name = "dining_table"
        for attempt in range(tries):
            yaw = rng.choice([0.0, np.pi / 2]) + rng.uniform(-0.06, 0.06)
            xy = rng.uniform(layout.room.low + 0.5, layout.room.high - 0.5)
            table = layout.stand(board, xy, yaw, room=0.5 if attempt < tries / 2 else 0.25)
            if table is not None:
                break
        else:
            return False
        for side in rng.permutation(4)[:seats]:
            seat = self.make(furniture.chair)
            angle = yaw + side * np.pi / 2
            reach = (depth if side % 2 == 0 else width) / 2 + rng.uniform(0.08, 0.22)
            at = xy + reach * np.array([np.sin(angle), -np.cos(angle)])
            layout.stand(seat, at, angle + np.pi + rng.uniform(-0.15, 0.15), ignore=[table])
        return True

    def desk(self, walls: Sequence[Wall], swivel: float = 0.6) -> bool:
        """A desk against a wall with a monitor, books and a chair before it."""
        rng, layout = self.rng, self.layout
        width, depth = rng.uniform(1.1, 1.5), rng.uniform(0.58, 0.7)
        desk = self.make(furniture.table, width, depth, rng.uniform(0.72, 0.76))
        desk.name = "desk"
        height = desk.surfaces[0][4]
        screen = decor.television(rng, self.looks, rng.uniform(0.5, 0.62))
        desk.attach(screen, (rng.uniform(-0.15, 0.15), 0.12, height), rng.uniform(-0.15, 0.15))
        row = storage.row_of_books(rng, self.looks, 0.3, 0.3)
        desk.attach(row, (rng.choice([-1, 1]) * (width / 2 - 0.22), depth / 2 - 0.14, height))
        for k in rng.permutation(len(walls)):
            x = layout.against(desk, walls[k])
            if x is None:
                continue
            table = layout.taken[-1]
            seat = self.make(furniture.office_chair if rng.random() < swivel else furniture.chair)
            for out in (0.36, 0.42, 0.5, 0.6):
                at = walls[k].point(x + rng.uniform(-0.15, 0.15), depth + out)
                if layout.stand(seat, at, walls[k].yaw + np.pi + rng.uniform(-0.4, 0.4), ignore=[table]):
                    break
            return True
        return False

    def rug(self, xy: np.ndarray, yaw: float, width: float, depth: float) -> None:
        """A printed rug on the floor."""
        plate = box((width, depth, RUG))
        uv = np.stack([plate.vertices[:, 0] / width + 0.5, 0.5 - plate.vertices[:, 1] / depth], 1)
        rug = Assembly("floor", name="rug")
        rug.add(
            Shape(plate.vertices, plate.faces, np.clip(uv, 0.003, 0.997)),
            self.looks.printed("rug", textures_art.rug(self.rng), 0.02),
        )
        yaw += self.rng.uniform(-0.04, 0.04)
        corners = self.layout.block(rug, np.asarray(xy, float), yaw).corners
        over = np.maximum(self.layout.room.low + 0.05 - corners, 0).max(0)
        over -= np.maximum(corners - self.layout.room.high + 0.05, 0).max(0)
        self.layout.scene.place(rug, (*(xy + over), 0.0), yaw, room=self.layout.index)

    def scatter(self, pieces: Iterable[Assembly]) -> None:
        """Leave things lying on the floor, mostly along the walls."""
        low, high = self.layout.room.low + 0.2, self.layout.room.high - 0.2
        for piece in pieces:
            for _ in range(20):
                xy = self.rng.uniform(low, high)
                if self.layout.stand(piece, xy, self.rng.uniform(-np.pi, np.pi)):
                    break

    def pictures(self, count: int) -> None:
        """Hang pictures at eye height."""
        for k in range(count):
            wall = self.layout.walls[(k + int(self.rng.integers(2))) % 4]
            piece = self.make(decor.picture)
            self.layout.hang(piece, wall, None, self.rng.uniform(1.45, 1.7) - float(piece.size()[2]) / 2)
