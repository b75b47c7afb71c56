"""Beds with bedding (class bed; pillows and what lies on them are objects): single, double, bunk, cot, sofa-like.

Headboards are at +y, the foot looks into the room (-y).
"""

import numpy as np

from dsmap.sim_scenes.geometry.lofts import tube
from dsmap.sim_scenes.geometry.shapes import Shape, box, cushion, rotation_x, sheet
from dsmap.sim_scenes.pieces.soft_goods import pillow, throw_cushion
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures import finishes
from dsmap.sim_scenes.textures.palette import Looks
from dsmap.sim_scenes.textures.patterns import noise

WIDTHS = (0.9, 0.95, 1.2, 1.4, 1.6, 1.8)
"""Of mattresses [m]."""


def bed(rng: np.random.Generator, looks: Looks, width: float | None = None) -> Assembly:
    """A single or double bed: frame or upholstered base, headboard, mattress, made or rumpled bedding, pillows."""
    piece = Assembly("bed")
    width, length = float(rng.choice(WIDTHS)) if width is None else width, rng.uniform(1.98, 2.08)
    wood, linen = looks.wood(), looks.fabric()
    rail, lying = rng.uniform(0.26, 0.34), rng.uniform(0.46, 0.56)
    if rng.random() < 0.35:
        piece.add(box((width + 0.04, length + 0.02, rail - 0.05), (0, 0, 0.05), 0.02), looks.fabric())
        piece.add(box((width - 0.1, length - 0.1, 0.05), (0, 0, 0)), finishes.dark(looks))
    else:
        piece.add(box((width + 0.06, length + 0.04, 0.16), (0, 0, rail - 0.16), 0.012), wood)
        for x in (-1, 1):
            for y in (-1, 1):
                at = (x * (width / 2 - 0.06), y * (length / 2 - 0.06), 0)
                piece.add(box((0.07, 0.07, rail - 0.15), at), wood)
    _headboard(rng, looks, piece, width, length, rail, wood)
    if rng.random() < 0.25:
        piece.add(box((width + 0.06, 0.045, 0.3), (0, -length / 2 - 0.02, rail - 0.05), 0.01), wood)
    piece.add(cushion((width, length, lying - rail + 0.02), (0, -0.01, rail - 0.02), 0.1), linen)
    _bedding(rng, looks, piece, width, length, lying, rail)
    return piece


def _headboard(
    rng: np.random.Generator,
    looks: Looks,
    piece: Assembly,
    width: float,
    length: float,
    rail: float,
    wood: str,
) -> None:
    """Padded, panelled, of bars, or none."""
    kind, head, y = int(rng.choice(4, p=[0.35, 0.3, 0.25, 0.1])), rng.uniform(0.85, 1.2), length / 2
    if kind == 0:
        cloth = finishes.leather(looks) if rng.random() < 0.3 else looks.fabric()
        piece.add(box((width + 0.1, 0.09, head - 0.08), (0, y + 0.06, 0.08), 0.03), cloth)
    elif kind == 1:
        piece.add(box((width + 0.08, 0.045, head - 0.15), (0, y + 0.043, 0.15), 0.012), wood)
        for z in np.linspace(rail + 0.3, head - 0.14, 3):
            piece.add(box((width - 0.12, 0.02, 0.1), (0, y + 0.0105, z), 0.006), wood)
    elif kind == 2:
        metal = finishes.dark(looks) if rng.random() < 0.6 else wood
        for side in (-1, 1):
            piece.add(
                tube(
                    [(side * (width / 2 + 0.01), y + 0.045, 0), (side * (width / 2 + 0.01), y + 0.045, head)],
                    0.02,
                ),
                metal,
            )
        for z in (rail + 0.15, head - 0.03):
            piece.add(tube([(-width / 2, y + 0.045, z), (width / 2, y + 0.045, z)], 0.015), metal)
        for x in np.linspace(-width / 2, width / 2, int(width / 0.12))[1:-1]:
            piece.add(tube([(x, y + 0.045, rail + 0.15), (x, y + 0.045, head - 0.03)], 0.008, 8), metal)


