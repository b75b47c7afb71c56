"""Cushions, blankets, clothes, towels, bags and shoes (class objects)."""

import numpy as np

from dsmap.sim_scenes.geometry.lofts import bow, crumpled, loft, ring, tube
from dsmap.sim_scenes.geometry.shapes import Shape, box, cushion, rotation_x, sheet
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures import finishes
from dsmap.sim_scenes.textures.palette import Looks
from dsmap.sim_scenes.textures.patterns import noise


def throw_cushion(rng: np.random.Generator, looks: Looks, upright: bool = False) -> Assembly:
    """A square sofa cushion with pulled-out corners, lying, or (`upright`) leaning back on its lower edge."""
    piece, size, thick = Assembly("objects", name="cushion"), rng.uniform(0.36, 0.5), rng.uniform(0.12, 0.17)
    if upright:
        leaning = _pillow(size, size, thick).turned(rotation_x(np.pi / 2 - rng.uniform(0.25, 0.5)))
        piece.add(leaning.moved((0, 0, -leaning.bounds()[0, 2])), looks.fabric())
    else:
        piece.add(_pillow(size, size, thick), looks.fabric())
    return piece


def pillow(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A bed pillow, lying."""
    piece = Assembly("objects", name="pillow")
    piece.add(
        _pillow(rng.uniform(0.55, 0.7), rng.uniform(0.38, 0.45), rng.uniform(0.12, 0.17)), looks.fabric()
    )
    return piece


def _pillow(width: float, depth: float, thick: float, cells: int = 14) -> Shape:
    """A filled square of cloth: thick in the middle, thin at its seams, sides drawn in; bottom at z = 0."""
    s, t = np.meshgrid(np.linspace(-1, 1, cells + 1), np.linspace(-1, 1, cells + 1))
    swell = np.clip((1 - s**4) * (1 - t**4), 0, 1) ** 0.55
    x = s * width / 2 * (1 - 0.07 * (1 - t**2))
    y = t * depth / 2 * (1 - 0.07 * (1 - s**2))
    rim = 0.012
    top = np.stack([x, y, swell * (thick / 2 - rim) + rim], -1)
    low = np.stack([x, y, -swell * (thick / 2 - rim) - rim], -1)
    count = cells + 1
    index = np.arange(count * count).reshape(count, count)
    a, b, c, d = (v.ravel() for v in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    edge = np.concatenate([index[0], index[1:, -1], index[-1, -2::-1], index[-2:0:-1, 0]])
    after, shift = np.roll(edge, -1), count * count
    side = np.concatenate(
        [np.column_stack([edge, edge + shift, after]), np.column_stack([after, edge + shift, after + shift])]
    )
    points = np.concatenate([top.reshape(-1, 3), low.reshape(-1, 3)]) + [0, 0, thick / 2]
    return Shape(points, np.concatenate([faces, faces[:, ::-1] + shift, side]), points[:, :2] * [1, -1])


def draped_blanket(
    rng: np.random.Generator, looks: Looks, width: float, depth: float, drop: float
) -> Assembly:
    """A throw that lies over a seat (z = 0) from back to front and hangs `drop` [m] over the front edge."""
    piece = Assembly("objects", name="blanket")
    rows, columns = 30, 17
    s, t = np.meshgrid(np.linspace(-0.5, 0.5, columns), np.linspace(0, 1, rows))
    along = t * (depth + drop)
    hang = np.clip(along - drop, 0, None)
    fold = 0.008 * noise(rng, (6, 5), (rows, columns))
    points = np.empty((rows, columns, 3))
    points[..., 0] = s * width * (1 + 0.05 * np.sin(7 * t + rng.uniform(0, 6)))
    points[..., 1] = -depth / 2 - 0.012 + hang + np.where(along < drop, fold, 0.0)
    points[..., 2] = np.minimum(along - drop, 0) + 0.012 + np.where(along >= drop, np.abs(fold), 0.0)
    piece.add(sheet(points, 0.008), looks.fabric())
    return piece


def garment_heap(rng: np.random.Generator, looks: Looks) -> Assembly:
    """Clothes dropped in a heap."""
    piece = Assembly("objects")
    size = np.array([rng.uniform(0.3, 0.5), rng.uniform(0.25, 0.4), rng.uniform(0.07, 0.14)])
    piece.add(crumpled(rng, size, depth=0.2), looks.fabric())
    if rng.random() < 0.6:
        piece.add(
            crumpled(rng, size * [0.75, 0.7, 1.25], (rng.uniform(-0.08, 0.08), 0.03, 0), 0.2), looks.fabric()
        )
    return piece


def folded_clothes(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A pile of 1 to 5 folded shirts or sheets."""
    piece, z = Assembly("objects"), 0.0
    width, depth = rng.uniform(0.24, 0.34), rng.uniform(0.22, 0.3)
    for _ in range(int(rng.integers(1, 6))):
        thick = rng.uniform(0.025, 0.05)
        layer = cushion(
            (width * rng.uniform(0.93, 1.05), depth * rng.uniform(0.93, 1.05), thick), (0, 0, z), 0.18, 8
        )
        piece.add(layer.moved(yaw=rng.uniform(-0.06, 0.06)), looks.fabric())
        z += thick * 0.96
    return piece


def towel_stack(rng: np.random.Generator, looks: Looks) -> Assembly:
    """Folded towels."""
    piece, z, cloth = Assembly("objects"), 0.0, finishes.towelling(looks)
    for k in range(int(rng.integers(2, 5))):
        if k and rng.random() < 0.4:
            cloth = finishes.towelling(looks)
        thick = rng.uniform(0.04, 0.06)
        piece.add(cushion((0.32, 0.24, thick), (0, 0, z), 0.22, 8).moved(yaw=rng.uniform(-0.05, 0.05)), cloth)
        z += thick * 0.97
    return piece


def hanging_towel(rng: np.random.Generator, looks: Looks, width: float, height: float) -> Assembly:
    """A towel over a bar at z = 0, y = 0: the front layer hangs `height` [m], the back a little less."""
    piece = Assembly("objects")
    piece.add(_over_bar(rng, width, height, 0.013), finishes.towelling(looks))
    return piece


def _over_bar(rng: np.random.Generator, width: float, height: float, radius: float) -> Shape:
    back = height * rng.uniform(0.7, 0.95)
    turn = np.linspace(np.pi, 0, 7)[1:-1]
    front = np.linspace(-height, 0, 9)
    y = np.concatenate([np.full(9, -radius), -radius * -np.cos(turn), np.full(7, radius)])
    z = np.concatenate([front, radius * np.sin(turn), np.linspace(0, -back, 7)])
    columns = np.linspace(-0.5, 0.5, 13)
    wave = 0.5 * radius * np.sin(columns * rng.uniform(9, 15) + rng.uniform(0, 6))
    points = np.empty((len(y), len(columns), 3))
    points[..., 0] = columns * width
    points[..., 1] = y[:, None] + wave * np.clip(-z / height, 0, 1)[:, None] * 0.8
    points[..., 2] = z[:, None]
    return sheet(points, 0.007)


def hung_garment(rng: np.random.Generator, looks: Looks, height: float | None = None) -> Assembly:
    """A coat or jacket on a hook: its collar at z = 0, hanging down; back at y = 0.1."""
    piece = Assembly("objects", name="garment")
    tall, wide = rng.uniform(0.6, 1.0) if height is None else height, rng.uniform(0.3, 0.44)
    cloth = finishes.leather(looks) if rng.random() < 0.2 else looks.fabric()
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    phase, rings = rng.uniform(0, 6), []
    for t in np.linspace(0, 1, 12):
        w = wide * np.interp(t, [0, 0.3, 0.7, 0.9, 0.96, 1], [1.0, 0.84, 0.9, 0.95, 0.7, 0.3])
        d = 0.19 * np.interp(t, [0, 0.3, 0.9, 1], [1.0, 0.9, 0.7, 0.3])
        fold = 1 + 0.13 * (1 - t) * np.sin(7 * angle + phase + 2 * t)
        rings.append(
            np.column_stack(
                [np.cos(angle) * w / 2 * fold, np.sin(angle) * d / 2 * fold, np.full(40, (t - 1) * tall)]
            )
        )
    piece.add(loft(rings, sharp=0.0), cloth)
    if rng.random() < 0.75:
        for side in (-1, 1):
            arm = bow(
                (side * wide * 0.3, 0, -0.1 * tall),
                (side * wide * 0.62, 0, -0.22 * tall),
                (side * wide * 0.56, -0.02, -rng.uniform(0.66, 0.78) * tall),
            )
            piece.add(tube(arm, np.linspace(0.07, 0.05, len(arm)), 14), cloth)
    return piece


def backpack(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A rucksack standing on the floor."""
    piece, cloth = Assembly("objects"), looks.fabric()
    w, d, h = rng.uniform(0.28, 0.34), rng.uniform(0.16, 0.2), rng.uniform(0.4, 0.5)
    profile = (
        (0.9, 0.9, 0, 0), (1, 1, 0, 0.08), (1, 1, 0, 0.55), (0.92, 0.85, 0.01, 0.8), (0.7, 0.6, 0.02, 0.95),
        (0.4, 0.3, 0.03, 1),
    )  # fmt: skip
    rings = [ring((w * a, d * b), (0, c, h * z), 0.5) for a, b, c, z in profile]
    piece.add(loft(rings, sharp=0.3), cloth)
    piece.add(
        cushion((0.72 * w, 0.1, 0.4 * h), (0, -d / 2 - 0.005, 0.06 * h), 0.35, 10),
        cloth if rng.random() < 0.5 else looks.fabric(),
    )
    for side in (-1, 1):
        strap = bow(
            (side * 0.08, d / 2 - 0.02, 0.9 * h),
            (side * 0.1, d / 2 + 0.1, 0.6 * h),
            (side * 0.11, d / 2 - 0.01, 0.12 * h),
        )
        piece.add(tube(strap, 0.014, 8), finishes.dark(looks))
    piece.add(
        tube(bow((-0.04, 0.03, 0.97 * h), (0, 0.03, 1.1 * h), (0.04, 0.03, 0.97 * h)), 0.009, 8),
        finishes.dark(looks),
    )
    return piece


def handbag(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A bag with two handles, of leather or cloth."""
    piece = Assembly("objects")
    skin = finishes.leather(looks) if rng.random() < 0.6 else looks.fabric()
    w, d, h = rng.uniform(0.28, 0.4), rng.uniform(0.11, 0.17), rng.uniform(0.22, 0.32)
    rings = [
        ring((w * a, d * b), (0, 0, h * z), 0.35)
        for a, b, z in ((0.96, 0.95, 0), (1, 1, 0.1), (0.97, 0.75, 0.6), (0.93, 0.35, 1.0))
    ]
    piece.add(loft(rings, sharp=0.4), skin)
    for y in (-0.13 * d, 0.13 * d):
        handle = bow((-0.24 * w, y, 0.98 * h), (0, 3 * y, h + 0.3 * w + 0.12), (0.24 * w, y, 0.98 * h), 13)
        piece.add(tube(handle, 0.008, 8), skin)
    return piece


def shoes(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A pair of shoes or boots, toes towards -y."""
    piece = Assembly("objects")
    upper = finishes.leather(looks) if rng.random() < 0.5 else looks.thing()
    sole = finishes.dark(looks) if rng.random() < 0.5 else finishes.porcelain(looks)
    long, boot = rng.uniform(0.24, 0.3), rng.random() < 0.25
    for side in (-1, 1):
        at = np.array([side * rng.uniform(0.06, 0.075), rng.uniform(-0.02, 0.02), 0])
        yaw = rng.uniform(-0.15, 0.15)
        piece.add(loft([ring((0.09, long), (0, 0, z), 0.8) for z in (0, 0.022)]).moved(at, yaw), sole)
        rings = [
            (0.088, long * 0.98, 0.0, 0.02),
            (0.085, long * 0.9, 0.01, 0.045),
            (0.075, long * 0.62, 0.045, 0.07),
            (0.068, long * 0.42, 0.075, 0.095),
        ]
        if boot:
            rings += [(0.08, long * 0.4, 0.075, 0.2), (0.09, long * 0.42, 0.075, 0.3)]
        w, d, y, z = rings[-1]
        inner = [(w - 0.014, d - 0.014, y, z), (w - 0.018, d - 0.018, y, z - 0.035)]
        piece.add(
            loft([ring((w, d), (0, y, z), 0.85) for w, d, y, z in rings + inner], sharp=0.3).moved(at, yaw),
            upper,
        )
    return piece


def bath_mat(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A thick mat before a tub (class floor, like a rug)."""
    piece = Assembly("floor", name="bath_mat")
    piece.add(
        box((rng.uniform(0.6, 0.85), rng.uniform(0.4, 0.55), 0.012), bevel=0.005), finishes.towelling(looks)
    )
    return piece
