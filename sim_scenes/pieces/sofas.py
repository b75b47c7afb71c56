"""Sofas, corner sofas, armchairs and day beds, and what is thrown over them."""

import numpy as np

from dsmap.sim_scenes.geometry.shapes import Shape, box, cushion, rotation_x, rotation_z
from dsmap.sim_scenes.pieces.legs import straight_legs
from dsmap.sim_scenes.pieces.soft_goods import draped_blanket, throw_cushion
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures import finishes
from dsmap.sim_scenes.textures.palette import Looks


def _cloth(rng: np.random.Generator, looks: Looks) -> str:
    return finishes.leather(looks) if rng.random() < 0.25 else looks.fabric()


def _row(seats: int, seat: float, depth: float, sit: float, back: float) -> list[Shape]:
    """Seat and back cushions side by side over x, backs at +y = depth / 2, shapes in one list."""
    shapes = []
    for k in range(seats):
        x = (k - (seats - 1) / 2) * seat
        shapes.append(cushion((seat - 0.012, depth - 0.26, 0.17), (x, -0.12, sit - 0.16), 0.2))
        rest = cushion((seat - 0.02, 0.19, back - sit + 0.02), softness=0.3).turned(rotation_x(-0.18))
        shapes.append(rest.moved((x, depth / 2 - 0.34, sit - 0.01)))
    return shapes