def _bedding(
    rng: np.random.Generator,
    looks: Looks,
    piece: Assembly,
    width: float,
    length: float,
    lying: float,
    rail: float,
) -> None:
    """A blanket that covers most of the mattress (made), or is pushed aside (rumpled), and pillows at the head."""
    count = 1 if width < 1.2 else 2
    cover = looks.fabric()
    if rng.random() < 0.65:
        long = length * rng.uniform(0.62, 0.8)
        spread = blanket(rng, width + 0.1, long, lying, rng.uniform(rail - 0.08, lying - 0.1))
        piece.add(spread.moved((0, -length / 2 + long / 2 - 0.02, 0)), cover)
        if rng.random() < 0.4:
            fold = cushion((width + 0.06, 0.3, 0.09), (0, -length / 2 + long - 0.08, lying + 0.012), 0.3)
            piece.add(fold, looks.fabric())
        elif rng.random() < 0.35:
            runner = blanket(rng, width + 0.15, 0.55, lying + 0.035, lying - 0.12)
            piece.add(runner.moved((0, -length / 2 + 0.35, 0)), looks.fabric())
    else:
        long = length * rng.uniform(0.45, 0.65)
        pushed = rumpled(rng, width * rng.uniform(0.85, 1.0), long)
        piece.add(pushed.moved((rng.uniform(-0.04, 0.04), rng.uniform(-0.3, -0.1) * long, lying)), cover)
    deep = 1 + int(rng.random() < 0.3)
    for k in range(count):
        x = (k - (count - 1) / 2) * width / 2 + rng.uniform(-0.03, 0.03)
        for layer in range(deep):
            soft = pillow(rng, looks)
            at = (x, length / 2 - 0.25 - 0.12 * layer, lying + 0.01 + 0.13 * layer)
            piece.attach(soft, at, rng.uniform(-0.12, 0.12))
    for _ in range(int(rng.integers(0, 3)) if count == 2 else 0):
        at = (rng.uniform(-0.3, 0.3) * width, length / 2 - 0.6, lying + 0.03)
        piece.attach(throw_cushion(rng, looks, upright=True), at, rng.uniform(-0.2, 0.2))
    piece.surfaces.append((-0.36 * width, -0.42 * length, 0.36 * width, 0.12 * length, lying + 0.05))


def blanket(rng: np.random.Generator, width: float, length: float, top: float, bottom: float) -> Shape:
    """A blanket that lies on a mattress (`top`) and hangs down to `bottom` [m] on both sides, with wrinkles."""
    drop, half = top - bottom, width / 2
    across = np.concatenate([
        np.linspace(-half - drop, -half, 8)[:-1], np.linspace(-half, half, 33), np.linspace(half, half + drop, 8)[1:],
    ])  # fmt: skip
    along = np.linspace(-length / 2, length / 2, 40)
    hang = np.clip(np.abs(across) - half, 0, None)
    size = (len(along), len(across))
    x = np.sign(across) * (np.minimum(np.abs(across), half) + 0.012 * np.minimum(hang / 0.03, 1))
    bump = 0.018 * noise(rng, (9, 11), size) + 0.009 * noise(rng, (18, 20), size)
    falls = np.sin(along * rng.uniform(14, 22))[:, None] * 0.018 / (1 + np.exp(-(hang - 0.04) / 0.01))
    points = np.empty((*size, 3))
    points[..., 0] = x + np.sign(across) * falls
    points[..., 1] = along[:, None]
    points[..., 2] = top + 0.03 - hang + np.where(hang > 0, 0.2, 1.0) * (bump + 0.012)
    return sheet(points, 0.012)


def rumpled(rng: np.random.Generator, width: float, length: float) -> Shape:
    """A blanket thrown back on a bed (z = 0): ragged outline, one end pulled askew, long folds across."""
    rows, columns = 34, 30
    s, t = np.meshgrid(np.linspace(-0.5, 0.5, columns), np.linspace(-0.5, 0.5, rows))
    ragged = 0.12 * noise(rng, (4, 4), (rows, columns))
    turn, skew = rng.uniform(-0.35, 0.35), rng.uniform(-0.25, 0.25)
    folds = np.abs(noise(rng, (9, 4), (rows, columns))) + 0.5 * np.abs(noise(rng, (14, 9), (rows, columns)))
    rim = np.clip(np.minimum(0.5 - np.abs(s), 0.5 - np.abs(t)) / 0.12, 0, 1) ** 0.5
    slope = 0.06 * (1 + np.clip(3 * t, 0, 1))
    points = np.empty((rows, columns, 3))
    points[..., 0] = width * np.clip(s * (1 - 0.2 * np.abs(t)) + ragged * 0.4 + 0.2 * turn * t, -0.5, 0.5)
    points[..., 1] = length * (t + skew * s + ragged * 0.5)
    points[..., 2] = 0.012 + rim * (0.02 + slope * (0.35 + folds))
    return sheet(points, 0.012)


