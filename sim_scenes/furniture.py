"""Seats, tables, beds and cases, assembled from boxes, cushions and turned legs with realistic sizes.

Every function draws its sizes from `rng`, its materials from `looks`, and returns an `Assembly`: floor
centre at the origin, front towards -y.
"""

import numpy as np

from dsmap.sim_scenes.looks import Looks
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.shapes import Shape, box, cushion, cylinder, lathe, rotation_x, sheet
from dsmap.sim_scenes.textures import Rng, noise


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
    """A swivel chair on five castors with an upholstered seat and back."""
    piece = Assembly("chair")
    cloth, sit = looks.fabric(), rng.uniform(0.44, 0.52)
    for angle in np.arange(5) * 2 * np.pi / 5 + 0.3:
        arm = box((0.3, 0.045, 0.035), (0.15, 0, 0.065), 0.008).moved(yaw=angle)
        piece.add(arm, looks.metal)
        piece.add(cylinder(0.028, 0.06, (0.28 * np.cos(angle), 0.28 * np.sin(angle), 0), 16), looks.metal)
    piece.add(cylinder(0.03, sit - 0.12, (0, 0, 0.07), 20), looks.metal)
    piece.add(cushion((0.5, 0.48, 0.11), (0, 0, sit - 0.09), 0.3), cloth)
    piece.add(box((0.06, 0.03, 0.3), (0, 0.25, sit - 0.07)), looks.metal)
    back = cushion((0.46, 0.09, rng.uniform(0.5, 0.62)), softness=0.35).turned(rotation_x(-0.12))
    piece.add(back.moved((0, 0.22, sit + 0.1)), cloth)
    if rng.random() < 0.6:
        for side in (-1, 1):
            piece.add(box((0.05, 0.26, 0.03), (side * 0.27, 0.02, sit + 0.19), 0.01), looks.metal)
            piece.add(box((0.03, 0.04, 0.24), (side * 0.27, 0.06, sit - 0.05)), looks.metal)
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


def bed(rng: Rng, looks: Looks) -> Assembly:
    """A single or double bed: frame, headboard at +y, mattress, hanging blanket with folds, pillows."""
    piece = Assembly("bed")
    width, length = rng.choice([0.95, 1.4, 1.6, 1.8]), rng.uniform(1.98, 2.08)
    wood, sheet_cloth, blanket = looks.wood(), looks.fabric(), looks.fabric()
    rail, lying, head = rng.uniform(0.26, 0.34), rng.uniform(0.46, 0.56), rng.uniform(0.85, 1.15)
    piece.add(box((width + 0.06, length + 0.04, 0.16), (0, 0, rail - 0.16), 0.012), wood)
    _legs(piece, wood, width, length, rail - 0.15, 0.08, True)
    if rng.random() < 0.5:
        piece.add(box((width + 0.1, 0.1, head - 0.08), (0, length / 2 + 0.05, 0.08), 0.03), looks.fabric())
    else:
        piece.add(box((width + 0.08, 0.05, head - 0.15), (0, length / 2 + 0.03, 0.15), 0.012), wood)
        for z in np.linspace(rail + 0.3, head - 0.14, 3):
            piece.add(box((width - 0.12, 0.02, 0.1), (0, length / 2 - 0.005, z), 0.006), wood)
    piece.add(cushion((width, length, lying - rail + 0.02), (0, -0.01, rail - 0.02), 0.12), sheet_cloth)
    cover = length * rng.uniform(0.62, 0.78)
    piece.add(
        _blanket(rng, width + 0.1, cover, lying, rail - 0.06).moved((0, -length / 2 + cover / 2 - 0.04, 0)),
        blanket,
    )
    count = 1 if width < 1.2 else 2
    for k in range(count):
        x = (k - (count - 1) / 2) * width / 2 + rng.uniform(-0.03, 0.03)
        pillow = Assembly("objects")
        pillow.add(
            cushion((rng.uniform(0.55, 0.65), 0.4, 0.15), softness=0.5).turned(rotation_x(-0.2)),
            looks.fabric(),
        )
        piece.attach(pillow, (x, length / 2 - 0.28, lying + 0.03), rng.uniform(-0.12, 0.12))
    return piece


def _blanket(rng: Rng, width: float, length: float, top: float, bottom: float) -> Shape:
    """A blanket that lies on a mattress and hangs over both sides, with wrinkles; a closed sheet."""
    drop = top - bottom
    half = width / 2
    across = np.concatenate(
        [
            np.linspace(-half - drop, -half, 8)[:-1],
            np.linspace(-half, half, 33),
            np.linspace(half, half + drop, 8)[1:],
        ]
    )
    along = np.linspace(-length / 2, length / 2, 40)
    hang = np.clip(np.abs(across) - half, 0, None)
    x = np.sign(across) * (np.minimum(np.abs(across), half) + 0.012 * np.minimum(hang / 0.03, 1))
    bump = 0.018 * noise(rng, (9, 11), (len(along), len(across))) + 0.009 * noise(
        rng, (18, 20), (len(along), len(across))
    )
    falls = 1 / (1 + np.exp(-(hang - 0.04) / 0.01)) * np.sin(along * rng.uniform(14, 22))[:, None] * 0.018
    points = np.empty((len(along), len(across), 3))
    points[..., 0] = x + np.sign(across) * falls
    points[..., 1] = along[:, None]
    points[..., 2] = top + 0.03 - hang + np.where(hang > 0, 0.2, 1.0) * (bump + 0.012)
    return sheet(points, 0.012)
