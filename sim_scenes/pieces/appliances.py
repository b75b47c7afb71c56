"""Big and small appliances: fridge, tall oven, microwave, kettle, toaster, washing machine.

As in NYUv2 a fridge is furniture, everything else here is an object.
"""

import numpy as np

from dsmap.sim_scenes.geometry.lofts import bow, loft, ring, tube
from dsmap.sim_scenes.geometry.shapes import box, cylinder, lathe, panel, rotation_x
from dsmap.sim_scenes.pieces.kitchen import DEPTH, fronts_of, oven_face
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures import finishes
from dsmap.sim_scenes.textures.palette import Looks


def _white_goods(rng: np.random.Generator, looks: Looks) -> str:
    return (finishes.porcelain, finishes.porcelain, finishes.steel, finishes.dark)[rng.integers(4)](looks)


def fridge(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A refrigerator: one or two doors over each other, or side by side, with bar handles and notes on it."""
    piece, body = Assembly("furniture"), _white_goods(rng, looks)
    wide = rng.random() < 0.25
    width = rng.uniform(0.85, 0.92) if wide else rng.uniform(0.55, 0.7)
    depth, height = rng.uniform(0.6, 0.72), rng.uniform(1.5, 1.9)
    piece.add(box((width, depth - 0.06, height - 0.03), (0, 0.03, 0.03)), body)
    piece.add(box((width - 0.06, depth - 0.14, 0.03), (0, 0.03, 0)), finishes.dark(looks))
    split = rng.uniform(0.3, 0.42) if rng.random() < 0.5 else rng.uniform(0.65, 0.74)
    doors = [(-width / 4, width / 2, 0.03, height - 0.03), (width / 4, width / 2, 0.03, height - 0.03)]
    if not wide:
        cut = split * height
        doors = [(0, width, 0.03, cut - 0.03), (0, width, cut, height - cut)]
    front = -depth / 2 + 0.06
    for k, (x, w, z, tall) in enumerate(doors):
        piece.add(box((w - 0.006, 0.055, tall - 0.008), (x, front - 0.0285, z + 0.004), 0.012), body)
        side = (1 - 2 * k) if wide else 1
        bar = x + side * (w / 2 - 0.06)
        low, high = (
            (z + 0.3 * tall, z + 0.7 * tall) if wide else (z + 0.1 * tall, min(z + 0.9 * tall, z + 0.6))
        )
        piece.add(
            tube([(bar, front - 0.095, low), (bar, front - 0.095, high)], 0.011, 8), finishes.steel(looks)
        )
        for at in (low + 0.03, high - 0.03):
            piece.add(box((0.016, 0.05, 0.016), (bar, front - 0.075, at - 0.008)), finishes.steel(looks))
    if rng.random() < 0.5:
        _notes(rng, looks, piece, width, front - 0.0585, height)
    half = width / 2 - 0.06
    piece.surfaces.append((-half, -depth / 2 + 0.12, half, depth / 2 - 0.05, height))
    return piece


def _notes(
    rng: np.random.Generator, looks: Looks, piece: Assembly, width: float, y: float, height: float
) -> None:
    """Papers and postcards held by magnets."""
    notes = Assembly("objects", name="notes")
    for x in np.linspace(-0.3, 0.15, int(rng.integers(2, 5))) * width:
        w, h = rng.uniform(0.06, 0.12), rng.uniform(0.07, 0.14)
        z = rng.uniform(0.8, 0.9) * height - h
        notes.add(
            panel(w, h, 0.003).moved((x, y, z)),
            finishes.paper(looks) if rng.random() < 0.5 else looks.thing(),
        )
    piece.attach(notes, (0, 0, 0))


def tall_oven(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A floor-to-head cupboard with an oven and a microwave built in."""
    piece, width, height = Assembly("furniture"), 0.6, rng.uniform(2.0, 2.2)
    front = -DEPTH / 2 + 0.04
    piece.add(box((width, DEPTH - 0.04, height - 0.1), (0, 0.02, 0.1)), fronts_of(looks))
    piece.add(box((width, DEPTH - 0.1, 0.1), (0, 0.04, 0)), finishes.dark(looks))
    for z, tall in ((0.1, 0.62), (1.72, height - 1.72)):
        piece.add(
            box((width - 0.006, 0.018, tall - 0.006), (0, front - 0.009, z + 0.003), 0.002), fronts_of(looks)
        )
        piece.add(
            box((0.2, 0.03, 0.012), (0, front - 0.032, z + (tall - 0.06 if z < 1 else 0.05))),
            finishes.steel(looks),
        )
    oven_face(rng, looks, piece, (0, front, 0.72), (width, 0.6))
    oven_face(rng, looks, piece, (0, front, 1.32), (width, 0.4))
    return piece


def microwave(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A microwave oven."""
    piece, body = Assembly("objects"), _white_goods(rng, looks)
    w, d, h = rng.uniform(0.44, 0.52), rng.uniform(0.32, 0.4), rng.uniform(0.26, 0.31)
    piece.add(box((w, d, h - 0.012), (0, 0, 0.012), 0.006), body)
    piece.add(box((w - 0.04, d - 0.04, 0.012), (0, 0, 0)), finishes.dark(looks))
    piece.add(
        panel(0.68 * w, 0.78 * h, 0.008).moved((-0.13 * w, -d / 2 - 0.004, 0.12 * h)), finishes.dark(looks)
    )
    piece.add(
        tube([(0.24 * w, -d / 2 - 0.025, 0.2 * h), (0.24 * w, -d / 2 - 0.025, 0.85 * h)], 0.008, 8),
        finishes.steel(looks),
    )
    for z in (0.3, 0.55):
        knob = cylinder(0.02, 0.016, sides=16).turned(rotation_x(np.pi / 2))
        piece.add(knob.moved((0.38 * w, -d / 2, z * h)), finishes.steel(looks))
    piece.add(
        panel(0.14 * w, 0.12 * h, 0.004).moved((0.38 * w, -d / 2 - 0.001, 0.76 * h)), finishes.dark(looks)
    )
    piece.surfaces.append((-0.35 * w, -0.3 * d, 0.35 * w, 0.3 * d, h))
    return piece


def kettle(rng: np.random.Generator, looks: Looks) -> Assembly:
    """An electric kettle with spout and handle."""
    piece, h = Assembly("objects"), rng.uniform(0.2, 0.26)
    body = finishes.steel(looks) if rng.random() < 0.5 else looks.thing()
    piece.add(cylinder(0.085, 0.022, sides=24), finishes.dark(looks))
    piece.add(
        lathe(
            [(0.08, 0), (0.078, 0.02), (0.06, 0.8 * h), (0.05, 0.9 * h), (0.015, 0.93 * h)], (0, 0, 0.022), 28
        ),
        body,
    )
    piece.add(cylinder(0.012, 0.03, (0, 0, 0.94 * h), 12), finishes.dark(looks))
    handle = bow((0.058, 0, 0.88 * h), (0.19, 0, 0.75 * h), (0.075, 0, 0.25 * h))
    piece.add(tube(handle, 0.011, 10), finishes.dark(looks))
    piece.add(tube([(-0.055, 0, 0.72 * h), (-0.1, 0, 0.88 * h)], [0.02, 0.011], 10), body)
    return piece


def toaster(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A toaster with two slots."""
    piece, body = Assembly("objects"), finishes.steel(looks) if rng.random() < 0.5 else looks.thing()
    w, d, h = rng.uniform(0.26, 0.32), rng.uniform(0.16, 0.19), rng.uniform(0.18, 0.21)
    edge = ((0.9, 0.012), (1.0, 0.04), (1.0, 0.8 * h), (0.93, h))
    piece.add(loft([ring((w * f, d * f), (0, 0, z), 0.3) for f, z in edge]), body)
    piece.add(box((0.8 * w, 0.8 * d, 0.013)), finishes.dark(looks))
    for y in (-0.22 * d, 0.22 * d):
        piece.add(box((0.7 * w, 0.2 * d, 0.004), (0, y, h - 0.001)), finishes.dark(looks))
    piece.add(box((0.02, 0.04, 0.016), (w / 2 + 0.008, 0, 0.6 * h), 0.004), finishes.dark(looks))
    return piece


def coffee_machine(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A filter coffee machine with its jug."""
    piece, body = Assembly("objects"), finishes.dark(looks) if rng.random() < 0.6 else looks.thing()
    piece.add(box((0.19, 0.24, 0.03), bevel=0.006), body)
    piece.add(box((0.18, 0.09, 0.27), (0, 0.07, 0.03), 0.008), body)
    piece.add(box((0.185, 0.22, 0.09), (0, 0.005, 0.27), 0.012), body)
    jug = [(0.055, 0), (0.068, 0.05), (0.06, 0.12), (0.045, 0.15), (0.05, 0.17)]
    piece.add(lathe(jug, (0, -0.045, 0.032), 24), finishes.steel(looks))
    piece.add(tube(bow((0, -0.1, 0.18), (0, -0.18, 0.17), (0, -0.11, 0.08)), 0.008, 8), finishes.dark(looks))
    return piece


def washing_machine(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A front loader (or dryer): round door with dark glass, drawer and dial."""
    piece, body = (
        Assembly("objects"),
        finishes.porcelain(looks) if rng.random() < 0.75 else finishes.steel(looks),
    )
    depth = rng.uniform(0.52, 0.6)
    piece.add(box((0.595, depth, 0.83), (0, 0, 0.02), 0.008), body)
    piece.add(box((0.52, depth - 0.08, 0.02)), finishes.dark(looks))

    def disc(radius: float, thick: float, inner: float, material: str, y: float) -> None:
        face = lathe([(radius, 0), (radius, thick), (inner, thick + 0.004)], sides=36).turned(
            rotation_x(np.pi / 2)
        )
        piece.add(face.moved((0, y, 0.42)), material)

    disc(0.2, 0.025, 0.16, finishes.steel(looks), -depth / 2)
    disc(0.15, 0.012, 0.05, finishes.dark(looks), -depth / 2 - 0.027)
    piece.add(panel(0.57, 0.11, 0.008).moved((0, -depth / 2 - 0.003, 0.725)), finishes.porcelain(looks))
    dial = cylinder(0.035, 0.022, sides=20).turned(rotation_x(np.pi / 2))
    piece.add(dial.moved((0.03, -depth / 2 - 0.006, 0.78)), finishes.steel(looks))
    piece.add(panel(0.14, 0.06, 0.006).moved((0.18, -depth / 2 - 0.006, 0.75)), finishes.dark(looks))
    piece.add(panel(0.15, 0.08, 0.006).moved((-0.19, -depth / 2 - 0.006, 0.74)), body)
    piece.surfaces.append((-0.24, -depth / 2 + 0.06, 0.24, depth / 2 - 0.05, 0.85))
    return piece
