"""The plain sofa, chairs and tables, assembled from boxes, cushions and turned legs with realistic sizes.

Every function draws its sizes from `rng`, its materials from `looks`, and returns an `Assembly`: floor
centre at the origin, front towards -y.
"""

import numpy as np

from dsmap.sim_scenes.geometry.lofts import tube
from dsmap.sim_scenes.geometry.shapes import box, cushion, cylinder, lathe, rotation_x
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures import finishes
from dsmap.sim_scenes.textures.palette import Looks
from dsmap.sim_scenes.textures.patterns import Rng


def _legs(
    piece: Assembly, material: str, width: float, depth: float, height: float, thick: float, square: bool
) -> None:
    for x in (-1, 1):
        for y in (-1, 1):
            at = (x * (width / 2 - thick), y * (depth / 2 - thick), 0)
            if square:
                piece.add(box((thick, thick, height), at), material)
            else:
                piece.add(lathe([(thick * 0.35, 0), (thick * 0.6, height)], at, 16), material)


def sofa(rng: Rng, looks: Looks, seats: int = 3) -> Assembly:
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
    _legs(piece, looks.wood(), width - 0.06, depth - 0.06, base, 0.06, rng.random() < 0.5)
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


def chair(rng: Rng, looks: Looks) -> Assembly:
    """A dining chair: four legs, a seat (bare or upholstered), a back of slats, rails or a panel."""
    piece = Assembly("chair")
    wood, width, depth = looks.wood(), rng.uniform(0.4, 0.46), rng.uniform(0.4, 0.46)
    sit, back, thick = rng.uniform(0.44, 0.47), rng.uniform(0.82, 1.0), rng.uniform(0.032, 0.045)
    _legs(piece, wood, width, depth, sit - 0.03, thick, True)
    piece.add(box((width, depth, 0.035), (0, 0, sit - 0.035), 0.01), wood)
    if rng.random() < 0.6:
        piece.add(cushion((width - 0.03, depth - 0.04, 0.06), (0, -0.005, sit - 0.005), 0.25), looks.fabric())
    y = depth / 2 - thick
    for side in (-1, 1):
        piece.add(box((thick, thick, back - sit), (side * (width / 2 - thick), y, sit)), wood)
    inner = width - 3 * thick
    kind = rng.integers(3)
    piece.add(box((inner, 0.025, 0.07), (0, y, back - 0.075), 0.006), wood)
    if kind == 0:
        for x in np.linspace(-inner / 2 + 0.04, inner / 2 - 0.04, rng.integers(3, 6)):
            piece.add(box((0.03, 0.018, back - sit - 0.13), (x, y, sit + 0.06)), wood)
        piece.add(box((inner, 0.022, 0.04), (0, y, sit + 0.05)), wood)
    elif kind == 1:
        for z in np.linspace(sit + 0.1, back - 0.17, 2):
            piece.add(box((inner, 0.022, 0.06), (0, y, z), 0.005), wood)
    else:
        piece.add(box((inner, 0.02, back - sit - 0.17), (0, y, sit + 0.08), 0.006), looks.fabric())
    return piece


