"""Dishes, pots, bottles and food (class objects): what stands on kitchen boards and laid tables."""

import numpy as np

from dsmap.sim_scenes.geometry.lofts import bow, tube
from dsmap.sim_scenes.geometry.shapes import Shape, box, cushion, cylinder, lathe
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures import finishes
from dsmap.sim_scenes.textures.palette import Looks


def _dish(rng: np.random.Generator, looks: Looks) -> str:
    return finishes.porcelain(looks) if rng.random() < 0.55 else looks.thing()


def _plate(radius: float, z: float) -> Shape:
    rim = 0.022
    profile = [
        (0.55 * radius, 0),
        (0.7 * radius, 0.004),
        (radius, rim),
        (radius - 0.004, rim + 0.003),
        (0.66 * radius, 0.008),
    ]
    return lathe(profile, (0, 0, z), 28)


def plate(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A plate, sometimes with food or cutlery on it."""
    piece, radius = Assembly("objects"), rng.uniform(0.09, 0.14)
    piece.add(_plate(radius, 0), _dish(rng, looks))
    if rng.random() < 0.5:
        food = looks.tiled(
            "plain", ((0.75, 0.55, 0.25), (0.45, 0.3, 0.15), (0.7, 0.25, 0.15), (0.4, 0.5, 0.2))
        )
        for _ in range(int(rng.integers(1, 4))):
            d = rng.uniform(0.04, 0.075)
            at = (*rng.uniform(-0.25, 0.25, 2) * radius, 0.006)
            piece.add(cushion((d, d * 0.8, d * 0.5), at, 0.8, 8), food)
    return piece


def plate_stack(rng: np.random.Generator, looks: Looks) -> Assembly:
    """Several plates on each other."""
    piece, radius, dish = Assembly("objects"), rng.uniform(0.1, 0.14), _dish(rng, looks)
    for k in range(int(rng.integers(3, 9))):
        piece.add(_plate(radius, 0.011 * k), dish)
    return piece


def bowl_stack(rng: np.random.Generator, looks: Looks) -> Assembly:
    """One to four nested bowls."""
    piece, r, dish = Assembly("objects"), rng.uniform(0.065, 0.11), _dish(rng, looks)
    for k in range(int(rng.integers(1, 5))):
        profile = [
            (0.45 * r, 0),
            (0.8 * r, 0.35 * r),
            (r, 0.75 * r),
            (0.95 * r, 0.76 * r),
            (0.72 * r, 0.36 * r),
            (0.3 * r, 0.1 * r),
        ]
        piece.add(lathe(profile, (0, 0, 0.022 * k), 28), dish)
    return piece


def glass(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A tumbler or a wine glass, of tinted pale glass (opaque: nothing here refracts)."""
    piece, tone = (
        Assembly("objects"),
        looks.tiled("plain", ((0.7, 0.78, 0.8), (0.62, 0.72, 0.66), (0.75, 0.75, 0.72))),
    )
    if rng.random() < 0.6:
        r, h = rng.uniform(0.03, 0.04), rng.uniform(0.09, 0.15)
        piece.add(lathe([(0.8 * r, 0), (r, h), (r - 0.003, h), (0.75 * r, 0.012)], sides=24), tone)
    else:
        r, h = rng.uniform(0.03, 0.04), rng.uniform(0.16, 0.21)
        profile = [
            (0.036, 0),
            (0.006, 0.006),
            (0.004, 0.45 * h),
            (0.8 * r, 0.58 * h),
            (r, 0.75 * h),
            (0.8 * r, h),
            (0.77 * r, h),
            (0.9 * r, 0.75 * h),
            (0.02, 0.55 * h),
        ]
        piece.add(lathe(profile, sides=24), tone)
    return piece


def bottle(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A bottle of wine, water, oil, sauce or detergent with a label and a cap."""
    piece, r, h = Assembly("objects"), rng.uniform(0.028, 0.043), rng.uniform(0.2, 0.33)
    body = looks.tiled(
        "plain",
        (
            (0.12, 0.22, 0.12),
            (0.35, 0.2, 0.08),
            (0.7, 0.78, 0.82),
            (0.85, 0.82, 0.75),
            (0.2, 0.4, 0.6),
            (0.75, 0.3, 0.2),
        ),
    )
    neck = rng.uniform(0.3, 0.5) * r
    piece.add(
        lathe([(r, 0), (r, 0.6 * h), (0.85 * r, 0.68 * h), (neck, 0.78 * h), (neck, 0.97 * h)], sides=24),
        body,
    )
    piece.add(lathe([(r + 0.0008, 0.15 * h), (r + 0.0008, 0.5 * h)], sides=24), looks.thing())
    piece.add(cylinder(neck + 0.004, 0.06 * h, (0, 0, 0.95 * h), 20), finishes.dark(looks))
    return piece


def jar(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A storage jar or tin with a lid."""
    piece, r, h = Assembly("objects"), rng.uniform(0.035, 0.07), rng.uniform(0.08, 0.2)
    piece.add(lathe([(0.94 * r, 0), (r, 0.01), (r, 0.88 * h), (0.9 * r, 0.93 * h)], sides=28), looks.thing())
    piece.add(
        lathe([(0.96 * r, 0), (0.96 * r, 0.1 * h), (0.9 * r, 0.13 * h)], (0, 0, 0.92 * h), 28),
        looks.wood() if rng.random() < 0.5 else finishes.steel(looks),
    )
    return piece


def can(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A tin or drinks can."""
    piece, r, h = Assembly("objects"), rng.uniform(0.03, 0.05), rng.uniform(0.1, 0.14)
    piece.add(lathe([(0.93 * r, 0), (r, 0.006), (r, h - 0.006), (0.93 * r, h)], sides=24), looks.thing())
    piece.add(cylinder(0.9 * r, 0.002, (0, 0, h), 24), finishes.steel(looks))
    return piece


def pot(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A cooking pot with two handles and, mostly, a lid."""
    piece, r, h = Assembly("objects"), rng.uniform(0.09, 0.14), rng.uniform(0.1, 0.18)
    metal = finishes.steel(looks) if rng.random() < 0.6 else looks.thing()
    piece.add(lathe([(0.95 * r, 0), (r, 0.012), (r, h), (r - 0.004, h), (r - 0.006, 0.02)], sides=32), metal)
    for side in (-1, 1):
        grip = bow(
            (side * 0.97 * r, -0.035, 0.8 * h),
            (side * (r + 0.07), 0, 0.8 * h),
            (side * 0.97 * r, 0.035, 0.8 * h),
        )
        piece.add(tube(grip, 0.007, 8), finishes.dark(looks))
    if rng.random() < 0.7:
        piece.add(
            lathe([(r + 0.003, 0), (r + 0.003, 0.005), (0.4 * r, 0.025), (0.02, 0.03)], (0, 0, h), 32), metal
        )
        piece.add(
            lathe([(0.01, 0), (0.02, 0.02), (0.018, 0.03)], (0, 0, h + 0.028), 16), finishes.dark(looks)
        )
    return piece


def pan(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A frying pan with a long handle."""
    piece, r = Assembly("objects"), rng.uniform(0.1, 0.15)
    piece.add(
        lathe([(0.8 * r, 0), (r, 0.045), (r - 0.004, 0.046), (0.78 * r, 0.006)], sides=32),
        finishes.dark(looks),
    )
    piece.add(
        tube(bow((0.97 * r, 0, 0.036), (1.4 * r, 0, 0.06), (2.25 * r, 0, 0.062)), 0.011, 10),
        finishes.dark(looks),
    )
    return piece


def fruit(rng: np.random.Generator, looks: Looks) -> Assembly:
    """An apple, orange or lemon."""
    piece, d = Assembly("objects"), rng.uniform(0.06, 0.09)
    skin = looks.tiled("plain", ((0.8, 0.45, 0.1), (0.7, 0.12, 0.1), (0.5, 0.65, 0.2), (0.85, 0.75, 0.2)))
    piece.add(cushion((d, d, 0.92 * d), softness=0.95, rings=12), skin)
    return piece


def cutting_board(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A board, sometimes with bread on it."""
    piece, w = Assembly("objects"), rng.uniform(0.28, 0.42)
    piece.add(box((w, 0.62 * w, 0.018), bevel=0.005), looks.wood())
    if rng.random() < 0.6:
        crust = looks.tiled("plain", ((0.62, 0.4, 0.2), (0.7, 0.5, 0.28)))
        piece.add(cushion((0.6 * w, 0.3 * w, 0.1), (0, 0, 0.016), 0.7, 12), crust)
    return piece
