"""More shelves than `storage.bookshelf`: wide, cubes, on the wall, ladders, racks, folders (class furniture)."""

import numpy as np

from dsmap.sim_scenes.geometry.lofts import tub, tube
from dsmap.sim_scenes.geometry.shapes import box
from dsmap.sim_scenes.pieces.books import folders, row_of_books
from dsmap.sim_scenes.pieces.clutter import pick
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures import finishes
from dsmap.sim_scenes.textures.palette import Looks


def fill_board(
    rng: np.random.Generator,
    looks: Looks,
    piece: Assembly,
    board: tuple[float, float, float, float],
    gap: float,
    books: float,
) -> None:
    """Stand books on a board (x0, x1, y, z) below the next one `gap` above, or leave it free, with odds `books`.

    A free board, and one only half full, becomes a surface for other things.
    """
    x0, x1, y, z = board
    width = x1 - x0
    if width < 0.12 or rng.random() > books:
        piece.surfaces.append((x0 + 0.05, y - 0.09, x1 - 0.05, y + 0.09, z))
        return
    part = width - 0.02 if rng.random() < 0.75 or width < 0.6 else 0.55 * width
    row = row_of_books(rng, looks, part, gap, 0.8)
    left = rng.random() < 0.5
    x = x0 + 0.01 + part / 2 if left else x1 - 0.01 - part / 2
    piece.attach(row, (x, y - 0.01, z))
    if part < width - 0.1:
        free = (x + part / 2 + 0.04, x1 - 0.04) if left else (x0 + 0.04, x - part / 2 - 0.04)
        piece.surfaces.append((free[0], y - 0.09, free[1], y + 0.09, z))


def wide_bookcase(rng: np.random.Generator, looks: Looks, columns: int | None = None) -> Assembly:
    """A library wall of 2 to 4 columns and 5 or 6 boards, full of books."""
    piece, wood = Assembly("furniture"), looks.case()
    columns = int(rng.integers(2, 5)) if columns is None else columns
    boards, cell, gap = int(rng.integers(5, 7)), rng.uniform(0.55, 0.75), rng.uniform(0.31, 0.36)
    depth, thick = rng.uniform(0.27, 0.32), 0.024
    width, height = columns * cell + thick, boards * gap + 0.08 + thick
    piece.add(box((width - 0.004, 0.012, height - 0.01), (0, depth / 2 - 0.006, 0.004)), wood)
    for k in range(columns + 1):
        piece.add(box((thick, depth - 0.012, height), (k * cell - width / 2 + thick / 2, -0.006, 0)), wood)
    for column in range(columns):
        x0 = column * cell - width / 2 + thick
        x1 = x0 + cell - thick
        for k in range(boards + 1):
            z = 0.06 + k * gap
            piece.add(box((cell - thick, depth - 0.02, thick), ((x0 + x1) / 2, -0.002, z)), wood)
            if k < boards:
                fill_board(rng, looks, piece, (x0, x1, -0.01, z + thick), gap - thick, 0.9)
    top = 0.06 + boards * gap + thick
    piece.surfaces.append((-width / 2 + 0.08, -depth / 2 + 0.06, width / 2 - 0.08, depth / 2 - 0.06, top))
    return piece


