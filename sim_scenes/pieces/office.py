"""Office things: monitors, laptops, keyboards, computers, printers, whiteboards, bins (all objects, as in NYUv2).

NYUv2's 13 classes know televisions only: a computer monitor is an object there.
"""

import numpy as np

from dsmap.sim_scenes.geometry.lofts import bow, loft, ring, tub, tube
from dsmap.sim_scenes.geometry.shapes import Shape, box, cushion, cylinder, lathe, panel, rotation_x
from dsmap.sim_scenes.scene import Assembly, Material
from dsmap.sim_scenes.textures import finishes, screens
from dsmap.sim_scenes.textures.palette import Looks
from dsmap.sim_scenes.textures.patterns import noise


def _screen(rng: np.random.Generator, looks: Looks) -> str:
    """A lit or dark screen; computers are mostly on."""
    image = screens.screen(rng)
    on = float(image.mean()) > 60
    return looks.printed("screen", image, 0.3, 0.35 if on else 0.0, glass=True)


def monitor(rng: np.random.Generator, looks: Looks, width: float | None = None) -> Assembly:
    """A computer monitor on its foot."""
    piece, body = Assembly("objects"), finishes.dark(looks)
    width = rng.uniform(0.48, 0.68) if width is None else width
    height, lift = width * rng.choice([0.5625, 0.625, 0.42]), rng.uniform(0.1, 0.16)
    piece.add(box((width, 0.022, height), (0, 0.012, lift), 0.004), body)
    piece.add(box((0.4 * width, 0.03, 0.5 * height), (0, 0.035, lift + 0.25 * height), 0.01), body)
    piece.add(
        panel(width - 0.02, height - 0.026, 0.003).moved((0, -0.0005, lift + 0.016)), _screen(rng, looks)
    )
    piece.add(tube([(0, 0.07, 0.008), (0, 0.06, lift + 0.5 * height)], 0.018, 10), body)
    if rng.random() < 0.5:
        piece.add(box((0.24, 0.18, 0.012), (0, 0.03, 0), 0.004), body)
    else:
        piece.add(lathe([(0.11, 0), (0.11, 0.008), (0.03, 0.014)], (0, 0.04, 0), 28), body)
    return piece


def dual_monitors(rng: np.random.Generator, looks: Looks) -> Assembly:
    """Two equal monitors side by side, turned a little towards each other."""
    piece, width = Assembly("objects"), rng.uniform(0.48, 0.58)
    for side in (-1, 1):
        one, turn = monitor(rng, looks, width), rng.uniform(0.08, 0.25)
        for shape, material, label, _ in one.parts:
            piece.parts.append(
                (shape.moved((side * (0.5 * width + 0.02), 0, 0), -side * turn), material, label, 0)
            )
    return piece


def laptop(rng: np.random.Generator, looks: Looks) -> Assembly:
    """An open laptop."""
    piece, w = Assembly("objects"), rng.uniform(0.3, 0.38)
    body = finishes.steel(looks) if rng.random() < 0.5 else finishes.dark(looks)
    piece.add(box((w, 0.68 * w, 0.016), bevel=0.004), body)
    piece.add(box((0.86 * w, 0.3 * w, 0.002), (0, 0.1 * w, 0.016)), _keys(looks))
    piece.add(box((0.3 * w, 0.17 * w, 0.001), (0, -0.2 * w, 0.016)), finishes.dark(looks))
    lean = rotation_x(-rng.uniform(0.2, 0.5))
    hinge = (0, 0.33 * w, 0.012)
    piece.add(box((w, 0.008, 0.66 * w), (0, 0, 0), 0.002).turned(lean).moved(hinge), body)
    piece.add(
        panel(0.94 * w, 0.58 * w, 0.002).moved((0, -0.005, 0.035 * w)).turned(lean).moved(hinge),
        _screen(rng, looks),
    )
    return piece


