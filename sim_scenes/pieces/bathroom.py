"""Bathrooms: tub, shower, toilet, basins, mirror cabinet, towel rails (objects; the cupboards are furniture)."""

import numpy as np

from dsmap.sim_scenes.geometry.lofts import bow, loft, plate_with_hole, ring, tube
from dsmap.sim_scenes.geometry.shapes import Shape, box, cylinder, lathe, panel, rotation_x, sheet
from dsmap.sim_scenes.pieces.soft_goods import hanging_towel
from dsmap.sim_scenes.scene import Assembly, Material
from dsmap.sim_scenes.textures import finishes
from dsmap.sim_scenes.textures.palette import Looks


def _tap(piece: Assembly, looks: Looks, at: tuple[float, float, float], reach: float, high: float) -> None:
    """A chrome mixer tap standing at `at` whose spout reaches forward (-y)."""
    x, y, z = at
    steel = finishes.steel(looks)
    line = bow((x, y, z), (x, y - 0.1 * reach, z + 1.7 * high), (x, y - reach, z + 0.75 * high))
    piece.add(tube(line, 0.013, 10), steel)
    piece.add(cylinder(0.024, 0.035, (x, y, z), 16), steel)
    piece.add(tube([(x, y, z + 0.7 * high), (x + 0.05, y + 0.02, z + 1.15 * high)], 0.007, 8), steel)


