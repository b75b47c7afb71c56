"""What hangs before a window: curtains, roller, Roman and Venetian blinds (class window, as in NYUv2).

Each is made for an opening of `width` whose lower and upper edge are at `low` and `high` [m]; the wall's face is
y = 0, everything hangs in front of it (y < 0); heights are above the floor.
"""

import numpy as np

from dsmap.sim_scenes.geometry.lofts import tube
from dsmap.sim_scenes.geometry.shapes import Shape, box, rotation_x, sheet
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures import finishes
from dsmap.sim_scenes.textures.palette import Looks


def dressing(rng: np.random.Generator, looks: Looks, width: float, low: float, high: float) -> Assembly:
    """One of the kinds below."""
    kinds = (curtains, curtains, roller_blind, venetian_blind, roman_blind)
    return kinds[int(rng.integers(len(kinds)))](rng, looks, width, low, high)


def drape(rng: np.random.Generator, width: float, height: float) -> Shape:
    """A hanging cloth in folds that widen towards the floor, bottom centre at the origin."""
    rows, folds = 12, max(3, int(round(width * rng.uniform(9, 14))))
    columns = 10 * folds + 1
    s, t = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows))
    phase = 2 * np.pi * folds * s + 0.6 * np.sin(5 * s + rng.uniform(0, 6)) * (1 - t)
    points = np.empty((rows, columns, 3))
    points[..., 0] = (s - 0.5) * width * (1 + 0.06 * (1 - t))
    points[..., 1] = (0.02 + 0.022 * (1 - t)) * np.sin(phase) + 0.008 * np.sin(3.3 * phase + 1)
    points[..., 2] = t * height
    return sheet(points, 0.005)


def curtains(rng: np.random.Generator, looks: Looks, width: float, low: float, high: float) -> Assembly:
    """A pair on a rod, drawn open by some amount or nearly closed, to the floor or just below the sill."""
    piece, cloth = Assembly("window", name="curtains"), looks.fabric()
    top = high + rng.uniform(0.1, 0.2)
    foot = 0.03 if rng.random() < 0.65 else max(low - 0.2, 0.03)
    share = rng.uniform(0.16, 0.3) if rng.random() < 0.75 else rng.uniform(0.35, 0.48)
    span = width + 0.36
    for side in (-1, 1):
        wide = share * span * rng.uniform(0.92, 1.08)
        cloth_shape = drape(rng, wide, top - foot - 0.02)
        piece.add(cloth_shape.moved((side * (span / 2 - wide / 2), -0.11, foot)), cloth)
    if rng.random() < 0.3:
        sheer = looks.tiled("fabric", ((0.85, 0.84, 0.8),))
        piece.add(drape(rng, 0.96 * width, top - foot - 0.06).moved((0, -0.05, foot + 0.02)), sheer)
    rod = looks.metal if rng.random() < 0.6 else looks.wood()
    ends = span / 2 + 0.06
    piece.add(tube([(-ends, -0.11, top), (ends, -0.11, top)], 0.013), rod)
    for side in (-1, 1):
        piece.add(tube([(side * (ends - 0.04), -0.11, top), (side * (ends - 0.04), 0, top)], 0.008, 8), rod)
    return piece


def roller_blind(rng: np.random.Generator, looks: Looks, width: float, low: float, high: float) -> Assembly:
    """A cloth that rolls onto a tube above the window, pulled down by some amount."""
    piece, wide = Assembly("window", name="blind"), width + 0.06
    drop = rng.uniform(0.15, 0.95) * (high - low)
    cloth = (
        looks.fabric() if rng.random() < 0.5 else looks.tiled("fabric", ((0.82, 0.8, 0.74), (0.6, 0.62, 0.6)))
    )
    piece.add(tube([(-wide / 2, -0.045, high + 0.03), (wide / 2, -0.045, high + 0.03)], 0.026, 16), cloth)
    piece.add(box((wide - 0.02, 0.003, drop), (0, -0.066, high + 0.03 - drop)), cloth)
    piece.add(box((wide - 0.02, 0.012, 0.025), (0, -0.066, high + 0.006 - drop), 0.003), looks.white)
    x = wide / 2 - 0.02
    piece.add(tube([(x, -0.085, high + 0.02), (x, -0.085, low + 0.2)], 0.002, 5), finishes.dark(looks))
    return piece


def venetian_blind(rng: np.random.Generator, looks: Looks, width: float, low: float, high: float) -> Assembly:
    """Slats between cords, let down by some amount; what is not let down is a pile under the head rail."""
    piece, wide = Assembly("window", name="blind"), width + 0.05
    slat = (
        looks.wood() if rng.random() < 0.4 else looks.white if rng.random() < 0.6 else finishes.steel(looks)
    )
    drop, pitch, tilt = rng.uniform(0.3, 1.0) * (high - low), 0.042, rng.uniform(-0.9, 0.9)
    piece.add(box((wide, 0.06, 0.05), (0, -0.04, high), 0.004), slat)
    plate = box((wide - 0.02, 0.048, 0.003)).turned(rotation_x(tilt))
    count = int(drop / pitch)
    for k in range(count):
        piece.add(plate.moved((0, -0.04, high - 0.03 - k * pitch)), slat)
    foot = high - 0.03 - count * pitch
    piece.add(box((wide - 0.02, 0.05, 0.02), (0, -0.04, foot - 0.01), 0.003), slat)
    for x in (-0.38 * wide, 0.38 * wide):
        for y in (-0.066, -0.014):
            piece.add(box((0.004, 0.002, high - foot), (x, y, foot)), slat)
    return piece


def roman_blind(rng: np.random.Generator, looks: Looks, width: float, low: float, high: float) -> Assembly:
    """A cloth that gathers upwards in a few broad folds."""
    piece, wide = Assembly("window", name="blind"), width + 0.08
    drop = rng.uniform(0.3, 0.8) * (high - low) + 0.1
    t = np.linspace(0, 1, 40)
    gathered = np.clip(1.6 - 3 * t, 0, 1)
    depth = 0.03 + 0.035 * gathered * np.abs(np.sin(np.pi * 7 * t))
    points = np.empty((40, 9, 3))
    points[..., 0] = np.linspace(-0.5, 0.5, 9) * wide
    points[..., 1] = -depth[:, None]
    points[..., 2] = (high + 0.08 - drop + t * drop)[:, None]
    piece.add(sheet(points, 0.006), looks.fabric())
    piece.add(box((wide, 0.03, 0.04), (0, -0.016, high + 0.07)), looks.white)
    return piece