def cube_shelf(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A grid of square compartments with books, baskets and things."""
    piece, wood = Assembly("furniture"), looks.case()
    columns, rows, cell, depth = int(rng.integers(2, 5)), int(rng.integers(2, 6)), 0.36, 0.39
    width, height = columns * cell + 0.04, rows * cell + 0.04
    for k in range(columns + 1):
        thick = 0.04 if k in (0, columns) else 0.018
        piece.add(box((thick, depth, height - 0.08), (k * cell - width / 2 + 0.02, 0, 0.04)), wood)
    for z in (0.0, height - 0.04):
        piece.add(box((width, depth, 0.04), (0, 0, z)), wood)
    basket = looks.thing() if rng.random() < 0.5 else looks.fabric()
    for column in range(columns):
        x = (column + 0.5) * cell - width / 2 + 0.02
        for row in range(rows):
            z = row * cell + (0.04 if row == 0 else 0.029)
            if row:
                piece.add(box((cell - 0.018, depth - 0.003, 0.018), (x, 0, z - 0.018)), wood)
            kind = rng.choice(3, p=[0.55, 0.25, 0.2])
            if kind == 1:
                bin_ = Assembly("objects", name="bin")
                bin_.add(tub((0.31, 0.35, 0.29), 0.008, 0.01, corner=0.1), basket)
                piece.attach(bin_, (x, -0.005, z))
            else:
                fill_board(rng, looks, piece, (x - 0.16, x + 0.16, -0.06, z), 0.32, 1.0 if kind == 0 else 0.0)
    piece.surfaces.append((-width / 2 + 0.06, -depth / 2 + 0.06, width / 2 - 0.06, depth / 2 - 0.06, height))
    return piece


def wall_shelf(rng: np.random.Generator, looks: Looks) -> Assembly:
    """One to three boards on the wall with books and things; hang it at eye height."""
    piece, wood = Assembly("furniture"), looks.case()
    width, depth, gap = rng.uniform(0.6, 1.2), rng.uniform(0.2, 0.26), rng.uniform(0.32, 0.4)
    for k in range(int(rng.integers(1, 4))):
        z = 0.12 + k * gap
        piece.add(box((width, depth, 0.026), (0, 0, z), 0.003), wood)
        for side in (-1, 1):
            x = side * (width / 2 - 0.1)
            piece.add(box((0.02, 0.012, 0.12), (x, depth / 2 - 0.006, z - 0.12)), looks.metal)
            piece.add(tube([(x, depth / 2 - 0.01, z - 0.11), (x, -0.04, z - 0.004)], 0.007, 6), looks.metal)
        fill_board(rng, looks, piece, (-width / 2 + 0.02, width / 2 - 0.02, 0.01, z + 0.026), gap - 0.1, 0.75)
    return piece


def ladder_shelf(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A leaning frame whose boards grow deeper downwards."""
    piece, wood, metal = Assembly("furniture"), looks.wood(), finishes.dark(looks)
    width, height, boards = rng.uniform(0.55, 0.8), rng.uniform(1.6, 1.85), int(rng.integers(4, 6))
    back = 0.22
    for side in (-1, 1):
        x = side * (width / 2 - 0.012)
        piece.add(tube([(x, -0.22, 0.01), (x, back - 0.02, height)], 0.012, 8), metal)
        piece.add(tube([(x, back - 0.012, 0.0), (x, back - 0.012, height)], 0.012, 8), metal)
    for k in range(boards):
        z = 0.15 + k * (height - 0.45) / (boards - 1)
        front = -0.22 + (back + 0.2) * z / height
        deep = back - 0.026 - front
        piece.add(box((width - 0.05, deep, 0.02), (0, front + deep / 2, z)), wood)
        if deep > 0.18 and k < boards - 1:
            gap = (height - 0.45) / (boards - 1) - 0.03
            fill_board(
                rng, looks, piece, (-width / 2 + 0.05, width / 2 - 0.05, back - 0.12, z + 0.02), gap, 0.5
            )
        elif deep > 0.12:
            piece.surfaces.append((-width / 2 + 0.06, front + 0.02, width / 2 - 0.06, back - 0.05, z + 0.02))
    return piece


def open_rack(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A metal or wooden utility rack with boxes, baskets and tins."""
    piece = Assembly("furniture")
    metal = finishes.steel(looks) if rng.random() < 0.6 else looks.wood()
    width, depth, height = rng.uniform(0.75, 1.0), rng.uniform(0.34, 0.45), rng.uniform(1.5, 1.9)
    boards = int(rng.integers(4, 6))
    for x in (-1, 1):
        for y in (-1, 1):
            piece.add(box((0.03, 0.03, height), (x * (width / 2 - 0.015), y * (depth / 2 - 0.015), 0)), metal)
    for k in range(boards):
        z = 0.1 + k * (height - 0.15) / (boards - 1)
        piece.add(box((width - 0.01, depth - 0.01, 0.02), (0, 0, z - 0.02), 0.002), metal)
        x = -width / 2 + 0.22
        while x < width / 2 - 0.2 and k < boards - 1:
            if rng.random() < 0.6:
                thing = pick(rng, looks, "shelf")
                low, high = thing.bounds()
                if (
                    np.ptp([low[:2], high[:2]], axis=0).max() < 0.36
                    and high[2] < (height - 0.2) / (boards - 1) - 0.04
                ):
                    piece.attach(thing, (x, 0, z), 0.0)
            x += 0.38
    piece.surfaces.append(
        (-width / 2 + 0.08, -depth / 2 + 0.08, width / 2 - 0.08, depth / 2 - 0.08, height - 0.05)
    )
    return piece


def folder_shelf(rng: np.random.Generator, looks: Looks) -> Assembly:
    """An office shelf with ring binders, books and paper trays."""
    piece, wood = Assembly("furniture"), looks.case()
    width, depth, gap, boards = rng.uniform(0.8, 1.1), 0.36, 0.37, int(rng.integers(3, 6))
    height = boards * gap + 0.03
    for side in (-1, 1):
        piece.add(box((0.022, depth, height), (side * (width / 2 - 0.011), 0, 0)), wood)
    piece.add(box((width - 0.044, 0.01, height - 0.02), (0, depth / 2 - 0.006, 0.01)), wood)
    for k in range(boards + 1):
        z = k * gap + 0.005
        piece.add(box((width - 0.044, depth - 0.014, 0.022), (0, -0.006, z)), wood)
        if k == boards:
            break
        half, floor = width / 2 - 0.04, z + 0.022
        if rng.random() < 0.65:
            piece.attach(folders(rng, looks, 2 * half, gap - 0.03), (0, -0.02, floor))
        else:
            fill_board(rng, looks, piece, (-half, half, -0.03, floor), gap - 0.03, 0.7)
    top = boards * gap + 0.027
    piece.surfaces.append((-width / 2 + 0.08, -depth / 2 + 0.06, width / 2 - 0.08, depth / 2 - 0.06, top))
    return piece