def bath_tub(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A bath tub along a wall (back at +y): panelled, or free-standing and oval; taps at one end."""
    piece, white = Assembly("objects"), finishes.porcelain(looks)
    w, d, h = rng.uniform(1.5, 1.8), rng.uniform(0.7, 0.8), rng.uniform(0.52, 0.6)
    oval = rng.random() < 0.3
    corner = 0.8 if oval else 0.06
    inner = 0.75 if oval else 0.42
    low = 0.86 if oval else 1.0
    rings = [ring((w * low, d * low), (0, 0, 0), corner, 64), ring((w, d), (0, 0, h - 0.03), corner, 64)]
    rings += [ring((w, d), (0, 0, h), corner, 64), ring((w - 0.12, d - 0.12), (0, 0, h), inner, 64)]
    rings += [ring((w - 0.2, d - 0.18), (0, 0, 0.45 * h), inner, 64)]
    rings += [ring((w - 0.4, d - 0.3), (0, 0, 0.16), inner, 64)]
    piece.add(loft(rings), white)
    end = rng.choice([-1, 1])
    _tap(piece, looks, (end * (w / 2 - 0.05), 0, h), 0.0, 0.11)
    spout = bow(
        (end * (w / 2 - 0.05), 0, h + 0.1),
        (end * (w / 2 - 0.08), 0, h + 0.17),
        (end * (w / 2 - 0.17), 0, h + 0.08),
    )
    piece.add(tube(spout, 0.012, 10), finishes.steel(looks))
    piece.add(cylinder(0.03, 0.003, (end * (w / 2 - 0.4), 0, 0.16), 18), finishes.steel(looks))
    if rng.random() < 0.4:
        rod = tube([(-w / 2, -d / 2 + 0.02, 2.0), (w / 2, -d / 2 + 0.02, 2.0)], 0.012)
        piece.add(rod, finishes.steel(looks))
        cloth = _shower_curtain(rng, rng.uniform(0.45, 0.9) * w, 1.55)
        piece.add(cloth.moved((end * 0.03, -d / 2 + 0.02, 0.44)), looks.fabric())
    return piece


def _shower_curtain(rng: np.random.Generator, width: float, height: float) -> Shape:
    s, t = np.meshgrid(np.linspace(0, 1, 61), np.linspace(0, 1, 8))
    folds = width * rng.uniform(7, 10)
    points = np.empty((8, 61, 3))
    points[..., 0] = (s - 0.5) * width
    points[..., 1] = 0.025 * np.sin(2 * np.pi * folds * s) * (1.2 - 0.4 * t) - 0.05 * (1 - t)
    points[..., 2] = t * height
    return sheet(points, 0.004)


def shower(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A corner shower: tray, two framed panes (modelled as thin frames: clear glass is not drawn), rail and head."""
    piece, steel, size = Assembly("objects"), finishes.steel(looks), rng.uniform(0.8, 1.0)
    rings = [ring((size, size), (0, 0, z), 0.08, 40) for z in (0, 0.05)]
    rings += [ring((size - 0.08, size - 0.08), (0, 0, z), 0.12, 40) for z in (0.05, 0.025)]
    piece.add(loft(rings), finishes.porcelain(looks))
    half, tall = size / 2 - 0.012, 1.95
    for x, y in ((-half, half), (-half, -half), (half, -half)):
        piece.add(box((0.024, 0.024, tall), (x, y, 0.05)), steel)
    for z in (0.05, 1.05, tall + 0.026):
        piece.add(box((0.022, size - 0.048, 0.024), (-half, 0, z)), steel)
        piece.add(box((size - 0.048, 0.022, 0.024), (0, -half, z)), steel)
    piece.add(tube([(half - 0.02, 0.1, 0.95), (half - 0.02, 0.1, 2.05)], 0.01), steel)
    arm = bow((half - 0.02, 0.1, 2.05), (half - 0.02, 0.1, 2.12), (half - 0.3, 0.1, 2.1))
    piece.add(tube(arm, 0.01), steel)
    piece.add(lathe([(0.1, 0), (0.1, 0.01), (0.02, 0.025)], (half - 0.3, 0.1, 2.075), 24), steel)
    piece.add(box((0.05, 0.2, 0.05), (half, 0.1, 0.95), 0.01), steel)
    if rng.random() < 0.6:
        cloth = _shower_curtain(rng, rng.uniform(0.4, 0.8) * size, 1.75)
        piece.add(cloth.moved((0, -half + 0.045, 0.2)), looks.fabric())
    return piece


def toilet(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A toilet: bowl on a foot or hung from the wall, lid up or down, with or without a cistern."""
    piece, white = Assembly("objects"), finishes.porcelain(looks)
    cistern, hung = rng.random() < 0.7, rng.random() < 0.3
    y = 0.08 if not cistern else -0.06
    base = 0.14 if hung else 0.0
    foot = (0.26, 0.36, 0.06) if not hung else (0.2, 0.34, 0.1)
    rings = [
        ring(foot[:2], (0, y + foot[2], base), 0.75),
        ring((foot[0] * 0.9, foot[1] * 0.9), (0, y + foot[2], base + 0.1), 0.8),
    ]
    rings += [
        ring((0.32, 0.44), (0, y + 0.02, 0.28), 0.85),
        ring((0.37, 0.5), (0, y, 0.37), 0.85),
        ring((0.37, 0.5), (0, y, 0.4), 0.85),
    ]
    rings += [
        ring((0.27, 0.36), (0, y - 0.03, 0.4), 0.9),
        ring((0.22, 0.28), (0, y - 0.02, 0.28), 0.9),
        ring((0.12, 0.14), (0, y, 0.2), 0.9),
    ]
    piece.add(loft(rings), white)
    back = y + 0.25
    lid = [
        ring((0.37 * f, 0.46 * f), (0, y - 0.02, z), 0.85)
        for f, z in ((1, 0.402), (1.01, 0.415), (0.97, 0.428))
    ]
    if rng.random() < 0.65:
        piece.add(loft(lid), white)
    else:
        seat = [((0.37, 0.47), 0.401), ((0.37, 0.47), 0.418), ((0.25, 0.33), 0.418), ((0.25, 0.33), 0.401)]
        hoop = [ring(s, (0, y - 0.02, z), 0.87) for s, z in [*seat, seat[0]]]
        piece.add(loft(hoop, caps=False), white)
        raised = loft([ring((0.36, 0.44), (0, 0, z), 0.85) for z in (0, 0.016)]).turned(
            rotation_x(np.pi / 2 - 0.12)
        )
        piece.add(raised.moved((0, back - 0.055, 0.42 + 0.22)), white)
    if cistern:
        piece.add(box((rng.uniform(0.36, 0.42), 0.17, 0.36), (0, back + 0.085, 0.4), 0.02), white)
        piece.add(box((0.43, 0.19, 0.025), (0, back + 0.085, 0.76), 0.008), white)
        piece.add(box((0.2, 0.12, 0.28), (0, back + 0.04, 0.13), 0.02), white)
        piece.add(cylinder(0.022, 0.008, (0, back + 0.085, 0.785), 16), finishes.steel(looks))
        piece.surfaces.append((-0.15, back + 0.03, 0.15, back + 0.14, 0.785))
    else:
        piece.add(box((0.2, 0.1, 0.26), (0, back + 0.03, 0.13), 0.02), white)
        piece.add(box((0.24, 0.012, 0.16), (0, back + 0.075, 0.95), 0.004), finishes.steel(looks))
    return piece


def _basin(
    piece: Assembly, looks: Looks, x: float, y: float, top: float, size: tuple[float, float], corner: float
) -> None:
    """A bowl let into (or standing on) a board at height `top` [m]."""
    w, d = size
    steps = (
        (0.45 * w, 0.4 * d, -0.125), (0.8 * w, 0.75 * d, -0.09), (w - 0.02, d - 0.02, 0.0015), (w, d, 0.0015),
        (w, d, 0.018), (w - 0.03, d - 0.03, 0.018), (0.75 * w, 0.7 * d, -0.08), (0.4 * w, 0.35 * d, -0.11),
    )  # fmt: skip
    rings = [ring((a, b), (x, y, top + z), corner) for a, b, z in steps]
    piece.add(loft(rings), finishes.porcelain(looks), "objects")
    piece.add(cylinder(0.022, 0.003, (x, y, top - 0.11), 16), finishes.steel(looks), "objects")


def vanity(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A cupboard with a top of stone or wood and one or two basins let into it."""
    piece, body = Assembly("furniture"), looks.case()
    two = rng.random() < 0.25
    w, d, h = (
        (rng.uniform(1.2, 1.5) if two else rng.uniform(0.6, 1.1)),
        rng.uniform(0.46, 0.55),
        rng.uniform(0.82, 0.88),
    )
    foot = 0.25 if rng.random() < 0.35 else 0.08
    piece.add(box((w - 0.02, d - 0.04, h - 0.16 - foot), (0, 0.02, foot)), body)
    piece.add(box((w - 0.02, 0.02, 0.13), (0, -d / 2 + 0.01, h - 0.16)), body)
    for side in (-1, 1):
        piece.add(box((0.02, d - 0.042, 0.13), (side * (w / 2 - 0.02), 0.0, h - 0.16)), body)
    if foot < 0.1:
        piece.add(box((w - 0.1, d - 0.12, foot), (0, 0.03, 0)), finishes.dark(looks))
    count, tall = (4 if two else 2), h - 0.18 - foot
    for k in range(count):
        x = (k + 0.5) * (w - 0.04) / count - (w - 0.04) / 2
        piece.add(
            box(((w - 0.04) / count - 0.008, 0.016, tall), (x, -d / 2 + 0.012, foot + 0.01), 0.003), body
        )
        piece.add(
            box(
                (0.012, 0.022, 0.12), (x + (0.08 if k % 2 == 0 else -0.08), -d / 2 - 0.006, foot + 0.6 * tall)
            ),
            looks.metal,
        )
    size, corner = (rng.uniform(0.38, 0.46), 0.32), rng.uniform(0.35, 1.0)
    middles = (-w / 4, w / 4) if two else (0.0,)
    top = finishes.stone(looks)
    for x in middles:
        span = w / len(middles)
        board = plate_with_hole(
            (span, d, 0.03), (size[0] - 0.016, size[1] - 0.016), (x, 0, h - 0.03), (0, -0.03), corner
        )
        piece.add(board, top)
        _basin(piece, looks, x, -0.03, h, size, corner)
        chrome = Assembly("objects")
        _tap(chrome, looks, (x, d / 2 - 0.055, h), 0.13, 0.1)
        piece.parts += chrome.parts
        for low, high in (
            (x - span / 2 + 0.02, x - size[0] / 2 - 0.02),
            (x + size[0] / 2 + 0.02, x + span / 2 - 0.02),
        ):
            if high - low > 0.08:
                piece.surfaces.append((low, -d / 2 + 0.05, high, d / 2 - 0.04, h))
    return piece


def washbasin(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A ceramic basin on a pedestal, or fixed to the wall above a siphon."""
    piece, white = Assembly("objects"), finishes.porcelain(looks)
    w, d, h = rng.uniform(0.45, 0.65), rng.uniform(0.38, 0.48), rng.uniform(0.82, 0.88)
    corner = rng.uniform(0.3, 0.8)
    rings = [
        ring((0.5 * w, 0.5 * d), (0, 0.06, h - 0.19), 0.8),
        ring((0.95 * w, 0.95 * d), (0, 0, h - 0.06), corner),
        ring((w, d), (0, 0, h), corner),
    ]
    rings += [
        ring((0.86 * w, 0.7 * d), (0, -0.1 * d, h), corner),
        ring((0.7 * w, 0.55 * d), (0, -0.08 * d, h - 0.09), 0.8),
        ring((0.2 * w, 0.2 * d), (0, -0.05 * d, h - 0.13), 1.0),
    ]
    piece.add(loft(rings), white)
    _tap(piece, looks, (0, 0.38 * d, h), 0.12, 0.09)
    if rng.random() < 0.6:
        column = [((0.24, 0.22), 0.0), ((0.19, 0.18), 0.08), ((0.17, 0.17), 0.5), ((0.24, 0.2), h - 0.17)]
        piece.add(loft([ring(s, (0, 0.06, z), 0.7) for s, z in column]), white)
    else:
        pipe = [
            (0, 0.0, h - 0.16),
            (0, 0.0, h - 0.3),
            (0, 0.06, h - 0.36),
            (0, 0.1, h - 0.3),
            (0, d / 2 - 0.01, h - 0.27),
        ]
        piece.add(tube(pipe, 0.017, 10), finishes.steel(looks))
    return piece


def mirror_cabinet(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A mirror or mirrored cabinet; hang its lower edge at about 1.15 m. All of it is an object."""
    piece, w, h = Assembly("objects"), rng.uniform(0.5, 1.1), rng.uniform(0.6, 0.8)
    deep = rng.uniform(0.1, 0.15) if rng.random() < 0.5 else 0.02
    if deep > 0.05:
        piece.add(box((w, deep, h)), looks.white)
        doors = 1 + int(w > 0.6) + int(w > 0.9)
        for k in range(doors):
            x = (k + 0.5) * w / doors - w / 2
            piece.add(
                panel(w / doors - 0.006, h - 0.006, 0.01).moved((x, -deep / 2 - 0.005, 0.003)),
                finishes.mirror_glass(looks),
            )
    else:
        frame = looks.wood() if rng.random() < 0.5 else finishes.steel(looks)
        piece.add(box((w, deep, h), bevel=0.006), frame)
        piece.add(
            panel(w - 0.05, h - 0.05, 0.006).moved((0, -deep / 2 - 0.002, 0.025)),
            finishes.mirror_glass(looks),
        )
    if rng.random() < 0.5:
        glow = np.full((8, 8, 3), (250, 244, 228), np.uint8)
        bulb = looks.add("bulb", Material(glow, 1.0, 0.0, 0.1, 0.5))
        piece.add(box((0.7 * w, 0.05, 0.04), (0, -deep / 2 + 0.025, h + 0.04), 0.01), bulb)
        piece.add(box((0.1, 0.03, 0.041), (0, deep / 2 - 0.015, h)), finishes.steel(looks))
    return piece


def towel_rail(rng: np.random.Generator, looks: Looks) -> Assembly:
    """One bar, or a ladder-like radiator, with towels over it; hang its lower edge at about 0.5 m."""
    piece, steel, w = Assembly("objects"), finishes.steel(looks), rng.uniform(0.45, 0.65)
    ladder = rng.random() < 0.5
    bars = np.arange(0.08, 1.15, 0.09) if ladder else np.array([0.72])
    for side in (-1, 1):
        x = side * (w / 2 - 0.01)
        if ladder:
            piece.add(tube([(x, 0, 0), (x, 0, 1.2)], 0.014), steel)
        for z in (0.1, 1.1) if ladder else bars:
            piece.add(tube([(x, 0, z), (x, 0.06, z)], 0.01, 8), steel)
    for z in bars:
        piece.add(tube([(-w / 2 + 0.01, 0, z), (w / 2 - 0.01, 0, z)], 0.01, 8), steel)
    for k in range(int(rng.integers(1, 3))):
        top = float(bars[-1 - 5 * k] if ladder else bars[-1])
        wide = rng.uniform(0.55, 0.8) * w * (1 if ladder else 0.6)
        x = rng.uniform(-0.5, 0.5) * (w - wide - 0.06) if ladder else (2 * k - 1) * 0.22 * w
        piece.attach(
            hanging_towel(rng, looks, wide, rng.uniform(0.3, 0.42) if ladder else rng.uniform(0.4, 0.65)),
            (x, 0, top),
        )
    return piece


def toilet_roll(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A roll of paper on a holder; hang it at about 0.7 m."""
    piece = Assembly("objects")
    roll = (
        cylinder(0.055, 0.1, sides=24).turned(rotation_x(np.pi / 2)).moved((0, 0.05, 0)).moved(yaw=np.pi / 2)
    )
    piece.add(roll.moved((0, 0, 0.06)), finishes.paper(looks))
    piece.add(
        tube([(0.065, 0.07, 0.06), (0.065, 0, 0.06), (-0.055, 0, 0.06)], 0.006, 8), finishes.steel(looks)
    )
    return piece
