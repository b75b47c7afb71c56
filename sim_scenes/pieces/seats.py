"""Chairs of many families, office chairs, stools and soft seats."""

import numpy as np

from dsmap.sim_scenes.geometry.lofts import bow, loft, ring, tube
from dsmap.sim_scenes.geometry.shapes import Shape, box, cushion, cylinder, lathe, merged, rotation_x, sheet
from dsmap.sim_scenes.pieces.legs import straight_legs
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures import finishes
from dsmap.sim_scenes.textures.palette import Looks


def dining_chair(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A chair for a table, of one of five families."""
    family = (chair, chair, upholstered_chair, shell_chair, windsor_chair, folding_chair)
    return family[rng.choice(6, p=[0.2, 0.15, 0.22, 0.18, 0.17, 0.08])](rng, looks)


def splayed_legs(
    width: float, depth: float, height: float, radius: float = 0.017, splay: float = 0.05
) -> Shape:
    """Four round legs whose feet stand `splay` wider than a seat frame of width x depth [m]."""
    legs = []
    for x in (-1, 1):
        for y in (-1, 1):
            foot = (x * (width / 2 + splay), y * (depth / 2 + splay), 0.0)
            legs.append(tube([foot, (x * width / 2, y * depth / 2, height)], [0.7 * radius, radius]))
    return merged(legs)


def backrest(width: float, height: float, thick: float, curve: float, lean: float) -> Shape:
    """A curved upright plate, bottom centre at the origin, hollow side towards -y, leaning back by `lean` [rad]."""
    s, t = np.meshgrid(np.linspace(-0.5, 0.5, 13), np.linspace(0, 1, 9))
    narrow = 1 - 0.18 * np.clip(2 * t - 1, 0, 1) ** 3
    points = np.stack([s * width * narrow, -curve * 4 * s**2 + 0.0 * t, t * height], -1)
    points[..., 2] -= 0.18 * height * (2 * np.abs(s)) ** 4 * t
    return sheet(points, thick).turned(rotation_x(-lean))


def chair(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A dining chair: four legs, a seat (bare or upholstered), a back of slats, rails or a panel."""
    piece = Assembly("chair")
    wood, width, depth = looks.wood(), rng.uniform(0.4, 0.46), rng.uniform(0.4, 0.46)
    sit, back, thick = rng.uniform(0.44, 0.47), rng.uniform(0.82, 1.0), rng.uniform(0.032, 0.045)
    straight_legs(piece, wood, width, depth, sit - 0.03, thick, True)
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


def upholstered_chair(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A dining chair with a padded seat and a high padded back on four tapered legs, sometimes with arms."""
    piece = Assembly("chair")
    cloth = finishes.leather(looks) if rng.random() < 0.35 else looks.fabric()
    wood, width, depth = looks.wood(), rng.uniform(0.45, 0.52), rng.uniform(0.44, 0.5)
    sit, back = rng.uniform(0.45, 0.48), rng.uniform(0.82, 1.0)
    piece.add(splayed_legs(width - 0.1, depth - 0.1, sit - 0.09, 0.02, 0.02), wood)
    piece.add(cushion((width, depth, 0.11), (0, 0, sit - 0.1), 0.2), cloth)
    rest = cushion((width - 0.02, 0.075, back - sit + 0.1), softness=0.22).turned(rotation_x(-0.13))
    piece.add(rest.moved((0, depth / 2 - 0.07, sit - 0.1)), cloth)
    if rng.random() < 0.35:
        for side in (-1, 1):
            arm = bow((0, -0.16, sit - 0.02), (0, -0.2, sit + 0.26), (0, depth / 2 - 0.04, sit + 0.2))
            piece.add(tube(arm, 0.016).moved((side * (width / 2 + 0.005), 0, 0)), wood)
    return piece


def shell_chair(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A moulded plastic or plywood shell on splayed wooden or steel legs."""
    piece = Assembly("chair")
    colour = looks.thing() if rng.random() < 0.7 else looks.wood()
    width, sit, back = rng.uniform(0.44, 0.5), rng.uniform(0.43, 0.46), rng.uniform(0.32, 0.4)
    profile = np.array(
        [(-0.24, -0.035), (-0.22, 0.0), (-0.1, -0.012), (0.04, -0.015), (0.14, 0.01), (0.19, 0.07),
         (0.215, 0.18), (0.235, 0.3), (0.255, back)]
    )  # fmt: skip
    spread = np.array([0.8, 0.92, 1.0, 1.0, 1.0, 1.0, 0.97, 0.88, 0.66])
    s = np.linspace(-0.5, 0.5, 13)
    points = np.empty((len(profile), len(s), 3))
    points[..., 0] = s * width * spread[:, None]
    lift = np.clip(np.linspace(0.3, 1, len(profile)), 0, 1)[:, None] * 0.3 * (2 * np.abs(s)) ** 2.6 * 0.22
    points[..., 1] = profile[:, :1] - lift * (np.arange(len(profile)) > 4)[:, None]
    points[..., 2] = profile[:, 1:] + lift * (np.arange(len(profile)) <= 4)[:, None] + sit
    piece.add(sheet(points, 0.009), colour)
    if rng.random() < 0.5:
        piece.add(splayed_legs(0.24, 0.22, sit - 0.018, 0.018, 0.09), looks.wood())
        piece.add(box((0.26, 0.24, 0.014), (0, 0, sit - 0.038)), finishes.dark(looks))
    else:
        steel = finishes.steel(looks)
        piece.add(splayed_legs(0.3, 0.26, sit - 0.02, 0.011, 0.06), steel)
        for y in (-0.13, 0.13):
            piece.add(tube([(-0.15, y, sit - 0.03), (0.15, y, sit - 0.03)], 0.01), steel)
    if rng.random() < 0.4:
        piece.add(cushion((0.36, 0.35, 0.035), (0, -0.05, sit - 0.008), 0.35, 10), looks.fabric())
    return piece


def windsor_chair(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A wooden chair with a bowed back of spindles or ladder rungs, sometimes with arms."""
    piece = Assembly("chair")
    wood, width, sit, back = looks.wood(), rng.uniform(0.42, 0.48), 0.45, rng.uniform(0.86, 1.02)
    rings = [
        ring((width * f, 0.42 * f), (0, 0, sit + z), 0.65)
        for f, z in ((0.94, -0.032), (1, -0.02), (1, 0), (0.8, -0.008))
    ]
    piece.add(loft(rings), wood)
    piece.add(splayed_legs(0.3, 0.28, sit - 0.02, 0.019, 0.06), wood)
    for y in (-0.165, 0.165):
        piece.add(tube([(-0.17, y, 0.17), (0.17, y, 0.17)], 0.01), wood)
    top = back - sit
    if rng.random() < 0.5:
        t = np.linspace(0, np.pi, 25)
        hoop = np.column_stack(
            [-np.cos(t) * 0.19, 0.17 + 0.07 * np.sin(t), sit - 0.01 + np.sin(t) ** 0.7 * top]
        )
        piece.add(tube(hoop, 0.013), wood)
        for x in np.linspace(-0.13, 0.13, int(rng.integers(5, 8))):
            high = float(np.interp(x, hoop[:, 0], hoop[:, 2]))
            piece.add(
                tube([(x * 0.75, 0.165, sit - 0.01), (x, 0.17 + 0.07 * (high - sit) / top, high)], 0.007, 8),
                wood,
            )
    else:
        for side in (-1, 1):
            piece.add(tube([(side * 0.17, 0.17, sit - 0.02), (side * 0.18, 0.25, back)], 0.016), wood)
        for z in np.linspace(0.3, 0.92, int(rng.integers(3, 5))):
            slat = backrest(0.34, 0.06, 0.014, -0.03, 0.12)
            piece.add(slat.moved((0, 0.165 + 0.08 * z, sit + z * top - 0.05)), wood)
    if rng.random() < 0.3:
        for side in (-1, 1):
            piece.add(
                tube(
                    bow(
                        (side * 0.18, 0.2, sit + 0.22),
                        (side * 0.26, 0, sit + 0.24),
                        (side * 0.23, -0.17, sit + 0.2),
                    ),
                    0.014,
                ),
                wood,
            )
            piece.add(tube([(side * 0.2, -0.13, sit - 0.01), (side * 0.23, -0.14, sit + 0.2)], 0.011), wood)
    return piece


def folding_chair(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A folding chair: crossed bars at both sides, a slatted or plain seat and back."""
    piece = Assembly("chair")
    frame = finishes.steel(looks) if rng.random() < 0.5 else looks.wood()
    body = looks.thing() if rng.random() < 0.5 else looks.wood()
    width, sit, back = rng.uniform(0.4, 0.45), 0.45, rng.uniform(0.78, 0.86)
    for side in (-1, 1):
        x = side * width / 2
        piece.add(tube([(x, -0.22, 0.008), (x, 0.0, sit), (x, 0.2, back)], 0.012), frame)
        piece.add(tube([(x * 0.9, 0.24, 0.008), (x * 0.9, -0.17, sit - 0.02)], 0.012), frame)
    for y, z in ((-0.19, 0.06), (0.21, 0.06)):
        piece.add(tube([(-width / 2 * 0.95, y, z), (width / 2 * 0.95, y, z)], 0.009), frame)
    if rng.random() < 0.5:
        for y in np.linspace(-0.16, 0.14, 6):
            piece.add(box((width - 0.03, 0.042, 0.014), (0, y, sit - 0.012), 0.004), body)
    else:
        piece.add(box((width - 0.03, 0.36, 0.025), (0, -0.01, sit - 0.014), 0.01), body)
    piece.add(backrest(width - 0.03, 0.2, 0.014, 0.02, 0.45).moved((0, 0.13, back - 0.19)), body)
    return piece


def bar_stool(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A high stool with a low back, for a counter: four legs with a foot ring, or one column."""
    piece = Assembly("chair")
    sit, steel = rng.uniform(0.64, 0.8), finishes.steel(looks)
    seat = finishes.leather(looks) if rng.random() < 0.5 else looks.wood()
    piece.add(cushion((0.4, 0.38, 0.07), (0, 0, sit - 0.06), 0.3), seat)
    if rng.random() < 0.4:
        piece.add(lathe([(0.21, 0), (0.21, 0.012), (0.06, 0.03), (0.03, 0.06), (0.03, sit - 0.05)]), steel)
        piece.add(lathe([(0.15, -0.008), (0.15, 0.008)], (0, 0, 0.3), 24), steel)
    else:
        legs = looks.wood() if rng.random() < 0.5 else finishes.dark(looks)
        piece.add(splayed_legs(0.26, 0.24, sit - 0.05, 0.018, 0.06), legs)
        for a, b in (((-1, -1), (1, -1)), ((1, -1), (1, 1)), ((1, 1), (-1, 1)), ((-1, 1), (-1, -1))):
            piece.add(
                tube([(a[0] * 0.165, a[1] * 0.155, 0.28), (b[0] * 0.165, b[1] * 0.155, 0.28)], 0.01), legs
            )
    piece.add(backrest(0.38, rng.uniform(0.18, 0.34), 0.025, 0.05, 0.12).moved((0, 0.16, sit + 0.05)), seat)
    for side in (-1, 1):
        piece.add(tube([(side * 0.12, 0.15, sit - 0.02), (side * 0.12, 0.185, sit + 0.16)], 0.012), steel)
    return piece


def office_chair(rng: np.random.Generator, looks: Looks) -> Assembly:
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


def beanbag(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A slack round seat of cloth."""
    piece, size = Assembly("chair"), rng.uniform(0.75, 0.95)
    low = cushion((size, size, 0.45), softness=0.75, rings=20)
    piece.add(low, looks.fabric())
    hump = cushion((0.75 * size, 0.5 * size, 0.42), (0, 0.14 * size, 0.3), 0.8, 18)
    piece.add(hump, piece.parts[0][1])
    return piece


def pouf(rng: np.random.Generator, looks: Looks) -> Assembly:
    """An ottoman: a padded cube or drum."""
    piece, size, high = Assembly("furniture"), rng.uniform(0.4, 0.6), rng.uniform(0.36, 0.44)
    cloth = finishes.leather(looks) if rng.random() < 0.4 else looks.fabric()
    if rng.random() < 0.5:
        piece.add(cushion((size, size, high - 0.03), (0, 0, 0.03), 0.15), cloth)
    else:
        bulge = [
            (size / 2 * f, high * t)
            for f, t in ((0.86, 0), (0.97, 0.15), (1, 0.5), (0.97, 0.85), (0.88, 0.98), (0.0, 1.0))
        ]
        piece.add(lathe(bulge, (0, 0, 0.0)), cloth)
    piece.add(cylinder(0.3 * size, 0.03), finishes.dark(looks))
    piece.surfaces.append((-size / 4, -size / 4, size / 4, size / 4, high))
    return piece
