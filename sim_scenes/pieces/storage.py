"""Cases that stand against walls: shelves with books, cabinets, dressers, wardrobes, nightstands."""

import numpy as np

from dsmap.sim_scenes.geometry.lofts import tub
from dsmap.sim_scenes.geometry.shapes import box, cylinder, panel, rotation_x
from dsmap.sim_scenes.pieces.books import row_of_books
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures import finishes
from dsmap.sim_scenes.textures.palette import Looks


def bookshelf(rng: np.random.Generator, looks: Looks) -> Assembly:
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
    front = looks.upright(front) if h > 1.2 else front
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
    rng: np.random.Generator, looks: Looks, width: float, depth: float, height: float, grid: tuple[int, int]
) -> Assembly:
    """A closed case on a plinth or feet with doors or drawers (rows, columns) and a top to stand things on."""
    piece = Assembly("furniture")
    wood, foot, top = looks.case(), rng.uniform(0.05, 0.14), 0.025
    wood = looks.upright(wood) if height > 1.5 else wood
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


def tv_cabinet(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A long low cabinet for a television."""
    return cabinet(
        rng,
        looks,
        rng.uniform(1.3, 1.9),
        rng.uniform(0.38, 0.46),
        rng.uniform(0.42, 0.56),
        (1, int(rng.integers(3, 5))),
    )


def dresser(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A chest of drawers."""
    grid = (int(rng.integers(3, 5)), int(rng.integers(1, 3)))
    return cabinet(rng, looks, rng.uniform(0.75, 1.2), rng.uniform(0.42, 0.5), rng.uniform(0.76, 0.95), grid)


def wardrobe(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A wardrobe of two or three tall hinged doors, or of two sliding ones, sometimes with a mirror."""
    doors = int(rng.integers(2, 4))
    if rng.random() < 0.65:
        width, depth = doors * rng.uniform(0.45, 0.55), rng.uniform(0.56, 0.62)
        piece = cabinet(rng, looks, width, depth, rng.uniform(1.85, 2.1), (1, doors))
        if rng.random() < 0.25:
            glass = panel(0.6 * width / doors, 1.4, 0.006)
            piece.add(glass.moved((0, -depth / 2 - 0.0215, 0.3)), finishes.mirror_glass(looks), "objects")
        return piece
    return _sliding_wardrobe(rng, looks)


def _sliding_wardrobe(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A wide wardrobe whose two doors slide past each other."""
    piece = Assembly("furniture")
    width, depth, height = rng.uniform(1.5, 2.1), rng.uniform(0.6, 0.66), rng.uniform(2.0, 2.2)
    wood, rail = looks.upright(looks.case()), finishes.steel(looks)
    piece.add(box((width, depth - 0.08, height), (0, 0.04, 0)), wood)
    front = -depth / 2
    for z, thick in ((0.0, 0.06), (height - 0.05, 0.05)):
        piece.add(box((width, 0.08, thick), (0, front + 0.04, z)), wood)
    door, tall = width / 2 + 0.02, height - 0.11
    for k, side in enumerate((-1, 1)):
        y, x = front + (0.018, 0.05)[k], side * (width / 2 - door / 2)
        piece.add(
            box((door, 0.022, tall), (x, y, 0.06)),
            looks.upright(looks.case()) if k or rng.random() < 0.5 else wood,
        )
        if rng.random() < 0.35:
            mirror = panel(door - 0.08, tall - 0.08, 0.004).moved((x, y - 0.0125, 0.1))
            piece.add(mirror, finishes.mirror_glass(looks), "objects")
        for edge in (-1, 1):
            piece.add(box((0.028, 0.028, tall), (x + edge * (door / 2 - 0.013), y, 0.06)), rail)
    piece.surfaces.append((-width / 2 + 0.05, -depth / 2 + 0.14, width / 2 - 0.05, depth / 2 - 0.05, height))
    return piece


def sideboard(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A long waist-high cabinet of doors, or of doors and drawers."""
    grid = (int(rng.integers(1, 3)), int(rng.integers(2, 5)))
    return cabinet(rng, looks, rng.uniform(1.2, 1.8), rng.uniform(0.38, 0.46), rng.uniform(0.72, 0.9), grid)


def filing_cabinet(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A steel cabinet of 2 to 4 drawers with label holders and pulls."""
    piece, drawers = Assembly("furniture"), int(rng.integers(2, 5))
    width, depth, step = rng.uniform(0.38, 0.47), rng.uniform(0.5, 0.62), rng.uniform(0.29, 0.33)
    height = drawers * step + 0.06
    paint = looks.tiled(
        "plain", ((0.6, 0.61, 0.62), (0.25, 0.26, 0.28), (0.75, 0.73, 0.68), (0.4, 0.45, 0.42))
    )
    piece.add(box((width, depth - 0.02, height), (0, 0.01, 0), 0.004), paint)
    for k in range(drawers):
        low = 0.04 + k * step
        piece.add(box((width - 0.03, 0.02, step - 0.012), (0, -depth / 2 + 0.002, low), 0.003), paint)
        piece.add(box((0.13, 0.022, 0.018), (0, -depth / 2 - 0.016, low + 0.62 * step)), looks.metal)
        piece.add(
            box((0.08, 0.004, 0.035), (0, -depth / 2 - 0.0095, low + 0.76 * step)), finishes.paper(looks)
        )
    half = width / 2 - 0.04
    piece.surfaces.append((-half, -depth / 2 + 0.06, half, depth / 2 - 0.04, height))
    return piece


def pedestal(rng: np.random.Generator, looks: Looks, depth: float, height: float) -> Assembly:
    """Three drawers that stand under a desk."""
    piece, front = Assembly("furniture"), looks.case()
    piece.add(box((0.42, depth - 0.02, height - 0.02), (0, 0.01, 0.02)), front)
    for low, tall in ((0.03, 0.45), (0.48, 0.26), (0.74, 0.24)):
        low, tall = 0.02 + low * (height - 0.04), tall * (height - 0.04) - 0.008
        piece.add(box((0.41, 0.018, tall), (0, -depth / 2 + 0.002, low), 0.002), front)
        piece.add(box((0.12, 0.02, 0.014), (0, -depth / 2 - 0.016, low + 0.7 * tall)), looks.metal)
    return piece


def toy_chest(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A low open rack with coloured bins."""
    piece = Assembly("furniture")
    columns, rows, cell = int(rng.integers(2, 4)), int(rng.integers(2, 4)), rng.uniform(0.3, 0.36)
    width, height, depth, wood = columns * cell + 0.02, rows * 0.24 + 0.02, 0.4, looks.case()
    for k in range(columns + 1):
        piece.add(box((0.02, depth, height), (k * cell - width / 2 + 0.01, 0, 0)), wood)
    for k in range(columns):
        x = (k + 0.5) * cell - width / 2 + 0.01
        for row in range(rows + 1):
            piece.add(box((cell - 0.02, depth - 0.004, 0.018), (x, 0, row * 0.24)), wood)
            if row < rows and rng.random() < 0.15:
                piece.surfaces.append((x - 0.1, -0.14, x + 0.1, 0.14, row * 0.24 + 0.018))
            elif row < rows:
                bin_ = Assembly("objects", name="bin")
                bin_.add(
                    tub((cell - 0.04, depth - 0.05, rng.uniform(0.12, 0.19)), 0.006, 0.006, corner=0.12),
                    looks.thing(),
                )
                piece.attach(bin_, (x, -0.01, row * 0.24 + 0.018))
    piece.surfaces.append(
        (-width / 2 + 0.05, -depth / 2 + 0.05, width / 2 - 0.05, depth / 2 - 0.05, height - 0.002)
    )
    return piece


def nightstand(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A small case beside a bed."""
    return cabinet(
        rng,
        looks,
        rng.uniform(0.4, 0.52),
        rng.uniform(0.36, 0.44),
        rng.uniform(0.46, 0.58),
        (int(rng.integers(1, 3)), 1),
    )