def throw_on(
    rng: np.random.Generator, looks: Looks, piece: Assembly, width: float, y: float, sit: float, count: int
) -> None:
    """Lean `count` cushions against the back of a seat of a given width [m], from both ends inwards."""
    for k in range(count):
        side = -1 if k % 2 == 0 else 1
        x = side * (width / 2 - 0.24 - 0.4 * (k // 2) - rng.uniform(0, 0.06))
        leaning = throw_cushion(rng, looks, upright=True)
        piece.attach(leaning, (x, y, sit), side * rng.uniform(-0.25, 0.15))


def sofa(rng: np.random.Generator, looks: Looks, seats: int = 3) -> Assembly:
    """A sofa of 1 (armchair), 2 or 3 seats with separate cushions and, mostly, throw pillows."""
    piece = Assembly("sofa")
    cloth, seat_cloth = looks.fabric(), looks.fabric() if rng.random() < 0.3 else None
    seat_cloth = seat_cloth or cloth
    seat, depth, arm = rng.uniform(0.58, 0.68), rng.uniform(0.82, 0.95), rng.uniform(0.12, 0.2)
    width, base, sit = seats * seat + 2 * arm, rng.uniform(0.08, 0.14), rng.uniform(0.40, 0.46)
    back, arm_height = rng.uniform(0.78, 0.92), rng.uniform(0.56, 0.66)
    piece.add(box((width - 0.02, depth - 0.04, sit - 0.14 - base), (0, 0, base), 0.015), cloth)
    piece.add(box((width - 0.04, 0.22, back - base), (0, depth / 2 - 0.11, base), 0.04), cloth)
    for side in (-1, 1):
        piece.add(box((arm, depth, arm_height - base), (side * (width - arm) / 2, 0, base), 0.035), cloth)
    for k in range(seats):
        x = (k - (seats - 1) / 2) * seat
        piece.add(cushion((seat - 0.01, depth - 0.24, 0.17), (x, -0.11, sit - 0.16), 0.22), seat_cloth)
        slant = cushion((seat - 0.02, 0.2, back - sit + 0.04), softness=0.3).turned(rotation_x(-0.2))
        piece.add(slant.moved((x, depth / 2 - 0.36, sit - 0.01)), seat_cloth)
    straight_legs(piece, looks.wood(), width - 0.06, depth - 0.06, base, 0.06, rng.random() < 0.5)
    for _ in range(rng.integers(0, 1 + min(seats, 2) + 1)):
        side = rng.choice([-1, 1])
        x = side * (width / 2 - arm - 0.24 - rng.uniform(0, 0.1)) if seats > 1 else 0.0
        pillow = cushion((0.42, 0.14, 0.4), softness=0.55).turned(rotation_x(-0.45))
        thrown = Assembly("objects")
        thrown.add(pillow, looks.fabric())
        piece.attach(thrown, (x, -0.02, sit + 0.02), side * rng.uniform(-0.3, 0.1))
        if seats == 1:
            break
    return piece


def corner_sofa(rng: np.random.Generator, looks: Looks) -> Assembly:
    """An L-shaped sofa: a row of seats along the wall and a long seat (chaise) forward at one end."""
    piece = Assembly("sofa")
    cloth, seats, hand = _cloth(rng, looks), int(rng.integers(2, 4)), rng.choice([-1, 1])
    seat, depth, arm = rng.uniform(0.68, 0.8), rng.uniform(0.88, 0.98), rng.uniform(0.14, 0.22)
    base, sit, back = rng.uniform(0.05, 0.12), rng.uniform(0.4, 0.45), rng.uniform(0.76, 0.9)
    chaise = rng.uniform(1.45, 1.75)
    inner = (seats + 1) * seat
    width = inner + 2 * arm
    middle = (chaise - depth) / 2
    back_y = middle + depth / 2
    piece.add(box((inner, depth - 0.02, sit - 0.14 - base), (0, middle, base), 0.015), cloth)
    piece.add(box((width - 0.02, 0.2, back - base), (0, back_y - 0.1, base), 0.04), cloth)
    for shape in _row(seats, seat, depth, sit, back):
        piece.add(shape.moved((-hand * seat / 2, middle, 0)), cloth)
    x = hand * (inner - seat) / 2
    front = chaise - depth
    piece.add(box((seat, front + 0.02, sit - 0.14 - base), (x, -depth / 2 + 0.01, base), 0.015), cloth)
    piece.add(cushion((seat - 0.012, chaise - 0.3, 0.17), (x, -0.14, sit - 0.16), 0.14), cloth)
    rest = cushion((seat - 0.02, 0.19, back - sit + 0.02), softness=0.3).turned(rotation_x(-0.18))
    piece.add(rest.moved((x, back_y - 0.34, sit - 0.01)), cloth)
    high = rng.uniform(0.55, 0.64)
    for side in (-1, 1):
        at = (side * (width - arm) / 2, middle, base)
        piece.add(box((arm, depth, high - base), at, 0.035), cloth)
    for cx in (-width / 2 + 0.08, width / 2 - 0.08):
        for cy in (middle - depth / 2 + 0.08, back_y - 0.08):
            piece.add(box((0.05, 0.05, base + 0.005), (cx, cy, 0)), looks.metal)
    piece.add(box((0.05, 0.05, base + 0.005), (x, -chaise / 2 + 0.1, 0)), looks.metal)
    throw_on(rng, looks, piece, inner, back_y - 0.46, sit, int(rng.integers(1, 5)))
    return piece


def armchair(rng: np.random.Generator, looks: Looks) -> Assembly:
    """An easy chair: boxy, round-backed (tub), or winged, with a loose seat cushion."""
    piece = Assembly("sofa")
    cloth, wood = _cloth(rng, looks), looks.wood()
    width, depth = rng.uniform(0.72, 0.88), rng.uniform(0.74, 0.85)
    sit, kind = rng.uniform(0.4, 0.45), int(rng.integers(3))
    back = (rng.uniform(0.75, 0.85), rng.uniform(0.68, 0.76), rng.uniform(0.95, 1.08))[kind]
    foot = rng.uniform(0.1, 0.2)
    for x in (-1, 1):
        for y in (-1, 1):
            piece.add(box((0.04, 0.04, foot + 0.01), (x * (width / 2 - 0.1), y * (depth / 2 - 0.1), 0)), wood)
    seat_width = width - 0.24
    if kind == 1:
        for angle in np.linspace(-2.0, 2.0, 9):
            high = back - 0.14 * (abs(angle) / 2.0) ** 2
            wedge = box((0.23, 0.12, high - foot), (0, 0, foot), 0.045).turned(rotation_z(-angle))
            piece.add(
                wedge.moved((np.sin(angle) * (width / 2 - 0.06), np.cos(angle) * (depth / 2 - 0.06), 0)),
                cloth,
            )
    else:
        for side in (-1, 1):
            arm = box(
                (0.13, depth - 0.06, rng.uniform(0.57, 0.62) - foot),
                (side * (width / 2 - 0.065), -0.02, foot),
                0.04,
            )
            piece.add(arm, cloth)
            if kind == 2:
                wing = box(
                    (0.07, 0.26, back - 0.62), (side * (width / 2 - 0.07), depth / 2 - 0.17, 0.57), 0.03
                )
                piece.add(wing, cloth)
        piece.add(box((width - 0.1, 0.18, back - foot), (0, depth / 2 - 0.1, foot), 0.06), cloth)
    piece.add(box((width - 0.16, depth - 0.16, sit - 0.12 - foot), (0, 0.0, foot), 0.02), cloth)
    piece.add(cushion((seat_width, depth - 0.2, 0.16), (0, -0.07, sit - 0.14), 0.22), cloth)
    if rng.random() < 0.5:
        throw_on(rng, looks, piece, 0.48, depth / 2 - 0.26, sit + 0.01, 1)
    return piece


def day_bed(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A chaise longue: a long padded seat on short legs with one raised end."""
    piece = Assembly("sofa")
    cloth, width, depth, sit = _cloth(rng, looks), rng.uniform(1.5, 1.8), rng.uniform(0.65, 0.75), 0.42
    piece.add(box((width, depth, 0.12), (0, 0, 0.16), 0.03), cloth)
    piece.add(cushion((width - 0.02, depth - 0.02, 0.16), (0, 0, 0.26), 0.14), cloth)
    raised = cushion((0.2, depth - 0.02, 0.42), softness=0.35).turned(rotation_z(np.pi))
    piece.add(raised.moved((-width / 2 + 0.12, 0, 0.34)), cloth)
    piece.add(box((0.6 * width, 0.1, 0.34), (-0.18 * width, depth / 2 - 0.06, 0.36), 0.04), cloth)
    for x in (-1, 1):
        for y in (-1, 1):
            piece.add(
                box((0.045, 0.045, 0.17), (x * (width / 2 - 0.08), y * (depth / 2 - 0.08), 0)), looks.wood()
            )
    piece.attach(draped_blanket(rng, looks, 0.5, depth - 0.06, 0.2), (width / 4, 0, sit + 0.012))
    return piece
