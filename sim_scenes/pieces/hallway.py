"""Corridors: coat stands and racks with clothes, shoe racks, mirrors, umbrella stands, benches."""

import numpy as np

from dsmap.sim_scenes.geometry.lofts import bow, loft, ring, tube
from dsmap.sim_scenes.geometry.shapes import Shape, box, cushion, lathe, panel
from dsmap.sim_scenes.pieces.soft_goods import handbag, hung_garment, shoes
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures import finishes
from dsmap.sim_scenes.textures.palette import Looks


def _hook(at: tuple[float, float, float]) -> Shape:
    x, y, z = at
    return tube(bow((x, y, z), (x, y - 0.09, z - 0.03), (x, y - 0.07, z + 0.045)), 0.007, 8)


def coat_stand(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A free-standing pole with arms and coats on it."""
    piece, height = Assembly("objects"), rng.uniform(1.65, 1.85)
    wood = looks.wood() if rng.random() < 0.6 else finishes.dark(looks)
    piece.add(tube([(0, 0, 0.04), (0, 0, height)], 0.02, 12), wood)
    piece.add(lathe([(0.028, 0), (0.03, 0.03), (0.01, 0.06)], (0, 0, height - 0.01), 16), wood)
    for angle in np.arange(4) * np.pi / 2 + 0.4:
        c, s = np.cos(angle), np.sin(angle)
        piece.add(
            tube(
                bow((0.02 * c, 0.02 * s, 0.2), (0.18 * c, 0.18 * s, 0.16), (0.26 * c, 0.26 * s, 0.014)), 0.014
            ),
            wood,
        )
        high = height - 0.12
        piece.add(
            tube(
                bow(
                    (0.01 * c, 0.01 * s, high - 0.08),
                    (0.16 * c, 0.16 * s, high - 0.06),
                    (0.17 * c, 0.17 * s, high + 0.06),
                ),
                0.01,
            ),
            wood,
        )
    for k in rng.permutation(4)[: int(rng.integers(1, 5))]:
        angle = k * np.pi / 2 + 0.4
        at = (0.19 * np.cos(angle), 0.19 * np.sin(angle), height - 0.15)
        piece.attach(hung_garment(rng, looks), at, angle + np.pi / 2)
    return piece


def coat_rack(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A board with hooks, coats and bags: the board is 1.1 m above the frame's origin; hang that at about 0.5 m."""
    piece, wood, width = Assembly("furniture"), looks.wood(), rng.uniform(0.6, 1.3)
    piece.add(box((width, 0.022, 0.11), (0, 0.1, 0), 0.004), wood)
    if rng.random() < 0.5:
        piece.add(box((width, 0.24, 0.022), (0, -0.01, 0.11), 0.004), wood)
        piece.surfaces.append((-width / 2 + 0.06, -0.08, width / 2 - 0.06, 0.06, 1.232))
    hooks = np.linspace(-width / 2 + 0.12, width / 2 - 0.12, int(width / 0.21))
    for x in hooks:
        piece.add(_hook((x, 0.09, 0.05)), finishes.steel(looks), "objects")
    last = -9.0
    for x in hooks:
        if x - last > 0.36 and rng.random() < 0.75:
            if rng.random() < 0.8:
                piece.attach(hung_garment(rng, looks), (x, -0.02, 0.03))
            else:
                bag = handbag(rng, looks)
                piece.attach(bag, (x, 0.0, 0.02 - bag.bounds()[1, 2]))
            last = x
    piece.reshape(lambda shape: shape.moved((0, 0, 1.1)))
    return piece


def shoe_rack(rng: np.random.Generator, looks: Looks) -> Assembly:
    """Low open boards with pairs of shoes."""
    piece, wood = Assembly("furniture"), looks.wood()
    width, depth, rows = rng.uniform(0.6, 1.0), 0.32, int(rng.integers(2, 4))
    height = rows * 0.2 + 0.12
    for side in (-1, 1):
        piece.add(box((0.022, depth, height), (side * (width / 2 - 0.011), 0, 0)), wood)
    for k in range(rows + 1):
        z = 0.08 + 0.2 * k if k < rows else height - 0.02
        piece.add(box((width - 0.044, depth - 0.01, 0.018), (0, 0, z)), wood)
        x = -width / 2 + 0.16
        while k < rows and x < width / 2 - 0.13:
            pair = shoes(rng, looks)
            if rng.random() < 0.8 and pair.bounds()[1, 2] < 0.17:
                piece.attach(pair, (x, 0, z + 0.018), rng.uniform(-0.05, 0.05))
            x += 0.25
    piece.surfaces.append(
        (-width / 2 + 0.06, -depth / 2 + 0.05, width / 2 - 0.06, depth / 2 - 0.05, height - 0.002)
    )
    return piece


def wall_mirror(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A framed mirror, oblong or round; hang its middle at eye height."""
    piece = Assembly("objects")
    frame = looks.wood() if rng.random() < 0.6 else looks.metal
    if rng.random() < 0.7:
        w, h = rng.uniform(0.4, 0.8), rng.uniform(0.7, 1.5)
        piece.add(box((w, 0.03, h), bevel=0.008), frame)
        piece.add(panel(w - 0.08, h - 0.08, 0.004).moved((0, -0.0165, 0.04)), finishes.mirror_glass(looks))
        return piece
    r = rng.uniform(0.25, 0.42)
    for radius, thick, y, material in (
        (r, 0.024, 0.0, frame),
        (r - 0.03, 0.003, -0.024, finishes.mirror_glass(looks)),
    ):
        disc = lathe([(radius, 0), (radius, thick)], sides=44)
        turned = disc.vertices[:, [0, 2, 1]] * [1, -1, 1]
        unit = np.clip(disc.vertices[:, :2] / (2 * r) + 0.5, 0.01, 0.99)
        piece.add(Shape(turned + [0, y, r], disc.faces, unit), material)
    return piece


def umbrella_stand(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A tall pot with one to four umbrellas."""
    piece, r, h = Assembly("objects"), rng.uniform(0.1, 0.14), rng.uniform(0.42, 0.55)
    pot = finishes.wicker(looks) if rng.random() < 0.4 else finishes.dark(looks)
    piece.add(lathe([(0.9 * r, 0), (r, h), (r - 0.008, h), (0.85 * r, 0.02)], sides=28), pot)
    for _ in range(int(rng.integers(1, 5))):
        a, long = rng.uniform(0, 2 * np.pi), rng.uniform(0.75, 0.9)
        foot, top = -0.5 * r * np.array([np.cos(a), np.sin(a)]), 0.75 * r * np.array([np.cos(a), np.sin(a)])
        low, high = np.array([*foot, 0.03]), np.array([*top, long])
        points = low + np.linspace(0, 1, 6)[:, None] * (high - low)
        piece.add(tube(points, [0.008, 0.018, 0.026, 0.03, 0.02, 0.008], 10), looks.fabric())
        crook = bow(high, high + [0, 0, 0.14], high + [0.09, 0, 0.02])
        piece.add(tube(crook, 0.008, 8), looks.wood())
    return piece


def hall_bench(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A bench to put on shoes, with a padded seat at times (NYUv2 calls a bench furniture)."""
    piece, wood = Assembly("furniture"), looks.wood()
    width, depth, sit = rng.uniform(0.8, 1.3), rng.uniform(0.32, 0.4), rng.uniform(0.43, 0.48)
    piece.add(box((width, depth, 0.035), (0, 0, sit - 0.035), 0.006), wood)
    for x in (-1, 1):
        piece.add(box((0.05, depth - 0.05, sit - 0.035), (x * (width / 2 - 0.08), 0, 0)), wood)
    piece.add(box((width - 0.21, 0.03, 0.07), (0, 0, sit - 0.105)), wood)
    if rng.random() < 0.5:
        piece.add(cushion((width - 0.06, depth - 0.02, 0.07), (0, 0, sit - 0.005), 0.2, 12), looks.fabric())
        sit += 0.065
    piece.surfaces.append((-width / 2 + 0.1, -depth / 2 + 0.06, width / 2 - 0.1, depth / 2 - 0.06, sit))
    return piece


def radiator(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A ribbed or flat radiator; stands 0.12 m above the floor close to a wall."""
    piece, width, h = Assembly("objects"), rng.uniform(0.6, 1.4), rng.uniform(0.5, 0.6)
    white = looks.white
    if rng.random() < 0.5:
        for x in np.arange(-width / 2 + 0.03, width / 2 - 0.02, 0.06):
            rib = loft([ring((0.045, 0.1), (x, 0, 0.12 + z), 0.6, 16) for z in (0.0, h)])
            piece.add(rib, white)
        for z in (0.17, 0.07 + h):
            piece.add(tube([(-width / 2 + 0.02, 0, z), (width / 2 - 0.03, 0, z)], 0.02, 10), white)
    else:
        piece.add(box((width, 0.08, h), (0, 0, 0.12), 0.01), white)
        for x in np.arange(-width / 2 + 0.04, width / 2 - 0.03, 0.035):
            piece.add(box((0.018, 0.006, h - 0.06), (x, -0.042, 0.15)), white)
    pipe = [(width / 2 - 0.03, 0, 0.16), (width / 2 + 0.04, 0, 0.16), (width / 2 + 0.04, 0, 0.0)]
    piece.add(tube(pipe, 0.01, 8), finishes.steel(looks))
    return piece