def _keys(looks: Looks) -> str:
    """Rows of keys."""
    found = finishes.known(looks, "keys")
    if found:
        return found
    y, x = np.mgrid[0:60, 0:180]
    cap = (y % 10 > 1) & ((x + 5 * (y // 10)) % 12 > 1)
    image = np.where(cap[..., None], (58, 58, 62), (22, 22, 24)).astype(np.uint8)
    return looks.add("keys", Material(image, 0.3, 0.1, 0.2))


def keyboard(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A keyboard with a mouse at its right."""
    piece, w = Assembly("objects"), rng.uniform(0.36, 0.45)
    body = finishes.dark(looks) if rng.random() < 0.7 else finishes.porcelain(looks)
    piece.add(box((w, 0.15, 0.018), bevel=0.004), body)
    piece.add(box((w - 0.02, 0.12, 0.006), (0, 0, 0.018)), _keys(looks))
    piece.add(
        cushion((0.062, 0.11, 0.036), (w / 2 + rng.uniform(0.06, 0.1), rng.uniform(-0.03, 0.03), 0), 0.7, 10),
        body,
    )
    return piece


def pc_tower(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A computer's case."""
    piece, body = Assembly("objects"), finishes.dark(looks) if rng.random() < 0.7 else finishes.steel(looks)
    w, d, h = rng.uniform(0.17, 0.22), rng.uniform(0.38, 0.46), rng.uniform(0.36, 0.46)
    piece.add(box((w, d, h - 0.012), (0, 0, 0.012), 0.004), body)
    piece.add(box((w - 0.04, d - 0.06, 0.012)), finishes.dark(looks))
    piece.add(panel(w - 0.02, h - 0.04, 0.012).moved((0, -d / 2 - 0.004, 0.024)), finishes.dark(looks))
    for z in (0.78, 0.88):
        piece.add(box((0.7 * w, 0.006, 0.03), (0, -d / 2 - 0.012, z * h)), finishes.steel(looks))
    piece.add(
        cylinder(0.012, 0.006, sides=16).turned(rotation_x(np.pi / 2)).moved((0, -d / 2 - 0.009, 0.7 * h)),
        finishes.steel(looks),
    )
    piece.surfaces.append((-w / 2 + 0.03, -d / 2 + 0.05, w / 2 - 0.03, d / 2 - 0.05, h))
    return piece


def printer(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A desk printer with a paper tray and a sheet in it."""
    piece, light = Assembly("objects"), rng.random() < 0.6
    body, other = (finishes.porcelain, finishes.dark)[:: 1 if light else -1]
    w, d, h = rng.uniform(0.38, 0.48), rng.uniform(0.32, 0.42), rng.uniform(0.18, 0.3)
    piece.add(box((w, d, h), bevel=0.012), body(looks))
    piece.add(box((w - 0.04, d - 0.06, 0.03), (0, 0.01, h), 0.008), other(looks))
    piece.add(panel(0.7 * w, 0.09, 0.006).moved((0, -d / 2 - 0.002, 0.28 * h)), finishes.dark(looks))
    piece.add(box((0.55 * w, 0.16, 0.008), (0, -d / 2 - 0.075, 0.2 * h)), other(looks))
    piece.add(box((0.21, 0.15, 0.004), (0, -d / 2 - 0.07, 0.2 * h + 0.008)), finishes.paper(looks))
    piece.add(box((0.16, 0.05, 0.01), (-0.2 * w, -d / 2 + 0.05, h + 0.03), 0.003), finishes.dark(looks))
    return piece


def _scribbles(rng: np.random.Generator) -> np.ndarray:
    """A whiteboard's face with lines of writing, boxes and arrows, uint8 (240, 360, 3)."""
    image = np.full((240, 360, 3), 232, np.float32) * (1 + 0.02 * noise(rng, (10, 14), (240, 360))[..., None])
    inks = ((40, 60, 150), (30, 30, 30), (170, 40, 40), (30, 110, 60))
    for _ in range(int(rng.integers(2, 6))):
        x, y, ink = int(rng.uniform(10, 220)), int(rng.uniform(10, 170)), inks[rng.integers(4)]
        if rng.random() < 0.5:
            for row in range(int(rng.integers(2, 6))):
                stop = x + int(rng.uniform(40, 120))
                wave = (y + 12 * row + 2.5 * np.sin(np.arange(x, stop) * rng.uniform(0.4, 0.9))).astype(int)
                for thick in (0, 1):
                    image[np.clip(wave + thick, 0, 239), np.clip(np.arange(x, stop), 0, 359)] = ink
        else:
            w, h = int(rng.uniform(30, 90)), int(rng.uniform(20, 60))
            image[y : y + 2, x : x + w] = image[y + h : y + h + 2, x : x + w] = ink
            image[y : y + h, x : x + 2] = image[y : y + h, x + w : x + w + 2] = ink
    return np.clip(image, 0, 255).astype(np.uint8)


def whiteboard(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A whiteboard in an aluminium frame with a pen tray; hang its lower edge at about 0.9 m."""
    piece, steel = Assembly("objects"), finishes.steel(looks)
    w, h = rng.uniform(1.0, 2.0), rng.uniform(0.8, 1.1)
    piece.add(
        panel(w - 0.03, h - 0.03, 0.012).moved((0, 0.003, 0.065)),
        looks.printed("whiteboard", _scribbles(rng), 0.25),
    )
    for side in (-1, 1):
        piece.add(box((0.025, 0.024, h), (side * (w / 2 - 0.0125), 0.0, 0.05)), steel)
        piece.add(box((w - 0.05, 0.024, 0.025), (0, 0, 0.05 if side < 0 else h + 0.025)), steel)
    piece.add(box((0.5 * w, 0.07, 0.012), (0, -0.045, 0.035)), steel)
    for k in range(int(rng.integers(1, 5))):
        piece.add(box((0.12, 0.014, 0.014), ((k - 1.5) * 0.14, -0.05, 0.047), 0.003), looks.thing())
    return piece


def pinboard(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A cork board with papers; hang its lower edge at about 1.1 m."""
    piece, w, h = Assembly("objects"), rng.uniform(0.7, 1.2), rng.uniform(0.5, 0.85)
    cork = looks.tiled("carpet", ((0.62, 0.45, 0.28),))
    piece.add(box((w, 0.02, h), bevel=0.003), cork)
    for _ in range(int(rng.integers(4, 10))):
        a, b = rng.uniform(0.08, 0.21), rng.uniform(0.1, 0.29)
        x, z = rng.uniform(-0.48, 0.48) * (w - a), rng.uniform(0.02, 0.98) * (h - b)
        note = panel(a, b, 0.002).moved((x, -0.0115 - 0.0022 * len(piece.parts), z))
        piece.add(note, finishes.paper(looks) if rng.random() < 0.65 else looks.thing())
    return piece


def waste_bin(rng: np.random.Generator, looks: Looks) -> Assembly:
    """An open bin with crumpled paper, or a pedal bin."""
    piece, r, h = Assembly("objects"), rng.uniform(0.12, 0.17), rng.uniform(0.26, 0.45)
    skin = (finishes.dark, finishes.steel, Looks.thing)[rng.integers(3)](looks)
    if rng.random() < 0.6:
        piece.add(lathe([(0.8 * r, 0), (r, h), (r - 0.006, h), (0.8 * r - 0.004, 0.02)], sides=28), skin)
        for _ in range(int(rng.integers(2, 6))):
            at = (*rng.uniform(-0.4, 0.4, 2) * r, 0.5 * h + rng.uniform(0, 0.2) * h)
            piece.add(cushion((0.09, 0.08, 0.07), at, 0.8, 6), finishes.paper(looks))
    else:
        piece.add(lathe([(0.95 * r, 0), (r, 0.03), (r, h)], sides=28), skin)
        piece.add(
            lathe([(r + 0.004, 0), (r + 0.004, 0.025), (0.7 * r, 0.055), (0.01, 0.065)], (0, 0, h), 28),
            finishes.dark(looks),
        )
        piece.add(box((0.08, 0.06, 0.015), (0, -r - 0.02, 0.01), 0.004), finishes.dark(looks))
    return piece


def telephone(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A desk telephone."""
    piece, body = Assembly("objects"), finishes.dark(looks)
    wedge = box((0.18, 0.2, 0.05), bevel=0.01)
    tilt = np.where(
        wedge.vertices[:, 2] > 0.025,
        wedge.vertices[:, 2] * (0.7 + 2.5 * wedge.vertices[:, 1]),
        wedge.vertices[:, 2],
    )
    piece.add(Shape(np.column_stack([wedge.vertices[:, :2], tilt]), wedge.faces, wedge.uv), body)
    line = bow((-0.055, -0.09, 0.05), (-0.055, 0, 0.1), (-0.055, 0.09, 0.075))
    piece.add(
        tube(line, [0.024, 0.022, 0.016, 0.014, 0.014, 0.014, 0.016, 0.022, 0.024]), finishes.dark(looks)
    )
    return piece


def paper_tray(rng: np.random.Generator, looks: Looks) -> Assembly:
    """Letter trays over each other with papers."""
    piece, colour = Assembly("objects"), finishes.dark(looks) if rng.random() < 0.5 else looks.thing()
    for k in range(int(rng.integers(1, 4))):
        z = 0.065 * k
        piece.add(tub((0.25, 0.33, 0.05), 0.004, 0.004, (0, 0, z), 0.08), colour)
        piece.add(
            box((0.2, 0.28, rng.uniform(0.008, 0.03)), (0, 0, z + 0.005)).moved(yaw=rng.uniform(-0.03, 0.03)),
            finishes.paper(looks),
        )
        for x in (-0.1, 0.1):
            piece.add(box((0.01, 0.01, 0.02), (x, 0.155, z + 0.048)), colour)
    return piece


def paper_stack(rng: np.random.Generator, looks: Looks) -> Assembly:
    """Loose papers on a heap."""
    piece, z = Assembly("objects"), 0.0
    for _ in range(int(rng.integers(2, 6))):
        thick = rng.uniform(0.003, 0.014)
        sheet = box((0.21, 0.297, thick)).moved((*rng.uniform(-0.02, 0.02, 2), z), rng.uniform(-0.25, 0.25))
        piece.add(sheet, finishes.paper(looks))
        z += thick
    return piece


def water_cooler(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A water dispenser with its big bottle."""
    piece = Assembly("objects")
    piece.add(box((0.32, 0.32, 0.95), bevel=0.015), finishes.porcelain(looks))
    piece.add(panel(0.22, 0.2, 0.012).moved((0, -0.162, 0.62)), finishes.dark(looks))
    blue = looks.tiled("plain", ((0.5, 0.68, 0.8), (0.6, 0.75, 0.84)))
    bottle = [
        ((0.08, 0.08), 0.95),
        ((0.09, 0.09), 0.99),
        ((0.27, 0.27), 1.04),
        ((0.27, 0.27), 1.3),
        ((0.22, 0.22), 1.33),
    ]
    piece.add(loft([ring(s, (0, 0, z), 1.0) for s, z in bottle]), blue)
    return piece