def office_chair(rng: Rng, looks: Looks) -> Assembly:
    """A swivel chair on five castors: a low task chair, a high-backed leather one, or one with a mesh back."""
    piece, kind = Assembly("chair"), int(rng.integers(3))
    cloth, sit = (finishes.leather(looks) if kind == 1 else looks.fabric()), rng.uniform(0.44, 0.52)
    base = finishes.steel(looks) if rng.random() < 0.3 else finishes.dark(looks)
    for angle in np.arange(5) * 2 * np.pi / 5 + 0.3:
        piece.add(box((0.3, 0.045, 0.035), (0.15, 0, 0.065), 0.008).moved(yaw=angle), base)
        caster = (
            cylinder(0.028, 0.045, sides=16).turned(rotation_x(np.pi / 2)).moved((0, 0.022, 0.028), angle)
        )
        piece.add(caster.moved((0.28 * np.cos(angle), 0.28 * np.sin(angle), 0)), finishes.dark(looks))
    piece.add(cylinder(0.03, sit - 0.15, (0, 0, 0.07), 20), base)
    piece.add(box((0.22, 0.2, 0.03), (0, 0, sit - 0.105)), base)
    width = rng.uniform(0.46, 0.52)
    piece.add(cushion((width, 0.48, 0.12 if kind == 1 else 0.09), (0, 0, sit - 0.08), 0.3), cloth)
    tall = (rng.uniform(0.42, 0.52), rng.uniform(0.62, 0.72), rng.uniform(0.52, 0.62))[kind]
    thick = (0.08, 0.12, 0.035)[kind]
    low = 0.03 if kind == 1 else 0.1
    piece.add(tube([(0, 0.1, sit - 0.09), (0, 0.25, sit - 0.06), (0, 0.29, sit + 0.3)], 0.02), base)
    back = cushion((width - 0.03, thick, tall), softness=0.3).turned(rotation_x(-0.12))
    piece.add(
        back.moved((0, 0.22, sit + low)), finishes.dark(looks) if kind == 2 and rng.random() < 0.6 else cloth
    )
    if kind == 2 and rng.random() < 0.5:
        piece.add(cushion((0.28, 0.07, 0.16), (0, 0.31, sit + tall + 0.1), 0.4), cloth)
        piece.add(tube([(0, 0.29, sit + 0.3), (0, 0.325, sit + tall + 0.16)], 0.014), base)
    if kind == 1 or rng.random() < 0.6:
        for side in (-1, 1):
            piece.add(
                box((0.06, 0.27, 0.03), (side * (width / 2 + 0.03), 0.02, sit + 0.19), 0.012),
                finishes.dark(looks),
            )
            post = [
                (side * 0.1, 0.06, sit - 0.09),
                (side * (width / 2 + 0.03), 0.06, sit - 0.08),
                (side * (width / 2 + 0.03), 0.06, sit + 0.2),
            ]
            piece.add(tube(post, 0.013), base)
    return piece


def table(rng: Rng, looks: Looks, width: float, depth: float, height: float) -> Assembly:
    """A table with four legs and an apron, or a round top on one foot where it is nearly square."""
    piece = Assembly("table")
    wood = looks.wood()
    top = looks.wood() if rng.random() < 0.3 else wood
    thick = rng.uniform(0.025, 0.045)
    if abs(width - depth) < 0.06:
        radius = width / 2
        edge = [(radius - 0.008, 0), (radius, 0.008), (radius, thick - 0.008), (radius - 0.008, thick)]
        piece.add(lathe(edge, (0, 0, height - thick), 48), top)
        foot = [(radius * 0.55, 0), (radius * 0.52, 0.03), (0.06, 0.07), (0.045, 0.2), (0.05, height - thick)]
        piece.add(lathe(foot, sides=32), wood)
        inner = 0.66 * radius
    else:
        piece.add(box((width, depth, thick), (0, 0, height - thick), 0.008), top)
        leg = rng.uniform(0.045, 0.075)
        _legs(piece, wood, width - 0.04, depth - 0.04, height - thick, leg, rng.random() < 0.7)
        apron = min(0.09, 0.2 * height)
        for side in (-1, 1):
            piece.add(
                box(
                    (width - 4 * leg, 0.02, apron),
                    (0, side * (depth / 2 - 1.2 * leg), height - thick - apron),
                ),
                wood,
            )
            piece.add(
                box(
                    (0.02, depth - 4 * leg, apron),
                    (side * (width / 2 - 1.2 * leg), 0, height - thick - apron),
                ),
                wood,
            )
        inner = 0.0
    x, y = (inner, inner) if inner else (width / 2 - 0.06, depth / 2 - 0.06)
    piece.surfaces.append((-x, -y, x, y, height))
    return piece


def coffee_table(rng: Rng, looks: Looks) -> Assembly:
    """A low table, with a shelf under the top at times."""
    width, depth, height = rng.uniform(0.85, 1.2), rng.uniform(0.5, 0.65), rng.uniform(0.38, 0.46)
    if rng.random() < 0.25:
        width = depth = rng.uniform(0.75, 0.95)
    piece = table(rng, looks, width, depth, height)
    if width != depth and rng.random() < 0.5:
        piece.add(box((width - 0.16, depth - 0.16, 0.02), (0, 0, 0.12)), looks.wood())
        piece.surfaces.append(
            (-width / 2 + 0.16, -depth / 2 + 0.14, width / 2 - 0.16, depth / 2 - 0.14, 0.14)
        )
    return piece
