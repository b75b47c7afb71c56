"""Lamps of many shapes (class objects). Shades' materials are called `shade...`: the lighting looks for them."""

import numpy as np

from dsmap.sim_scenes.geometry.lofts import bow, tube
from dsmap.sim_scenes.geometry.shapes import Shape, box, cushion, cylinder, lathe, rotation_x, rotation_z
from dsmap.sim_scenes.scene import Assembly, Material
from dsmap.sim_scenes.textures import finishes
from dsmap.sim_scenes.textures.palette import Looks

_SHADES = ((235, 215, 180), (242, 236, 224), (225, 200, 160), (210, 190, 175))


def shade_cloth(rng: np.random.Generator, looks: Looks, glow: float | None = None) -> str:
    """The lit cloth or paper of a lamp shade."""
    image = np.broadcast_to(np.array(_SHADES[rng.integers(len(_SHADES))], np.uint8), (32, 32, 3)).copy()
    image[::4] = (image[::4] * 0.92).astype(np.uint8)
    glow = rng.uniform(0.12, 0.35) if glow is None else glow
    return looks.add("shade", Material(image, 0.12, 0.0, 0.1, emission=glow))


def _shade(rng: np.random.Generator, radius: float, height: float, at: tuple[float, float, float]) -> Shape:
    """An open drum or cone, 4 mm thick."""
    top = radius * rng.uniform(0.5, 1.0)
    skin = [(radius, 0), (top, height), (top - 0.004, height), (radius - 0.004, 0.0), (radius, 0)]
    return lathe(skin[:4], at, 36)


