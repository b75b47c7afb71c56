"""Potted plants of several habits (class objects)."""

import numpy as np

from dsmap.sim_scenes.geometry.lofts import bow, tube
from dsmap.sim_scenes.geometry.shapes import Shape, cushion, lathe, merged, rotation_x, rotation_z, sheet
from dsmap.sim_scenes.pieces import decor
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures import finishes
from dsmap.sim_scenes.textures.palette import Looks

_GREENS = ((0.22, 0.42, 0.18), (0.3, 0.48, 0.2), (0.16, 0.34, 0.2), (0.36, 0.46, 0.28))


def _green(looks: Looks) -> str:
    return looks.tiled("leaves", _GREENS)


def _pot(rng: np.random.Generator, looks: Looks, piece: Assembly, radius: float, height: float) -> None:
    """A pot with earth in it."""
    skin = finishes.wicker(looks) if rng.random() < 0.2 else looks.thing()
    taper = rng.uniform(0.65, 0.95)
    rim = [(radius * taper, 0), (radius, height), (radius * 0.9, height), (radius * 0.86, 0.86 * height)]
    piece.add(lathe(rim, sides=28), skin)
    earth = looks.tiled("carpet", ((0.2, 0.14, 0.1),))
    piece.add(lathe([(radius * 0.88, 0), (radius * 0.88, 0.004)], (0, 0, 0.86 * height), 24), earth)


def leaf(length: float, width: float, droop: float, cells: int = 6) -> Shape:
    """A pointed leaf along +y from the origin that bends down by `droop` [rad] over its length, folded at its rib."""
    t = np.linspace(0, 1, cells + 1)
    s = np.linspace(-1, 1, 5)
    half = width / 2 * np.sin(np.pi * np.clip(t * 0.94 + 0.06, 0, 1)) ** 0.8 * (1 - 0.3 * t) + 0.001
    angle = -droop * t
    y = np.concatenate([[0], np.cumsum(np.cos(angle[1:]))]) * length / cells
    z = np.concatenate([[0], np.cumsum(np.sin(angle[1:]))]) * length / cells
    points = np.empty((len(t), len(s), 3))
    points[..., 0] = s * half[:, None]
    points[..., 1] = y[:, None]
    points[..., 2] = z[:, None] + 0.25 * np.abs(s) * half[:, None]
    return sheet(points, 0.0015)


def _whorl(
    rng: np.random.Generator,
    count: int,
    length: float,
    width: float,
    lift: tuple[float, float],
    droop: float,
    at: np.ndarray,
) -> Shape:
    """Leaves around a point, rising at angles drawn from `lift` [rad]."""
    leaves = []
    for k in range(count):
        blade = leaf(length * rng.uniform(0.75, 1.1), width, droop * rng.uniform(0.7, 1.2))
        turned = blade.turned(rotation_x(rng.uniform(*lift))).turned(
            rotation_z(2.4 * k + rng.uniform(-0.3, 0.3))
        )
        leaves.append(turned.moved(at))
    return merged(leaves)


def palm(rng: np.random.Generator, looks: Looks) -> Assembly:
    """Arching fronds of small leaflets from a few stems."""
    piece, height, green = Assembly("objects"), rng.uniform(1.1, 1.8), _green(looks)
    pot = 0.15 * height
    _pot(rng, looks, piece, 0.1 * height, pot)
    stems, blades = [], []
    for k in range(int(rng.integers(7, 12))):
        angle, reach = 2.4 * k, rng.uniform(0.2, 0.36) * height
        top = rng.uniform(0.65, 1.0) * height
        tip = np.array([reach * np.cos(angle), reach * np.sin(angle), top - 0.25 * reach])
        line = bow((0, 0, 0.85 * pot), (0.25 * tip[0], 0.25 * tip[1], top * 1.15), tip, 10)
        stems.append(tube(line, np.linspace(0.008, 0.003, 10), 6))
        for j in range(4, 10):
            along = np.arctan2(tip[1], tip[0])
            for side in (-1, 1):
                blade = leaf(0.15 * height * (1.15 - 0.08 * j), 0.028, 0.9, 3).turned(rotation_x(0.15))
                blades.append(blade.turned(rotation_z(along - np.pi / 2 + side * 0.85)).moved(line[j]))
    piece.add(merged(stems), green)
    piece.add(merged(blades), green)
    return piece


def rubber_plant(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A thin trunk with big leaves all around (ficus, rubber plant), 0.7 to 1.9 m."""
    piece, height, green = Assembly("objects"), rng.uniform(0.7, 1.9), _green(looks)
    _pot(rng, looks, piece, 0.09 * height + 0.06, 0.13 * height + 0.08)
    bark = looks.tiled("wood", ((0.35, 0.25, 0.17),))
    start = 0.12 * height + 0.06
    size = 0.14 + 0.07 * height
    for _ in range(int(rng.integers(1, 4))):
        lean = np.array([*rng.uniform(-0.1, 0.1, 2) * height, height * rng.uniform(0.75, 0.95) - size * 0.3])
        line = bow((0, 0, start), (*rng.uniform(-0.05, 0.05, 2), 0.5 * height), lean, 12)
        piece.add(tube(line, np.linspace(0.014, 0.006, 12), 8), bark)
        for k in range(4, 12):
            piece.add(_whorl(rng, 3, size, 0.45 * size, (-0.2, 0.6), 0.7, line[k]).moved(), green)
    return piece


def snake_plant(rng: np.random.Generator, looks: Looks) -> Assembly:
    """Upright sword-like leaves."""
    piece, height, green = Assembly("objects"), rng.uniform(0.4, 0.95), _green(looks)
    pot = rng.uniform(0.14, 0.22)
    _pot(rng, looks, piece, 0.7 * pot, pot)
    for k in range(int(rng.integers(8, 16))):
        tall, a = (height - 0.8 * pot) * rng.uniform(0.55, 1.0), 2.4 * k
        blade = cushion((0.05, 0.014, tall), softness=0.75, rings=6).turned(
            rotation_x(rng.uniform(-0.16, 0.16))
        )
        r = 0.4 * pot * np.sqrt(rng.uniform(0, 1))
        piece.add(blade.moved((r * np.cos(a), r * np.sin(a), 0.8 * pot), a), green)
    return piece


def plant(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A plant for the floor, of any habit."""
    makes = (palm, rubber_plant, rubber_plant, snake_plant)
    k = int(rng.integers(len(makes) + 1))
    return makes[k](rng, looks) if k < len(makes) else decor.potted_plant(rng, looks, rng.uniform(0.8, 1.3))
