"""Books: upright, leaning and lying rows that fill shelf boards, stacks for tables (class books)."""

import numpy as np

from dsmap.sim_scenes.geometry.shapes import Shape, box, merged
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures import art, finishes
from dsmap.sim_scenes.textures.palette import Looks

COVERS = 6
"""Covers side by side in one image, shared by all lying books of a room."""
LYING = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Turns an upright book onto its side: its spine still faces -y."""


def book(rng: np.random.Generator, thickness: float, height: float, depth: float) -> Shape:
    """An upright book, spine towards -y, its uv on one spine of the atlas `textures_art.spines`."""
    shape = box((thickness, depth, height))
    k = rng.integers(art.SPINES)
    u = (k + 0.08 + 0.84 * (shape.vertices[:, 0] / thickness + 0.5)) / art.SPINES
    return Shape(shape.vertices, shape.faces, np.stack([u, 0.98 - 0.96 * shape.vertices[:, 2] / height], 1))


def covered_box(
    rng: np.random.Generator, looks: Looks, width: float, depth: float, thickness: float
) -> list[tuple[Shape, str]]:
    """A lying book or magazine: pages (bottom centre at the origin) under a printed cover, as (shape, material)."""
    atlas = finishes.known(looks, "covers")
    if atlas is None:
        images = [art.cover(rng) for _ in range(COVERS)]
        atlas = looks.printed("covers", np.concatenate(images, 1))
    lid = box((width, depth, 0.002), (0, 0, thickness - 0.002))
    unit = np.stack([lid.vertices[:, 0] / width + 0.5, 0.5 - lid.vertices[:, 1] / depth], 1)
    unit = np.clip(unit, 0.02, 0.98)
    unit[:, 0] = (unit[:, 0] + rng.integers(COVERS)) / COVERS
    pages = box((width - 0.004, depth - 0.004, thickness - 0.002))
    return [(pages, finishes.paper(looks)), (Shape(lid.vertices, lid.faces, unit), atlas)]


def row_of_books(
    rng: np.random.Generator, looks: Looks, width: float, height: float, full: float = 0.55
) -> Assembly:
    """Books from -width/2 that fill `full` .. 1 of a board: upright groups, leaning ones, now and then a lying pile."""
    row = Assembly("books")
    tallest = height - 0.02
    shapes, x, end = [], -width / 2, width * (rng.uniform(full, 1.0) - 0.5)
    usual, deep = rng.uniform(0.19, 0.26), rng.uniform(0.14, 0.19)
    while end - x > 0.06:
        kind = rng.choice(3, p=[0.66, 0.19, 0.15]) if x > -width / 2 else 0
        if kind == 2 and end - x > 0.27:
            x = _lying_pile(rng, shapes, x + 0.005, deep, tallest)
        elif kind == 1 and end - x > 0.2:
            x = _leaning(rng, shapes, x, min(tallest, 0.92 * usual), deep)
        else:
            x = _upright(rng, shapes, x, min(end, x + rng.uniform(0.12, 0.5)), usual, deep, tallest)
    row.add(merged(shapes), looks.spines)
    return row


def _upright(
    rng: np.random.Generator,
    shapes: list[Shape],
    x: float,
    end: float,
    usual: float,
    deep: float,
    tallest: float,
) -> float:
    """Add upright books from x to `end`; a third of the time one series of equal books. Returns where they end."""
    series = rng.random() < 0.3
    thick, tall = rng.uniform(0.02, 0.045), usual * rng.uniform(0.85, 1.1)
    start = x
    while True:
        if not series:
            thick = rng.uniform(0.012, 0.032) if rng.random() < 0.7 else rng.uniform(0.03, 0.055)
            tall = usual * rng.uniform(0.8, 1.25)
        if x + thick > end and x > start:
            return x
        upright = book(rng, thick, min(tall, tallest), deep * (1 if series else rng.uniform(0.85, 1.1)))
        shapes.append(upright.moved((x + thick / 2, rng.uniform(-0.012, 0.012), 0)))
        x += thick + 0.0008


def _leaning(rng: np.random.Generator, shapes: list[Shape], x: float, tall: float, deep: float) -> float:
    """Add one to three books that lean to the left against what ends at x. Returns where they end."""
    angle = rng.uniform(0.12, 0.3)
    c, s = np.cos(angle), np.sin(angle)
    lean = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    foot = x + tall * s
    for _ in range(int(rng.integers(1, 4))):
        thick = rng.uniform(0.015, 0.04)
        shape = book(rng, thick, tall, deep).moved((thick / 2, 0, 0)).turned(lean)
        shapes.append(shape.moved((foot, rng.uniform(-0.01, 0.01), 0)))
        foot += thick / c + 0.001
    return foot + 0.02


def _lying_pile(
    rng: np.random.Generator, shapes: list[Shape], x: float, deep: float, tallest: float
) -> float:
    """Add a pile of lying books. Returns where it ends."""
    z, widest = 0.0, 0.0
    for _ in range(int(rng.integers(2, 6))):
        thick, tall = rng.uniform(0.015, 0.04), rng.uniform(0.19, 0.25)
        if z + thick > 0.8 * tallest:
            break
        shape = book(rng, thick, tall, deep).turned(LYING)
        low = shape.bounds()[0]
        shapes.append(shape.moved((x - low[0], rng.uniform(-0.01, 0.01), z - low[2])))
        z, widest = z + thick + 0.0005, max(widest, tall)
    return x + widest + 0.005


def pile_of_books(rng: np.random.Generator, looks: Looks, count: int) -> Assembly:
    """A few books lying on each other; the top one shows its cover."""
    pile, z = Assembly("books"), 0.0
    for k in range(count):
        thick, tall, depth = rng.uniform(0.015, 0.045), rng.uniform(0.2, 0.28), rng.uniform(0.14, 0.2)
        yaw, shift = rng.uniform(-0.25, 0.25), (*rng.uniform(-0.012, 0.012, 2), z)
        lying = book(rng, thick, tall, depth).turned(LYING)
        low, high = lying.bounds()
        lying = lying.moved((-(low[0] + high[0]) / 2, 0, -low[2]))
        pile.add(lying.moved(shift, yaw), looks.spines)
        z += thick
        if k == count - 1:
            cover = covered_box(rng, looks, depth * 0.99, tall * 0.99, 0.004)[1]
            quarter = cover[0].moved((0, 0, -0.002), np.pi / 2)
            pile.add(quarter.moved((*shift[:2], z), yaw), cover[1])
    return pile


def magazine_stack(rng: np.random.Generator, looks: Looks) -> Assembly:
    """One to six magazines or newspapers lying on each other."""
    piece, z = Assembly("books"), 0.0
    for _ in range(int(rng.integers(1, 7))):
        thick = rng.uniform(0.005, 0.012)
        shift, yaw = (*rng.uniform(-0.015, 0.015, 2), z), rng.uniform(-0.25, 0.25)
        for shape, material in covered_box(rng, looks, 0.21, 0.285, thick):
            piece.add(shape.moved(shift, yaw), material)
        z += thick
    return piece


def folders(rng: np.random.Generator, looks: Looks, width: float, height: float) -> Assembly:
    """A row of ring binders from -width/2, in a few colours with white labels."""
    row, x = Assembly("books", name="folders"), -width / 2
    colours = [looks.thing() for _ in range(int(rng.integers(1, 4)))]
    tall, end = min(0.32, height - 0.02), width * (rng.uniform(0.6, 1.0) - 0.5)
    while x + 0.08 < end:
        thick = 0.075 if rng.random() < 0.7 else 0.05
        row.add(box((thick - 0.002, 0.26, tall), (x + thick / 2, 0, 0)), colours[rng.integers(len(colours))])
        row.add(box((0.7 * thick, 0.002, 0.16), (x + thick / 2, -0.131, 0.1)), finishes.paper(looks))
        x += thick
    if not row.parts:
        row.add(box((0.073, 0.26, tall), (x + 0.04, 0, 0)), colours[0])
    return row
