"""Tables: plain and round ones, desks, consoles, low and small ones (class table)."""

import numpy as np

from dsmap.sim_scenes.geometry.lofts import loft, ring, tube
from dsmap.sim_scenes.geometry.shapes import box, cylinder, lathe, merged
from dsmap.sim_scenes.pieces import storage
from dsmap.sim_scenes.pieces.legs import straight_legs
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures import finishes
from dsmap.sim_scenes.textures.palette import Looks


def _board(rng: np.random.Generator, looks: Looks) -> str:
    return (
        finishes.stone(looks) if rng.random() < 0.1 else looks.white if rng.random() < 0.2 else looks.wood()
    )


def _frame_legs(piece: Assembly, material: str, width: float, depth: float, height: float, kind: int) -> None:
    """Under a top at `height`: 0 square legs with rails, 1 trestles, 2 hairpins, 3 end frames of flat bars."""
    x, y = width / 2 - 0.08, depth / 2 - 0.07
    for sx in (-1, 1):
        if kind == 1:
            for sy in (-1, 1):
                piece.add(
                    tube([(sx * x, sy * y, 0.012), (sx * (x - 0.06), sy * 0.04, height)], 0.02, 8), material
                )
            piece.add(box((0.025, 0.5 * y, 0.04), (sx * (x - 0.025), 0, 0.35 * height)), material)
        elif kind == 3:
            piece.add(box((0.06, 0.03, height), (sx * x, -y, 0)), material)
            piece.add(box((0.06, 0.03, height), (sx * x, y, 0)), material)
            piece.add(box((0.06, 2 * y - 0.03, 0.03), (sx * x, 0, 0)), material)
            piece.add(box((0.06, 2 * y - 0.03, 0.03), (sx * x, 0, height - 0.03)), material)
        else:
            for sy in (-1, 1):
                at = (sx * x, sy * y)
                if kind == 0:
                    piece.add(box((0.055, 0.055, height), (*at, 0), 0.006), material)
                    continue
                for shift in ((0.07, 0), (0, 0.07)):
                    top = (at[0] - sx * shift[0], at[1] - sy * shift[1], height)
                    piece.add(tube([top, (*at, 0.007)], 0.006, 8), material)
    if kind == 0:
        for sy in (-1, 1):
            piece.add(box((2 * x - 0.055, 0.022, 0.08), (0, sy * y, height - 0.08)), material)
    if kind == 1:
        piece.add(box((2 * x - 0.1, 0.03, 0.05), (0, 0, height - 0.05)), material)


def table(rng: np.random.Generator, looks: Looks, width: float, depth: float, height: float) -> Assembly:
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
        straight_legs(piece, wood, width - 0.04, depth - 0.04, height - thick, leg, rng.random() < 0.7)
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


def coffee_table(rng: np.random.Generator, looks: Looks) -> Assembly:
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


def dining_table(rng: np.random.Generator, looks: Looks, seats: int = 4) -> Assembly:
    """A rectangular or oval table for 2 to 10 people."""
    piece = Assembly("table")
    width = max(0.75, 0.6 * np.ceil(seats / 2) + rng.uniform(0.0, 0.25))
    depth, height, thick = rng.uniform(0.78, 0.98), rng.uniform(0.72, 0.76), rng.uniform(0.025, 0.045)
    depth = min(depth, width)
    top = _board(rng, looks)
    low = height - thick
    if rng.random() < 0.25 and width > 1.1:
        edges = [((width - 0.02, depth - 0.02), 0), ((width, depth), 0.01), ((width, depth), thick)]
        piece.add(loft([ring(s, (0, 0, low + z), 0.65, 48) for s, z in edges]), top)
    else:
        piece.add(box((width, depth, thick), (0, 0, low), 0.008), top)
    legs = looks.wood() if rng.random() < 0.65 else finishes.dark(looks)
    _frame_legs(piece, legs, 0.93 * width, 0.93 * depth, low, int(rng.choice([0, 0, 1, 3])))
    piece.surfaces.append((-0.4 * width, -0.38 * depth, 0.4 * width, 0.38 * depth, height))
    return piece