def floor_lamp(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A floor lamp: straight, tripod, or an arc with a hanging shade, 1.35 to 1.8 m high."""
    piece, height, kind = Assembly("objects", name="floor_lamp"), rng.uniform(1.4, 1.75), int(rng.integers(3))
    metal = (looks.metal, finishes.dark(looks), finishes.steel(looks))[rng.integers(3)]
    tall, radius = rng.uniform(0.22, 0.32), rng.uniform(0.17, 0.24)
    shade = shade_cloth(rng, looks)
    if kind == 0:
        piece.add(
            lathe([(0.15, 0), (0.15, 0.014), (0.02, 0.025), (0.011, 0.04), (0.011, height - 0.05)], sides=24),
            metal,
        )
        piece.add(_shade(rng, radius, tall, (0, 0, height - tall)), shade)
    elif kind == 1:
        wood = looks.wood()
        for k in range(3):
            foot = np.array([0.26 * np.cos(2.1 * k), 0.26 * np.sin(2.1 * k), 0.008])
            piece.add(
                tube([foot, (0.03 * np.cos(2.1 * k), 0.03 * np.sin(2.1 * k), height - tall)], 0.014, 10), wood
            )
        piece.add(cylinder(0.05, 0.03, (0, 0, height - tall - 0.01), 20), metal)
        piece.add(cylinder(0.008, 0.6 * tall, (0, 0, height - tall), 8), metal)
        piece.add(_shade(rng, radius, tall, (0, 0, height - tall)), shade)
    else:
        piece.add(lathe([(0.16, 0), (0.16, 0.04), (0.02, 0.045)], (0.3, 0, 0), 28), finishes.stone(looks))
        arc = np.vstack(
            [
                [(0.3, 0, 0.04), (0.3, 0, 0.6)],
                bow((0.3, 0, 0.9), (0.25, 0, height + 0.25), (-0.35, 0, height - 0.1), 12),
            ]
        )
        piece.add(tube(arc, 0.012, 10), metal)
        bowl = [(0.16, 0), (0.13, 0.08), (0.03, 0.13), (0.027, 0.127), (0.126, 0.078), (0.156, 0.0)]
        piece.add(lathe(bowl[:5], (-0.35, 0, height - 0.24), 32), metal)
        piece.add(cushion((0.09, 0.09, 0.09), (-0.35, 0, height - 0.21), 1.0, 10), shade)
    return piece


def table_lamp(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A lamp of 0.3 to 0.6 m for a nightstand or sideboard: turned foot with a shade, globe, or mushroom."""
    piece, height, kind = Assembly("objects", name="lamp"), rng.uniform(0.32, 0.58), int(rng.integers(3))
    foot, shade = looks.thing() if rng.random() < 0.6 else looks.metal, shade_cloth(rng, looks)
    if kind == 1:
        piece.add(lathe([(0.07, 0), (0.07, 0.02), (0.03, 0.04), (0.03, 0.06)], sides=24), foot)
        piece.add(cushion((0.62 * height, 0.62 * height, 0.6 * height), (0, 0, 0.055), 1.0, 16), shade)
        return piece
    tall, radius = 0.42 * height, rng.uniform(0.3, 0.36) * height
    body = height - 0.8 * tall
    knots = np.interp(np.linspace(0, 5, 14), np.arange(6), [0.075, *rng.uniform(0.02, 0.085, 4), 0.012])
    piece.add(lathe(list(zip(knots * (0.6 + height), np.linspace(0, body, 14), strict=True)), sides=28), foot)
    if kind == 0:
        piece.add(_shade(rng, radius, tall, (0, 0, height - tall)), shade)
    else:
        dome = [(radius, 0), (0.9 * radius, 0.45 * tall), (0.5 * radius, 0.8 * tall), (0.05, 0.92 * tall)]
        piece.add(lathe(dome, (0, 0, height - tall), 32), shade)
    return piece


def desk_lamp(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A jointed work lamp that leans forward over the desk."""
    piece, metal = (
        Assembly("objects", name="lamp"),
        looks.thing() if rng.random() < 0.5 else finishes.dark(looks),
    )
    piece.add(lathe([(0.085, 0), (0.085, 0.015), (0.02, 0.025)], sides=28), metal)
    elbow, wrist = (0.0, 0.12, 0.26), (0.0, -0.12, 0.42)
    piece.add(tube([(0, 0, 0.02), elbow], 0.008, 8), metal)
    piece.add(tube([elbow, wrist], 0.008, 8), metal)
    for at in (elbow, wrist):
        piece.add(cushion((0.03, 0.03, 0.03), (at[0], at[1], at[2] - 0.015), 1.0, 8), metal)
    head = lathe([(0.075, 0), (0.065, 0.05), (0.025, 0.1), (0.02, 0.13)], sides=24).turned(rotation_x(-0.5))
    piece.add(head.moved((0, -0.185, 0.31)), metal)
    bulb = lathe([(0.068, -0.003), (0.068, 0.0)], sides=24).turned(rotation_x(-0.5)).moved((0, -0.185, 0.31))
    piece.add(bulb, shade_cloth(rng, looks, 0.5))
    yaw = rng.uniform(-0.5, 0.5)
    piece.reshape(lambda shape: shape.moved(yaw=yaw))
    return piece


def pendant(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A lamp on a cord or rods: drum, dome, globe, or a chandelier. Its top (the ceiling) is z = 0, it hangs below."""
    piece, kind, drop = Assembly("objects", name="lamp"), int(rng.integers(4)), rng.uniform(0.25, 0.55)
    shade = shade_cloth(rng, looks, rng.uniform(0.3, 0.5))
    piece.add(cylinder(0.05, 0.024, (0, 0, -0.025), 24), looks.metal)
    piece.add(cylinder(0.005, drop, (0, 0, -drop - 0.02), 8), finishes.dark(looks))
    if kind == 0:
        radius, tall = rng.uniform(0.17, 0.28), rng.uniform(0.16, 0.26)
        piece.add(
            lathe([(radius, 0), (radius * 0.9, tall), (0.02, tall + 0.004)], (0, 0, -drop - tall), 40), shade
        )
    elif kind == 1:
        r = rng.uniform(0.14, 0.22)
        dome = [(r, 0), (0.93 * r, 0.35 * r), (0.6 * r, 0.7 * r), (0.1 * r, 0.85 * r)]
        piece.add(lathe(dome, (0, 0, -drop - 0.8 * r), 36), looks.thing())
        piece.add(lathe([(0.9 * r, 0), (0.9 * r, 0.004)], (0, 0, -drop - 0.8 * r - 0.003), 30), shade)
    elif kind == 2:
        d = rng.uniform(0.22, 0.4)
        piece.add(cushion((d, d, d), (0, 0, -drop - d), 1.0, 18), shade)
    else:
        piece.add(cushion((0.08, 0.08, 0.12), (0, 0, -drop - 0.09), 0.9, 10), looks.metal)
        for angle in np.arange(5) * 2 * np.pi / 5:
            turn = rotation_z(angle)
            arm = bow((0.02, 0, -drop - 0.03), (0.16, 0, -drop - 0.2), (0.26, 0, -drop - 0.04), 8)
            piece.add(tube(arm, 0.008, 8).turned(turn), looks.metal)
            piece.add(
                lathe([(0.055, 0), (0.035, 0.09), (0.01, 0.092)], (0.26, 0, -drop - 0.045), 20).turned(turn),
                shade,
            )
    return piece


def ceiling_lamp(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A flat lamp at the ceiling: a bowl, a tube light or a panel. Its top is z = 0."""
    piece, kind = Assembly("objects", name="lamp"), int(rng.integers(3))
    shade = shade_cloth(rng, looks, rng.uniform(0.4, 0.55))
    if kind == 0:
        r = rng.uniform(0.15, 0.25)
        piece.add(cylinder(r, 0.03, (0, 0, -0.032), 36), looks.metal)
        piece.add(lathe([(0.02, 0), (0.6 * r, 0.015), (0.97 * r, 0.06)], (0, 0, -0.09), 36), shade)
    elif kind == 1:
        long = rng.uniform(1.15, 1.55)
        piece.add(box((long, 0.14, 0.05), (0, 0, -0.052), 0.008), looks.white)
        for y in (-0.035, 0.035):
            piece.add(tube([(-0.47 * long, y, -0.068), (0.47 * long, y, -0.068)], 0.014, 10), shade)
    else:
        side = rng.choice([0.3, 0.6])
        piece.add(box((1.0 * 0.6, side, 0.03), (0, 0, -0.032), 0.004), looks.white)
        piece.add(box((0.56, side - 0.04, 0.004), (0, 0, -0.036)), shade)
    return piece