def bunk_bed(rng: np.random.Generator, looks: Looks) -> Assembly:
    """Two single beds over each other with rails and a ladder."""
    piece, wood = Assembly("bed"), looks.wood() if rng.random() < 0.6 else finishes.steel(looks)
    width, length, height = rng.uniform(0.9, 1.0), 2.0, rng.uniform(1.6, 1.75)
    post = 0.07
    for x in (-1, 1):
        for y in (-1, 1):
            piece.add(box((post, post, height), (x * (width + post) / 2, y * (length + post) / 2, 0)), wood)
    for z in (0.28, height - 0.45):
        for side in (-1, 1):
            piece.add(box((0.03, length, 0.12), (side * (width / 2 + 0.03), 0, z)), wood)
            piece.add(box((width, 0.03, 0.12), (0, side * (length / 2 + 0.03), z)), wood)
        piece.add(box((width, length, 0.03), (0, 0, z + 0.02)), wood)
        piece.add(cushion((width - 0.02, length - 0.02, 0.15), (0, 0, z + 0.05), 0.1), looks.fabric())
        lying = z + 0.2
        if rng.random() < 0.7:
            cover = blanket(rng, width - 0.12, 1.3, lying - 0.015, lying - 0.05)
            piece.add(cover.moved((0, -0.3, 0)), looks.fabric())
        else:
            piece.add(rumpled(rng, 0.75, 0.9).moved((0, -0.2, lying - 0.02)), looks.fabric())
        piece.attach(pillow(rng, looks), (0, length / 2 - 0.25, lying))
    for z in (height - 0.16, height - 0.05):
        for side in (-1, 1):
            piece.add(box((0.024, length, 0.05), (side * (width / 2 + 0.03), 0, z)), wood)
            piece.add(box((width, 0.024, 0.05), (0, side * (length / 2 + 0.03), z)), wood)
    x = width / 2 + 0.085
    for y in (-0.62, -0.28):
        piece.add(box((0.03, 0.045, height - 0.3), (x, y, 0)), wood)
    for z in np.arange(0.25, height - 0.35, 0.26):
        piece.add(box((0.028, 0.3, 0.03), (x, -0.45, z)), wood)
    return piece


def crib(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A child's bed with bars all around."""
    piece, wood = Assembly("bed"), looks.case()
    width, length, height = 0.66, rng.uniform(1.2, 1.36), rng.uniform(0.82, 0.95)
    for x in (-1, 1):
        for y in (-1, 1):
            piece.add(box((0.045, 0.045, height), (x * width / 2, y * length / 2, 0)), wood)
        for z in (0.22, height - 0.05):
            piece.add(box((0.025, length - 0.045, 0.04), (x * width / 2, 0, z)), wood)
        for y in np.arange(-length / 2 + 0.09, length / 2 - 0.06, 0.08):
            piece.add(box((0.014, 0.014, height - 0.29), (x * width / 2, y, 0.25)), wood)
    for y in (-1, 1):
        for z in (0.22, height - 0.05):
            piece.add(box((width - 0.045, 0.025, 0.04), (0, y * length / 2, z)), wood)
        for x in np.arange(-width / 2 + 0.09, width / 2 - 0.06, 0.08):
            piece.add(box((0.014, 0.014, height - 0.29), (x, y * length / 2, 0.25)), wood)
    piece.add(box((width - 0.03, length - 0.03, 0.02), (0, 0, 0.22)), wood)
    piece.add(cushion((width - 0.05, length - 0.05, 0.11), (0, 0, 0.24), 0.12), looks.fabric())
    piece.add(rumpled(rng, 0.5, 0.55).moved((0, -0.15, 0.335)), looks.fabric())
    soft = cushion((0.36, 0.26, 0.07), (0, length / 2 - 0.22, 0.345), 0.5, 10).turned(rotation_x(0.0))
    piece.add(soft, looks.fabric(), "objects")
    return piece