def round_table(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A round table of 0.7 to 1.25 m on a foot or four splayed legs."""
    piece = Assembly("table")
    radius, height = rng.uniform(0.36, 0.62), rng.uniform(0.72, 0.76)
    edge = [(radius - 0.012, 0), (radius, 0.012), (radius, 0.024), (radius - 0.008, 0.03)]
    piece.add(lathe(edge, (0, 0, height - 0.03), 48), _board(rng, looks))
    if rng.random() < 0.5:
        stem = [(0.05, 0.05), (0.035, 0.12), (0.035, height - 0.06), (0.2, height - 0.03)]
        foot = [(0.6 * radius, 0), (0.58 * radius, 0.018), *stem]
        piece.add(lathe(foot, sides=32), finishes.dark(looks) if rng.random() < 0.5 else looks.white)
    else:
        legs = looks.wood()
        for angle in np.arange(4) * np.pi / 2 + np.pi / 4:
            direction = np.array([np.cos(angle), np.sin(angle), 0])
            top = 0.5 * radius * direction + [0, 0, height - 0.028]
            piece.add(tube([0.72 * radius * direction + [0, 0, 0.005], top], [0.015, 0.024], 12), legs)
        piece.add(box((0.72 * radius, 0.72 * radius, 0.05), (0, 0, height - 0.08)), legs)
    side = 0.6 * radius
    piece.surfaces.append((-side, -side, side, side, height))
    return piece


def low_table(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A coffee table of another shape: oval, a drum, a slab on a box, or two boards on a metal frame."""
    piece, kind = Assembly("table"), int(rng.integers(4))
    width, depth, height = rng.uniform(0.85, 1.25), rng.uniform(0.5, 0.7), rng.uniform(0.34, 0.46)
    top, other = _board(rng, looks), looks.wood() if rng.random() < 0.5 else finishes.dark(looks)
    inset = 0.06
    if kind == 0:
        edges = [((width - 0.02, depth - 0.02), 0), ((width, depth), 0.01), ((width, depth), 0.028)]
        piece.add(loft([ring(s, (0, 0, height - 0.028 + z), 0.85, 48) for s, z in edges]), top)
        _frame_legs(piece, other, 0.72 * width, 0.7 * depth, height - 0.028, 2)
        inset = 0.18
    elif kind == 1:
        width = depth = rng.uniform(0.6, 0.85)
        drum = [(0.46, 0.0), (0.5, 0.04), (0.5, height - 0.01), (0.48, height)]
        piece.add(lathe([(r * width, z) for r, z in drum], sides=48), top)
        inset = 0.15 * width + 0.02
    elif kind == 2:
        piece.add(box((width, depth, 0.05), (0, 0, height - 0.05), 0.008), top)
        piece.add(box((0.6 * width, 0.6 * depth, height - 0.05), (0, 0, 0)), other)
    else:
        piece.add(box((width, depth, 0.022), (0, 0, height - 0.022), 0.005), top)
        _frame_legs(piece, other, width + 0.1, depth + 0.08, height - 0.022, 0)
        piece.add(box((width - 0.07, depth - 0.07, 0.018), (0, 0, 0.12)), top)
        piece.surfaces.append((-width / 2 + 0.1, -depth / 2 + 0.1, width / 2 - 0.1, depth / 2 - 0.1, 0.138))
    piece.surfaces.append(
        (-width / 2 + inset, -depth / 2 + inset, width / 2 - inset, depth / 2 - inset, height)
    )
    return piece


def side_table(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A small table beside a sofa: round on one leg, or a cube frame with two boards."""
    piece, size, height = Assembly("table"), rng.uniform(0.36, 0.5), rng.uniform(0.45, 0.6)
    top, metal = _board(rng, looks), finishes.dark(looks)
    if rng.random() < 0.5:
        piece.add(lathe([(size / 2, 0), (size / 2, 0.02)], (0, 0, height - 0.02)), top)
        piece.add(
            lathe([(0.36 * size, 0), (0.36 * size, 0.014), (0.016, 0.02), (0.016, height - 0.02)]), metal
        )
        piece.surfaces.append((-0.3 * size, -0.3 * size, 0.3 * size, 0.3 * size, height))
        return piece
    piece.add(box((size, size, 0.02), (0, 0, height - 0.02), 0.004), top)
    piece.add(box((size - 0.07, size - 0.07, 0.016), (0, 0, 0.14)), top)
    for x in (-1, 1):
        for y in (-1, 1):
            piece.add(
                box((0.025, 0.025, height - 0.02), (x * (size / 2 - 0.03), y * (size / 2 - 0.03), 0)), metal
            )
    for z in (height, 0.156):
        half = size / 2 - (0.05 if z == height else 0.08)
        piece.surfaces.append((-half, -half, half, half, z))
    return piece


def console_table(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A narrow table for a corridor, with a drawer or a lower shelf."""
    piece = Assembly("table")
    width, depth, height = rng.uniform(0.8, 1.25), rng.uniform(0.28, 0.38), rng.uniform(0.76, 0.88)
    top, legs = _board(rng, looks), looks.wood() if rng.random() < 0.6 else finishes.dark(looks)
    piece.add(box((width, depth, 0.028), (0, 0, height - 0.028), 0.005), top)
    _frame_legs(piece, legs, width + 0.08, depth + 0.07, height - 0.028, 0)
    piece.surfaces.append((-width / 2 + 0.05, -depth / 2 + 0.04, width / 2 - 0.05, depth / 2 - 0.04, height))
    if rng.random() < 0.6:
        piece.add(box((width - 0.06, depth - 0.06, 0.02), (0, 0, 0.16)), top)
        piece.surfaces.append((-width / 2 + 0.1, -depth / 2 + 0.07, width / 2 - 0.1, depth / 2 - 0.07, 0.18))
    return piece


def desk(
    rng: np.random.Generator, looks: Looks, width: float | None = None, depth: float | None = None
) -> Assembly:
    """A work desk: legs or frame, with a pedestal of drawers at one side two times of three."""
    piece = Assembly("table")
    width = rng.uniform(1.1, 1.7) if width is None else width
    depth, height = rng.uniform(0.58, 0.78) if depth is None else depth, rng.uniform(0.71, 0.75)
    top, kind = _board(rng, looks), int(rng.choice([0, 1, 3]))
    piece.add(box((width, depth, 0.026), (0, 0, height - 0.026), 0.004), top)
    legs = looks.wood() if rng.random() < 0.4 else finishes.dark(looks)
    _frame_legs(piece, legs, width + 0.06, depth, height - 0.026, kind)
    if rng.random() < 0.65:
        side = rng.choice([-1, 1])
        piece.parts += [
            (shape.moved((side * (width / 2 - 0.34), 0.0, 0)), material, "furniture", 0)
            for shape, material, _, _ in storage.pedestal(
                rng, looks, min(depth, 0.6) - 0.1, height - 0.06
            ).parts
        ]
    piece.surfaces.append((-width / 2 + 0.05, -depth / 2 + 0.05, width / 2 - 0.05, depth / 2 - 0.05, height))
    return piece


def standing_desk(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A desk on two lifting columns, at sitting or standing height."""
    piece = Assembly("table")
    width, depth = rng.uniform(1.2, 1.7), rng.uniform(0.65, 0.8)
    height = rng.uniform(0.7, 0.76) if rng.random() < 0.6 else rng.uniform(0.95, 1.1)
    metal = finishes.dark(looks) if rng.random() < 0.5 else looks.white
    piece.add(box((width, depth, 0.026), (0, 0, height - 0.026), 0.004), _board(rng, looks))
    for side in (-1, 1):
        x = side * (width / 2 - 0.22)
        piece.add(box((0.07, depth - 0.06, 0.03), (x, 0, 0), 0.008), metal)
        piece.add(box((0.08, 0.06, 0.55), (x, 0, 0.03)), metal)
        piece.add(box((0.065, 0.045, height - 0.06 - 0.58), (x, 0, 0.58)), finishes.steel(looks))
        piece.add(box((0.05, depth - 0.15, 0.034), (x, 0, height - 0.06)), metal)
    piece.add(box((width - 0.5, 0.05, 0.034), (0, 0, height - 0.0601)), metal)
    piece.surfaces.append((-width / 2 + 0.05, -depth / 2 + 0.05, width / 2 - 0.05, depth / 2 - 0.05, height))
    return piece


def corner_desk(rng: np.random.Generator, looks: Looks) -> Assembly:
    """An L-shaped desk: the long board at the back (+y), the short one along one side."""
    piece = Assembly("table")
    width, reach, depth, height = rng.uniform(1.4, 1.8), rng.uniform(1.2, 1.5), 0.62, 0.73
    side, top, metal = rng.choice([-1, 1]), _board(rng, looks), finishes.dark(looks)
    y = reach / 2 - depth / 2
    piece.add(box((width, depth, 0.026), (0, y, height - 0.026), 0.003), top)
    arm = reach - depth
    x = side * (width / 2 - depth / 2)
    piece.add(box((depth, arm, 0.026), (x, -depth / 2, height - 0.026), 0.003), top)
    legs = [(-width / 2 + 0.06, y), (width / 2 - 0.06, y), (x, -reach / 2 + 0.06)]
    frames = [box((0.04, depth - 0.1, height - 0.026), (at[0], at[1], 0)) for at in legs[:2]]
    frames.append(box((depth - 0.1, 0.04, height - 0.026), (x, legs[2][1], 0)))
    piece.add(merged(frames), metal)
    piece.add(cylinder(0.03, 0.002, (-side * (width / 2 - 0.3), y + 0.2, height), 20), metal)
    low, high = -width / 2 + 0.05, width / 2 - 0.05
    piece.surfaces.append((low, y - depth / 2 + 0.05, high, y + depth / 2 - 0.05, height))
    piece.surfaces.append(
        (x - depth / 2 + 0.05, -reach / 2 + 0.05, x + depth / 2 - 0.05, y - depth / 2, height)
    )
    return piece
