"""What makes a room lived-in: televisions, a plant, and small things for every surface."""

import numpy as np

from dsmap.sim_scenes.geometry.shapes import (
    Shape,
    box,
    cushion,
    cylinder,
    lathe,
    panel,
    rotation_x,
    rotation_z,
)
from dsmap.sim_scenes.scene import Assembly, Material
from dsmap.sim_scenes.textures import art, screens
from dsmap.sim_scenes.textures.palette import Looks


def television(rng: np.random.Generator, looks: Looks, width: float) -> Assembly:
    """A flat television or monitor of a given width [m], on its stand."""
    piece = Assembly("tv")
    height, lift = width * 0.5625, rng.uniform(0.05, 0.1) * (1.6 if width < 0.7 else 1.0)
    body = looks.add("tv_body", Material(_dark(), 0.5, 0.3, 0.5))
    image = screens.screen(rng)
    on = float(image.mean()) > 60
    glass = looks.printed("screen", image, 0.35, 0.35 if on else 0.0, glass=True)
    piece.add(box((width + 0.03, 0.03, height + 0.035), (0, 0.012, lift), 0.006), body)
    piece.add(box((width * 0.6, 0.05, height * 0.6), (0, 0.045, lift + height * 0.15), 0.015), body)
    piece.add(panel(width, height, 0.006).moved((0, -0.005, lift + 0.0185)), glass)
    piece.add(box((0.08, 0.03, lift + 0.1), (0, 0.04, 0)), body)
    piece.add(box((0.35 * width, 0.2, 0.012), (0, 0.01, 0), 0.004), body)
    return piece


def _dark() -> np.ndarray:
    y, x = np.mgrid[0:64, 0:64]
    return np.repeat((34 + 7 * np.sin(x / 5.0) * np.sin(y / 7.0))[..., None], 3, 2).astype(np.uint8)


def potted_plant(rng: np.random.Generator, looks: Looks, height: float) -> Assembly:
    """A potted plant: a turned pot and a bush of long thin leaves."""
    piece = Assembly("objects")
    pot, leaf = (
        looks.thing(),
        looks.tiled("leaves", ((0.22, 0.42, 0.18), (0.3, 0.48, 0.2), (0.16, 0.34, 0.2))),
    )
    radius = 0.16 * height**0.7
    tall = radius * 1.6
    piece.add(
        lathe(
            [(radius * 0.65, 0), (radius, tall), (radius * 0.86, tall), (radius * 0.8, tall * 0.9)], sides=24
        ),
        pot,
    )
    for k in range(int(rng.integers(14, 24))):
        length = rng.uniform(0.4, 0.8) * (height - tall)
        blade = cushion((0.09 * height**0.5, 0.012, length), softness=0.9, rings=6)
        lean = rng.uniform(0.15, 1.0)
        turned = blade.turned(rotation_x(lean)).turned(rotation_z(k * 2.4 + rng.uniform(-0.3, 0.3)))
        piece.add(
            turned.moved((0, 0, tall * 0.85 + rng.uniform(0, 0.25) * (height - tall) * (lean < 0.6))), leaf
        )
    return piece


def vase(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A turned vase."""
    piece, h = Assembly("objects"), rng.uniform(0.16, 0.32)
    radii = rng.uniform(0.3, 1.0, 5) * 0.09
    smooth = np.interp(np.linspace(0, 4, 17), np.arange(5), np.maximum(radii, 0.03))
    piece.add(lathe(list(zip(smooth, np.linspace(0, h, 17), strict=True)), sides=28), looks.thing())
    return piece


def bowl(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A bowl with fruit."""
    piece, r = Assembly("objects"), rng.uniform(0.1, 0.15)
    piece.add(
        lathe([(r * 0.45, 0), (r * 0.8, 0.03), (r, 0.075), (r * 0.94, 0.075), (r * 0.7, 0.035)], sides=28),
        looks.thing(),
    )
    fruit = looks.tiled("plain", ((0.8, 0.5, 0.12), (0.7, 0.15, 0.1), (0.5, 0.65, 0.2)))
    for angle in np.arange(4) * 1.7:
        piece.add(
            cushion(
                (0.075, 0.075, 0.07), (r * 0.42 * np.cos(angle), r * 0.42 * np.sin(angle), 0.035), 1.0, 8
            ),
            fruit,
        )
    return piece


def mug(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A mug with a handle."""
    piece, material, h = Assembly("objects"), looks.thing(), rng.uniform(0.085, 0.11)
    piece.add(lathe([(0.036, 0), (0.041, h), (0.035, h), (0.033, h * 0.3)], sides=24), material)
    piece.add(box((0.03, 0.011, h * 0.6), (0.05, 0, h * 0.2), 0.004), material)
    return piece


def carton(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A printed box."""
    piece, size = Assembly("objects"), rng.uniform(0.1, 0.26, 3)
    shape = box(size, bevel=0.003)
    low, high = shape.bounds()
    unit = (shape.vertices - low) / (high - low)
    uv = np.stack([(unit[:, 0] + unit[:, 1]) / 2, 1 - unit[:, 2] * 0.6 - unit[:, 1] * 0.38], 1)
    piece.add(
        Shape(shape.vertices, shape.faces, np.clip(uv, 0.01, 0.99)),
        looks.printed("carton", art.cover(rng)),
    )
    return piece


def ball(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A ball."""
    piece, d = Assembly("objects"), rng.uniform(0.12, 0.24)
    piece.add(cushion((d, d, d), softness=1.0), looks.fabric())
    return piece


def candles(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A tray with candles of different heights."""
    piece, wax = Assembly("objects"), looks.tiled("plain", ((0.85, 0.8, 0.65), (0.6, 0.2, 0.2)))
    piece.add(box((0.26, 0.13, 0.015), bevel=0.005), looks.wood())
    for x in (-0.07, 0.0, 0.075):
        piece.add(cylinder(0.028, rng.uniform(0.06, 0.16), (x, rng.uniform(-0.015, 0.015), 0.015), 20), wax)
    return piece


def stand_television(rng: np.random.Generator, looks: Looks, case: Assembly) -> None:
    """Put a television as wide as fits on a cabinet."""
    x0, _, x1, _, z = case.surfaces[-1]
    width = min(rng.uniform(0.95, 1.3), 0.92 * (x1 - x0))
    case.attach(television(rng, looks, width), (rng.uniform(-0.1, 0.1) * (x1 - x0 - width), 0.0, z))


def hamper(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A laundry basket with cloth in it."""
    piece, r, h = Assembly("objects"), rng.uniform(0.18, 0.24), rng.uniform(0.4, 0.55)
    piece.add(
        lathe([(r * 0.8, 0), (r, h), (r * 0.93, h), (r * 0.9, h * 0.8)], sides=28),
        looks.tiled("fabric", ((0.6, 0.48, 0.33),)),
    )
    piece.add(cushion((1.5 * r, 1.5 * r, 0.22), (0, 0, h * 0.78), 0.8), looks.fabric())
    return piece
