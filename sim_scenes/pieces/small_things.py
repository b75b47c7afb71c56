"""Things that stand about on desks, shelves and floors: boxes, toys, clocks, frames.

Each is one compact body that stands stably as made (bottom at z = 0).
"""

import numpy as np

from dsmap.sim_scenes.geometry.lofts import loft, prism, ring, tub, tube
from dsmap.sim_scenes.geometry.shapes import Shape, box, cushion, cylinder, lathe, panel, rotation_x
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures import art, finishes
from dsmap.sim_scenes.textures.palette import Looks


def basket(rng: np.random.Generator, looks: Looks) -> Assembly:
    """An open basket or storage bin of wicker, plastic or cloth."""
    piece = Assembly("objects")
    skin = (finishes.wicker, Looks.thing, Looks.fabric)[rng.integers(3)](looks)
    w, d, h = rng.uniform(0.22, 0.38), rng.uniform(0.18, 0.28), rng.uniform(0.12, 0.22)
    piece.add(tub((w, d, h), 0.01, 0.012, corner=rng.uniform(0.25, 0.9)), skin)
    if rng.random() < 0.5:
        piece.add(cushion((0.8 * w, 0.75 * d, 0.6 * h), (0, 0, 0.3 * h), 0.6, 10), looks.fabric())
    return piece


