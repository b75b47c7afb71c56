"""Cases that stand against walls: shelves with books, cabinets, dressers, wardrobes, nightstands."""

import numpy as np

from dsmap.sim_scenes.books import row_of_books
from dsmap.sim_scenes.looks import Looks
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.shapes import box, cylinder, rotation_x
from dsmap.sim_scenes.textures import Rng


def bookshelf(rng: Rng, looks: Looks) -> Assembly:
    """An open shelf of 3 to 5 boards with rows of books and room for things."""
    piece = Assembly("furniture")
    wood, width, depth = looks.case(), rng.uniform(0.75, 1.2), rng.uniform(0.27, 0.33)
    boards = int(rng.integers(3, 6))
    gap, thick = rng.uniform(0.32, 0.37), 0.024
    height = boards * gap + 0.08
    for side in (-1, 1):
        piece.add(box((thick, depth, height), (side * (width - thick) / 2, 0, 0)), wood)
    inner = width - 2 * thick
    piece.add(box((inner, 0.012, height), (0, depth / 2 - 0.007, 0)), wood)
    for k in range(boards + 1):
        z = 0.06 + k * gap - (thick if k == boards else 0)
        piece.add(box((inner, depth - 0.016, thick), (0, -0.004, z)), wood)
        if k == boards:
            continue
        z += thick
        if rng.random() < 0.85:
            piece.attach(row_of_books(rng, looks, inner - 0.02, gap - thick, 0.75), (0, -0.02, z))
        else:
            piece.surfaces.append(
                (-inner / 2 + 0.08, -depth / 2 + 0.04, inner / 2 - 0.08, depth / 2 - 0.06, z)
            )
    piece.surfaces.append(
        (-inner / 2 + 0.05, -depth / 2 + 0.04, inner / 2 - 0.05, depth / 2 - 0.04, height - 0.02)
    )
    return piece


def _fronts(
    piece: Assembly, looks: Looks, width: float, depth: float, z: float, height: float, grid: tuple[int, int]
) -> None:
    """Doors or drawer fronts on a case, `grid` = (rows, columns), each with a knob or a bar."""
    rows, columns = grid
    front, bar = looks.case(), looks.rng.random() < 0.5
    w, h = width / columns, height / rows
    for row in range(rows):
        for column in range(columns):
            x, low = (column + 0.5) * w - width / 2, z + row * h
            piece.add(box((w - 0.012, 0.018, h - 0.012), (x, -depth / 2 - 0.009, low + 0.006), 0.003), front)
            if bar:
                piece.add(
                    box((min(0.14, 0.4 * w), 0.025, 0.014), (x, -depth / 2 - 0.03, low + h * 0.72)),
                    looks.metal,
                )
            else:
                knob = cylinder(0.014, 0.025, sides=16).turned(rotation_x(np.pi / 2))
                side = 0.0 if rows > 1 or columns == 1 else (0.38 if column % 2 == 0 else -0.38) * w
                piece.add(knob.moved((x + side, -depth / 2 - 0.018, low + h * 0.6)), looks.metal)


def cabinet(
    rng: Rng, looks: Looks, width: float, depth: float, height: float, grid: tuple[int, int]
) -> Assembly:
    """A closed case on a plinth or feet with doors or drawers (rows, columns) and a top to stand things on."""
    piece = Assembly("furniture")
    wood, foot, top = looks.case(), rng.uniform(0.05, 0.14), 0.025
    if rng.random() < 0.5:
        piece.add(box((width - 0.06, depth - 0.08, foot), (0, 0.02, 0)), wood)
    else:
        for x in (-1, 1):
            for y in (-1, 1):
                piece.add(
                    cylinder(0.02, foot, (x * (width / 2 - 0.05), y * (depth / 2 - 0.05), 0), 16), looks.metal
                )
    piece.add(box((width, depth, height - foot - top), (0, 0, foot)), wood)
    piece.add(box((width + 0.02, depth + 0.02, top), (0, 0, height - top), 0.005), wood)
    _fronts(piece, looks, width - 0.02, depth, foot + 0.01, height - foot - top - 0.02, grid)
    piece.surfaces.append((-width / 2 + 0.04, -depth / 2 + 0.04, width / 2 - 0.04, depth / 2 - 0.04, height))
    return piece


def tv_cabinet(rng: Rng, looks: Looks) -> Assembly:
    """A long low cabinet for a television."""
    return cabinet(
        rng,
        looks,
        rng.uniform(1.3, 1.9),
        rng.uniform(0.38, 0.46),
        rng.uniform(0.42, 0.56),
        (1, int(rng.integers(3, 5))),
    )


def dresser(rng: Rng, looks: Looks) -> Assembly:
    """A chest of drawers."""
    grid = (int(rng.integers(3, 5)), int(rng.integers(1, 3)))
    return cabinet(rng, looks, rng.uniform(0.75, 1.2), rng.uniform(0.42, 0.5), rng.uniform(0.76, 0.95), grid)


def wardrobe(rng: Rng, looks: Looks) -> Assembly:
    """A wardrobe of two or three tall doors."""
    doors = int(rng.integers(2, 4))
    return cabinet(
        rng,
        looks,
        doors * rng.uniform(0.45, 0.55),
        rng.uniform(0.56, 0.62),
        rng.uniform(1.85, 2.1),
        (1, doors),
    )


def nightstand(rng: Rng, looks: Looks) -> Assembly:
    """A small case beside a bed."""
    return cabinet(
        rng,
        looks,
        rng.uniform(0.4, 0.52),
        rng.uniform(0.36, 0.44),
        rng.uniform(0.46, 0.58),
        (int(rng.integers(1, 3)), 1),
    )
