"""More tileable surfaces: stone, ceramics, parquet patterns, weaves, patterned carpets, metal, concrete.

Same rules as in `textures`: uint8 RGB of `SIZE` texels, and no detail finer than a few texels.
"""

from collections.abc import Callable

import cv2
import numpy as np

from dsmap.sim_scenes.textures.patterns import SIZE, Colour, fractal, grid, mixed, noise, shaded, to_bytes


def marble(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Polished marble: clouds and two generations of thin veins. One tile is about 1 m."""
    warp = 0.9 * fractal(rng, 2, 5)
    thick = np.exp(-np.abs(fractal(rng, 2, 4) + 0.3 * warp) * 14)
    thin = np.exp(-np.abs(fractal(rng, 4, 4) - 0.2 * warp) * 26)
    vein = np.asarray(colour) * (0.45 if np.mean(colour) > 0.4 else 1.9)
    return mixed(colour, np.clip(vein, 0, 0.95), 0.7 * thick + 0.35 * thin, 0.06 * warp)


def granite(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Speckled stone of three minerals, as worktops are. One tile is about 0.8 m."""
    grain = noise(rng, (96, 96)) + 0.6 * noise(rng, (56, 56))
    second, third = np.clip(np.asarray(colour) * 1.35, 0, 0.9), np.asarray(colour) * 0.6
    light, dark = (cv2.GaussianBlur(m.astype(np.float32), (0, 0), 0.9) for m in (grain > 0.55, grain < -0.7))
    image = mixed(colour, second, light, 0.08 * fractal(rng, 4, 4))
    return mixed(image / 255.0, third, dark)


def terrazzo(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Chips of stone in cement. One tile is about 0.8 m."""
    image = np.broadcast_to(np.asarray(colour, np.float32), (SIZE, SIZE, 3)).copy()
    tints = np.clip(
        np.asarray(colour) * rng.uniform(0.4, 1.3, (6, 1)) + rng.uniform(-0.12, 0.12, (6, 3)), 0.05, 0.95
    )
    for _ in range(260):
        centre, radius = rng.uniform(0, SIZE, 2), rng.uniform(3, 11)
        angles = np.sort(rng.uniform(0, 2 * np.pi, 6))
        chip = np.stack([np.cos(angles), np.sin(angles)], 1) * radius
        tint = tints[rng.integers(6)].tolist()
        for shift in np.array(np.meshgrid([-SIZE, 0, SIZE], [-SIZE, 0, SIZE])).T.reshape(-1, 2):
            at = centre + shift
            if (at > -12).all() and (at < SIZE + 12).all():
                cv2.fillConvexPoly(image, np.rint(chip + at).astype(np.int32), tint, cv2.LINE_AA)
    return to_bytes(image * (1 + 0.04 * fractal(rng, 6, 3)[..., None]))


def slate(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Rough stone slabs of unequal length in rows with wide joints. One tile is about 1.6 m."""
    y, x = grid()
    rows = 4
    row = np.floor(y * rows).astype(int)
    shift = rng.uniform(0, 1, rows)[row]
    counts = rng.integers(2, 4, rows)[row]
    column = np.floor(((x + shift) % 1) * counts)
    tone = rng.uniform(-0.2, 0.2, (rows, 4))[row, column.astype(int)]
    inside = np.minimum((y * rows) % 1, 1 - (y * rows) % 1) / rows
    across = ((x + shift) % 1 * counts) % 1
    inside = np.minimum(inside, np.minimum(across, 1 - across) / counts)
    joint = np.clip(1.5 - (inside + 0.002 * fractal(rng, 8, 3)) / 0.005, 0, 1)
    rough = 0.16 * fractal(rng, 5, 5) + 0.06 * noise(rng, (80, 80))
    return mixed(colour, (0.5, 0.48, 0.45), joint, tone + rough)


def ceramic(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Glazed wall tiles: square, laid across or in a running bond, some with an accent. One tile is about 0.8 m."""
    y, x = grid()
    rows, columns, shift = ((8, 8, 0.0), (10, 5, 0.5), (6, 6, 0.0), (8, 4, 0.5))[rng.integers(4)]
    row = np.floor(y * rows).astype(int)
    along = (x * columns + shift * (row % 2)) % columns
    column = np.floor(along).astype(int)
    tone = rng.uniform(-0.05, 0.05, (rows, columns))
    if rng.random() < 0.35:
        tone[rng.random((rows, columns)) < 0.12] -= rng.uniform(0.15, 0.4)
    edge_y = np.minimum((y * rows) % 1, 1 - (y * rows) % 1) / rows
    edge_x = np.minimum(along % 1, 1 - along % 1) / columns
    edge = np.minimum(edge_x, edge_y)
    joint = np.clip(1.6 - edge / 0.0035, 0, 1)
    rim = 0.12 * np.exp(-(((edge - 0.009) / 0.004) ** 2))  # the glaze catches light where it rounds off
    grout = (0.8, 0.79, 0.76) if rng.random() < 0.7 else (0.35, 0.34, 0.33)
    return mixed(colour, grout, joint, tone[row, column] + rim + 0.02 * fractal(rng, 6, 3))


def checker(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Floor tiles of two colours in turn. One tile is about 1.6 m."""
    y, x = grid()
    count = int(rng.choice([4, 6]))
    other = np.clip(np.asarray(colour) * rng.uniform(0.25, 0.6), 0.04, 0.9)
    weight = ((np.floor(y * count) + np.floor(x * count)) % 2).astype(np.float32)
    edge = np.minimum(np.abs((y * count + 0.5) % 1 - 0.5), np.abs((x * count + 0.5) % 1 - 0.5)) / count
    image = mixed(colour, other, weight, 0.06 * fractal(rng, 4, 5))
    return mixed(image / 255.0, (0.5, 0.49, 0.47), np.clip(1.5 - edge / 0.003, 0, 1))


def herringbone(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Parquet laid in an L pattern: each board's end meets the side of the next. One tile is about 1.2 m."""
    unit = 24  # texels a board is wide; it is four times as long
    cells = SIZE // unit
    column, row = np.meshgrid(np.arange(cells), np.arange(cells))
    step = (column - row) % 8  # four cells lying, four cells standing, along every diagonal
    lying = step < 4
    board = np.where(lying, (column - step) * 31 + row * 7, column * 13 + (row + step - 7) * 17 + 5)
    tones = rng.uniform(-0.2, 0.16, 997)
    tone = np.kron(tones[board % 997], np.ones((unit, unit)))
    edge = np.arange(unit)
    side = ((edge < 1) | (edge >= unit - 1)).astype(np.float32)
    joint = np.kron(lying, np.ones((unit, unit))) * np.tile(side[:, None], (cells, SIZE))
    joint += np.kron(~lying, np.ones((unit, unit))) * np.tile(side[None], (SIZE, cells))
    joint += np.kron(lying & (step == 0), np.ones((unit, unit))) * np.tile((edge < 2)[None], (SIZE, cells))
    joint += np.kron(~lying & (step == 4), np.ones((unit, unit))) * np.tile(
        (edge >= unit - 2)[:, None], (cells, SIZE)
    )
    grain = np.where(
        np.kron(lying, np.ones((unit, unit))) > 0, noise(rng, (SIZE // 3, 12)), noise(rng, (12, SIZE // 3))
    )
    return shaded(colour, tone + 0.09 * grain - 0.3 * np.clip(joint, 0, 1) + 0.05 * fractal(rng, 3, 3))


def concrete(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Cast or trowelled concrete: clouds, pores, a few hairlines. One tile is about 2 m."""
    pores = np.clip(noise(rng, (90, 90)) - 0.75, 0, 1)
    line = np.exp(-np.abs(fractal(rng, 2, 5)) * 60)
    return shaded(colour, 0.13 * fractal(rng, 2, 6) - 0.8 * pores - 0.08 * line)


def brushed(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Brushed metal: fine streaks along the columns. One tile is about 0.5 m."""
    streaks = 0.05 * noise(rng, (SIZE // 3, 3)) + 0.04 * noise(rng, (SIZE // 4, 8))
    return shaded(colour, streaks + 0.04 * fractal(rng, 2, 3))


def knit(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Coarse knitting: columns of slanted stitches. One tile is about 0.4 m."""
    y, x = grid()
    count = 22
    slant = y * count + np.abs((x * count) % 1 - 0.5)
    stitch = np.abs(np.sin(np.pi * slant)) ** 0.6 - 0.2 * (np.abs((x * count) % 1 - 0.5) > 0.42)
    return shaded(colour, 0.3 * (stitch - 0.7) + 0.08 * fractal(rng, 4, 4))


def corduroy(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Ribs along the rows' direction with a soft pile. One tile is about 0.4 m."""
    _, x = grid()
    ribs = np.abs(np.sin(np.pi * int(rng.integers(20, 36)) * x)) ** 0.7
    return shaded(colour, 0.28 * (ribs - 0.7) + 0.09 * fractal(rng, 3, 5) + 0.05 * noise(rng, (90, 90)))


def tweed(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Melange of light and dark yarn in a twill. One tile is about 0.5 m."""
    y, x = grid()
    twill = 0.12 * np.sign(np.sin(2 * np.pi * (40 * x + 40 * y)) + 0.4 * noise(rng, (64, 64)))
    flecks = np.clip(noise(rng, (100, 100)) - 0.5, 0, 1) - np.clip(-noise(rng, (100, 100)) - 0.55, 0, 1)
    return shaded(colour, twill + 0.6 * flecks + 0.06 * fractal(rng, 3, 3))


def plaid(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Tartan: bands of two further colours that cross. One tile is about 0.6 m."""
    y, x = grid()
    colour = np.asarray(colour, np.float32)
    image = np.broadcast_to(colour, (SIZE, SIZE, 3))
    repeat = int(rng.integers(2, 5))
    for _ in range(int(rng.integers(2, 4))):
        tint = np.clip(colour * rng.uniform(0.3, 1.7) + rng.uniform(-0.2, 0.2, 3), 0.05, 0.9).astype(
            np.float32
        )
        start, width = rng.uniform(0, 0.8), rng.uniform(0.05, 0.3)
        for line in (x, y):
            band = 0.5 * ((line * repeat - start) % 1 < width)[..., None].astype(np.float32)
            image = image + band * (tint - image)
    weave = 0.06 * np.sin(2 * np.pi * 60 * x) * np.sin(2 * np.pi * 60 * y)
    return to_bytes(image * (1 + (weave + 0.06 * fractal(rng, 4, 4))[..., None]))


def loop_pile(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Looped carpet: rows of knots with flecks of a second yarn. One tile is about 0.9 m."""
    y, x = grid()
    count = 60
    knots = 0.16 * np.sin(2 * np.pi * count * x + np.pi * np.floor(y * count)) * np.sin(2 * np.pi * count * y)
    flecks = (noise(rng, (72, 72)) > 0.6).astype(np.float32)
    other = np.clip(np.asarray(colour) * rng.choice([0.5, 1.5]), 0.05, 0.9)
    return mixed(colour, other, 0.7 * flecks, knots + 0.08 * fractal(rng, 3, 4))


def figured_carpet(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Fitted carpet with a woven repeat: lattice, dots, waves or blocks. One tile is about 1 m."""
    y, x = grid()
    n = int(rng.integers(4, 9))
    kind = rng.integers(4)
    if kind == 0:
        figure = np.minimum(np.abs(((x + y) * n) % 1 - 0.5), np.abs(((x - y) * n) % 1 - 0.5)) < 0.1
    elif kind == 1:
        figure = ((x * n) % 1 - 0.5) ** 2 + ((y * n + 0.5 * (np.floor(x * n) % 2)) % 1 - 0.5) ** 2 < 0.06
    elif kind == 2:
        figure = np.sin(2 * np.pi * (n * y + 0.2 * np.sin(2 * np.pi * n * x))) > 0.2
    else:
        count = 3 * n
        blocks = rng.random((count, count)) < 0.4
        figure = blocks[np.floor(y * count).astype(int), np.floor(x * count).astype(int)]
    other = np.clip(np.asarray(colour) * rng.uniform(0.45, 1.6) + rng.uniform(-0.08, 0.08, 3), 0.05, 0.9)
    weight = cv2.GaussianBlur(figure.astype(np.float32), (0, 0), 1.0)
    pile = 0.11 * noise(rng, (96, 96)) + 0.08 * noise(rng, (48, 48))
    return mixed(colour, other, weight, pile + 0.08 * fractal(rng, 3, 3))


def sprigs(rng: np.random.Generator, colour: Colour, second: Colour) -> np.ndarray:
    """Wallpaper or cloth with small leaves and blossoms strewn in rows. One tile is about 1 m."""
    image = np.broadcast_to(np.asarray(colour, np.float32), (SIZE, SIZE, 3)).copy()
    n = int(rng.integers(3, 6))
    step = SIZE / n
    petals, size, lean = int(rng.integers(3, 7)), rng.uniform(0.1, 0.2) * step, rng.uniform(0, 6.28)
    tint, stem = np.asarray(second, float), np.asarray(second, float) * 0.7
    for i in range(-1, n + 1):
        for j in range(-1, n + 1):
            at = (np.array([j + 0.5 * (i % 2), i]) + 0.5) * step
            for k in range(petals):
                angle = lean * (1 - 2 * (j % 2)) + 2 * np.pi * k / petals
                tip = at + size * np.array([np.cos(angle), np.sin(angle)])
                axes = (max(2, int(size * 0.75)), max(1, int(size * 0.3)))
                colour_now = (tint if k % 3 else stem).tolist()
                cv2.ellipse(
                    image, np.rint(tip).astype(int).tolist(), axes, float(np.degrees(angle)), 0, 360, colour_now, -1,
                    cv2.LINE_AA,
                )  # fmt: skip
    return to_bytes(image * (1 + (0.04 * fractal(rng, 6, 4) + 0.02 * noise(rng, (90, 90)))[..., None]))


def lattice(rng: np.random.Generator, colour: Colour, second: Colour) -> np.ndarray:
    """Wallpaper with a geometric net: diamonds, hexagons or arcs. One tile is about 1 m."""
    y, x = grid()
    n = int(rng.integers(4, 8))
    kind = rng.integers(3)
    if kind == 0:
        net = np.minimum(np.abs(((x + y) * n) % 1 - 0.5), np.abs(((x - y) * n) % 1 - 0.5)) < 0.07
    elif kind == 1:
        waves = [
            np.cos(2 * np.pi * (n * x)),
            np.cos(2 * np.pi * (n * x / 2 + n * y)),
            np.cos(2 * np.pi * (n * x / 2 - n * y)),
        ]
        net = np.sum(waves, 0) < -0.9
    else:
        u, v = (x * n + 0.5 * (np.floor(2 * y * n) % 2)) % 1 - 0.5, (2 * y * n) % 1
        net = np.abs(np.hypot(u, v) - 0.45) < 0.06
    weight = cv2.GaussianBlur(net.astype(np.float32), (0, 0), 0.8)
    return mixed(colour, second, weight, 0.04 * fractal(rng, 6, 4) + 0.02 * noise(rng, (90, 90)))


TILED_SURFACES: dict[str, tuple[Callable[..., np.ndarray], float]] = {
    "marble": (marble, 1.0), "granite": (granite, 0.8), "terrazzo": (terrazzo, 0.8), "slate": (slate, 1.6),
    "ceramic": (ceramic, 0.9), "checker": (checker, 1.6), "herringbone": (herringbone, 1.2),
    "concrete": (concrete, 2.0), "brushed": (brushed, 0.5), "knit": (knit, 0.4), "corduroy": (corduroy, 0.4),
    "tweed": (tweed, 0.5), "plaid": (plaid, 0.6), "loop_pile": (loop_pile, 0.9),
    "figured_carpet": (figured_carpet, 1.0),
}  # fmt: skip
"""Texture kind to (generator, metres that one tile spans)."""