def parcel(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A cardboard box with tape, closed or with open flaps."""
    piece = Assembly("objects")
    size = np.array([rng.uniform(0.25, 0.5), rng.uniform(0.2, 0.4), rng.uniform(0.15, 0.38)])
    card = looks.tiled("plain", ((0.66, 0.5, 0.34), (0.6, 0.45, 0.3), (0.72, 0.58, 0.42)))
    if rng.random() < 0.6:
        piece.add(box(size, bevel=0.003), card)
        piece.add(box((0.05, size[1] + 0.001, 0.0015), (0, 0, size[2])), finishes.paper(looks))
        return piece
    piece.add(tub(size, 0.006, 0.006, corner=0.04), card)
    for side in (-1, 1):
        flap = (
            box((size[0] * 0.96, 0.45 * size[1], 0.004))
            .moved((0, 0.225 * size[1], 0))
            .turned(rotation_x(-rng.uniform(0.1, 0.9)))
        )
        piece.add(
            flap.moved((0, size[1] / 2, size[2] - 0.005), 0.0).moved(yaw=0.0 if side > 0 else np.pi), card
        )
    return piece


def toy_blocks(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A little tower of building blocks."""
    piece, z, colours = Assembly("objects"), 0.0, [looks.thing() for _ in range(3)]
    for k in range(int(rng.integers(2, 6))):
        size = rng.uniform(0.04, 0.07) * (1 - 0.08 * k)
        piece.add(
            box((size, size, size), (*rng.uniform(-0.005, 0.005, 2), z), 0.003).moved(
                yaw=rng.uniform(-0.5, 0.5)
            ),
            colours[k % 3],
        )
        z += size
    return piece


def toy_car(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A toy car or truck of 12 to 28 cm."""
    piece, long = Assembly("objects"), rng.uniform(0.12, 0.28)
    w, r = 0.45 * long, 0.11 * long
    body = [
        (-0.5, 0.12),
        (0.5, 0.12),
        (0.5, 0.3),
        (0.25, 0.34),
        (0.12, 0.5),
        (-0.25, 0.5),
        (-0.4, 0.34),
        (-0.5, 0.32),
    ]
    piece.add(prism(np.array(body) * long, w), looks.thing())
    for x in (-0.28, 0.28):
        for side in (-1, 1):
            wheel = cylinder(r, 0.03, sides=18).turned(rotation_x(np.pi / 2)).moved((0, 0.015, 0))
            piece.add(wheel.moved((x * long, side * w / 2, r)), finishes.dark(looks))
    pane = np.array([(-0.23, 0.36), (0.1, 0.36), (0.05, 0.46), (-0.2, 0.46)]) * long
    piece.add(prism(pane, w + 0.004), finishes.porcelain(looks))
    return piece


def teddy(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A sitting soft toy."""
    piece, h, fur = Assembly("objects"), rng.uniform(0.2, 0.38), looks.fabric()
    piece.add(cushion((0.55 * h, 0.45 * h, 0.6 * h), softness=0.9, rings=12), fur)
    piece.add(cushion((0.45 * h, 0.4 * h, 0.42 * h), (0, -0.02 * h, 0.54 * h), 0.95, 12), fur)
    for side in (-1, 1):
        piece.add(cushion((0.15 * h, 0.08 * h, 0.15 * h), (side * 0.18 * h, 0, 0.86 * h), 1.0, 8), fur)
        piece.add(cushion((0.18 * h, 0.42 * h, 0.18 * h), (side * 0.2 * h, -0.28 * h, 0.0), 0.9, 8), fur)
        piece.add(
            cushion((0.15 * h, 0.32 * h, 0.15 * h), (side * 0.28 * h, -0.14 * h, 0.36 * h), 0.9, 8), fur
        )
    piece.add(cushion((0.17 * h, 0.1 * h, 0.13 * h), (0, -0.22 * h, 0.63 * h), 0.9, 8), finishes.dark(looks))
    return piece


def remote(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A remote control or a telephone handset."""
    piece = Assembly("objects")
    piece.add(box((0.05, rng.uniform(0.13, 0.2), 0.018), bevel=0.006), finishes.dark(looks))
    return piece


def pens(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A cup with pens."""
    piece = Assembly("objects")
    piece.add(lathe([(0.036, 0), (0.04, 0.1), (0.037, 0.1), (0.034, 0.01)], sides=20), looks.thing())
    for _ in range(int(rng.integers(3, 7))):
        a, lean = rng.uniform(0, 6.3), 0.03
        top = (lean * np.cos(a), lean * np.sin(a), rng.uniform(0.13, 0.17))
        piece.add(tube([(-0.4 * top[0], -0.4 * top[1], 0.012), top], 0.004, 6), looks.thing())
    return piece


def clock(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A table or alarm clock."""
    piece, r = Assembly("objects"), rng.uniform(0.05, 0.09)
    drum = cylinder(r, 0.05, sides=28).turned(rotation_x(np.pi / 2)).moved((0, 0.025, r + 0.01))
    piece.add(drum, looks.thing())
    piece.add(
        cylinder(0.86 * r, 0.004, sides=28).turned(rotation_x(np.pi / 2)).moved((0, -0.025, r + 0.01)),
        finishes.paper(looks),
    )
    for angle, long in ((rng.uniform(0, 6.3), 0.5), (rng.uniform(0, 6.3), 0.7)):
        tip = (long * r * np.sin(angle), -0.031, r + 0.01 + long * r * np.cos(angle))
        piece.add(tube([(0, -0.031, r + 0.01), tip], 0.003, 6), finishes.dark(looks))
    piece.add(box((r, 0.05, 0.02), bevel=0.004), finishes.dark(looks))
    return piece


def photo_frame(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A small framed photograph leaning on its stand (class picture)."""
    piece = Assembly("picture")
    image = art.painting(rng)
    h = rng.uniform(0.13, 0.26)
    w = h * image.shape[1] / image.shape[0]
    turn = rotation_x(-0.22)
    piece.add(
        box((w + 0.03, 0.012, h + 0.03)).turned(turn), looks.wood() if rng.random() < 0.5 else looks.metal
    )
    piece.add(panel(w, h, 0.004).moved((0, -0.0065, 0.015)).turned(turn), looks.printed("photo", image))
    piece.add(tube([(0, 0.02 + 0.13 * h, 0.6 * h), (0, 0.42 * h, 0.004)], 0.004, 6), finishes.dark(looks))
    return piece


def globe(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A globe on a foot."""
    piece, d = Assembly("objects"), rng.uniform(0.2, 0.3)
    piece.add(lathe([(0.3 * d, 0), (0.3 * d, 0.012), (0.015, 0.03), (0.012, 0.09)], sides=24), looks.metal)
    sea = looks.printed("globe", art.landscape(rng))
    ball = cushion((d, d, d), (0, 0, 0.085), 1.0, 18)
    spin = (ball.vertices - [0, 0, 0.085 + d / 2]) / d + 0.5
    piece.add(
        Shape(ball.vertices, ball.faces, np.clip(np.stack([spin[:, 0], 1 - spin[:, 2]], 1), 0.01, 0.99)), sea
    )
    return piece


def speaker(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A shelf loudspeaker with two cones."""
    piece, w, h = Assembly("objects"), rng.uniform(0.13, 0.2), rng.uniform(0.22, 0.36)
    piece.add(box((w, 0.9 * w, h), bevel=0.005), looks.wood() if rng.random() < 0.5 else finishes.dark(looks))
    for z, r in ((0.3 * h, 0.38 * w), (0.72 * h, 0.22 * w)):
        cone = lathe([(r, 0), (r, 0.006), (0.85 * r, 0.007), (0.3 * r, 0.003)], sides=24).turned(
            rotation_x(np.pi / 2)
        )
        piece.add(cone.moved((0, -0.45 * w, z)), looks.metal)
    return piece


def tissue_box(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A box of tissues with one pulled out."""
    piece = Assembly("objects")
    piece.add(box((0.23, 0.12, rng.uniform(0.06, 0.1)), bevel=0.003), looks.thing())
    high = float(piece.bounds()[1, 2])
    piece.add(
        loft(
            [
                ring((0.09, 0.02), (0, 0, high - 0.01), 0.8, 12),
                ring((0.1, 0.05), (0.01, 0, high + 0.04), 0.8, 12),
                ring((0.03, 0.02), (0.02, 0.01, high + 0.08), 0.8, 12),
            ],
            sharp=0.2,
        ),
        finishes.paper(looks),
    )
    return piece


def soap_bottle(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A pump or shampoo bottle."""
    piece, h = Assembly("objects"), rng.uniform(0.12, 0.22)
    w, d = rng.uniform(0.055, 0.08), rng.uniform(0.04, 0.05)
    piece.add(
        loft(
            [
                ring((w * f, d * f), (0, 0, z * h), 0.6, 24)
                for f, z in ((0.95, 0), (1, 0.05), (1, 0.7), (0.5, 0.8))
            ]
        ),
        looks.thing(),
    )
    piece.add(cylinder(0.014, 0.2 * h, (0, 0, 0.79 * h), 16), finishes.porcelain(looks))
    if rng.random() < 0.6:
        piece.add(box((0.016, 0.05, 0.012), (0, -0.015, 0.98 * h), 0.004), finishes.porcelain(looks))
    return piece


def open_book(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A book that lies open."""
    piece, w, h = Assembly("books"), rng.uniform(0.13, 0.18), rng.uniform(0.2, 0.27)
    piece.add(box((2 * w + 0.01, h + 0.01, 0.004)), looks.thing())
    for side in (-1, 1):
        page = [
            (0.0, 0.0),
            (side * w, 0.0),
            (side * w, 0.012),
            (side * 0.6 * w, 0.026),
            (side * 0.15 * w, 0.026),
        ]
        half = prism(page if side > 0 else page[::-1], h)
        piece.add(half.moved((0, 0, 0.004)), finishes.paper(looks))
    return piece
