"""Kitchens: runs of base units under a worktop, wall cupboards, fridge, stove, hood, island, open shelves.

Classes as in NYUv2: cupboards, worktops and fridges are furniture; sinks, hobs, ovens, hoods are objects.
"""

import numpy as np

from dsmap.sim_scenes.geometry.lofts import bow, loft, plate_with_hole, ring, tube
from dsmap.sim_scenes.geometry.shapes import box, cylinder, panel, rotation_x
from dsmap.sim_scenes.pieces.clutter import pick
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures import finishes
from dsmap.sim_scenes.textures.palette import Looks

HEIGHT, DEPTH, TOP, PLINTH = 0.9, 0.6, 0.036, 0.1
"""Of worktops above the floor, of base units, of the worktop's board, of the recessed foot [m]."""


def fronts_of(looks: Looks) -> str:
    """The colour of a room's kitchen fronts: white, wood or a lacquer; the same for all its units."""
    found = finishes.known(looks, "kitchen")
    if found is None:
        lacquers = (
            (0.84, 0.83, 0.8),
            (0.3, 0.36, 0.4),
            (0.55, 0.62, 0.55),
            (0.75, 0.7, 0.6),
            (0.5, 0.2, 0.18),
        )
        woods = ((0.6, 0.42, 0.27), (0.45, 0.28, 0.17), (0.74, 0.58, 0.4))
        lacquered = looks.rng.random() < 0.6
        name = looks.tiled("plain", lacquers) if lacquered else looks.tiled("wood", woods)
        found = looks.add("kitchen", looks.materials[name])
    return found


def _front(
    piece: Assembly,
    looks: Looks,
    at: tuple[float, float, float],
    size: tuple[float, float],
    style: int,
    drawer: bool,
) -> None:
    """A door or drawer front (w, h), bottom centre `at` on its back plane: 0 with a bar, 1 panelled
    with a knob, 2 plain.
    """
    (x, y, z), (w, h) = at, size
    material = fronts_of(looks)
    piece.add(box((w - 0.006, 0.018, h - 0.006), (x, y - 0.009, z + 0.003), 0.002), material)
    if style == 1 and h > 0.2 and w > 0.22:
        for side in (-1, 1):
            piece.add(
                box((0.055, 0.008, h - 0.012), (x + side * (w / 2 - 0.033), y - 0.021, z + 0.006)), material
            )
            rail = z + 0.006 if side < 0 else z + h - 0.061
            piece.add(box((w - 0.122, 0.008, 0.055), (x, y - 0.021, rail)), material)
    if style == 2:
        return
    steel = finishes.steel(looks)
    out = y - (0.03 if style == 1 else 0.022)
    if style == 1:
        knob = cylinder(0.014, 0.022, sides=14).turned(rotation_x(np.pi / 2))
        piece.add(
            knob.moved(
                (x if drawer else x + 0.5 * w - 0.034, out + 0.004, z + (0.5 if drawer else 0.85) * h)
            ),
            steel,
        )
    elif drawer or w > h:
        piece.add(
            tube(
                [(x - 0.32 * w, out - 0.02, z + h - 0.045), (x + 0.32 * w, out - 0.02, z + h - 0.045)],
                0.006,
                8,
            ),
            steel,
        )
        for side in (-1, 1):
            piece.add(box((0.01, 0.026, 0.01), (x + side * 0.28 * w, out - 0.006, z + h - 0.05)), steel)
    else:
        bar = x + 0.5 * w - 0.04
        piece.add(tube([(bar, out - 0.02, z + h - 0.3), (bar, out - 0.02, z + h - 0.06)], 0.006, 8), steel)
        for low in (0.28, 0.08):
            piece.add(box((0.01, 0.026, 0.01), (bar, out - 0.006, z + h - low)), steel)


def oven_face(
    rng: np.random.Generator,
    looks: Looks,
    piece: Assembly,
    at: tuple[float, float, float],
    size: tuple[float, float],
) -> None:
    """An oven's or dishwasher's face: steel or black with a dark window, a handle and knobs."""
    (x, y, z), (w, h) = at, size
    body = finishes.steel(looks) if rng.random() < 0.6 else finishes.dark(looks)
    piece.add(box((w - 0.006, 0.02, h - 0.006), (x, y - 0.01, z + 0.003), 0.003), body, "objects")
    piece.add(
        panel(0.76 * w, 0.5 * h, 0.004).moved((x, y - 0.0215, z + 0.14 * h)), finishes.dark(looks), "objects"
    )
    rail = z + 0.74 * h
    piece.add(
        tube([(x - 0.38 * w, y - 0.05, rail), (x + 0.38 * w, y - 0.05, rail)], 0.009, 8),
        finishes.steel(looks),
        "objects",
    )
    for side in (-1, 1):
        piece.add(
            box((0.014, 0.036, 0.014), (x + side * 0.34 * w, y - 0.036, rail - 0.007)),
            finishes.steel(looks),
            "objects",
        )
    for k in np.linspace(-0.36, 0.36, 5):
        knob = cylinder(0.017, 0.02, sides=14).turned(rotation_x(np.pi / 2))
        piece.add(knob.moved((x + k * w, y - 0.018, z + 0.9 * h)), finishes.dark(looks), "objects")


def _sink(looks: Looks, piece: Assembly, x: float, width: float) -> None:
    """A steel basin let into the worktop at `x`, with a drain and a tap behind."""
    steel, y = finishes.steel(looks), -0.02
    size = np.array([width, 0.4])
    steps = (
        (-0.11, -0.18), (-0.02, -0.155), (0.006, 0.001), (0.03, 0.001), (0.03, 0.005), (-0.012, 0.005), (-0.03, -0.15),
        (-0.1, -0.165),
    )  # fmt: skip
    rings = [ring(size + wider, (x, y, HEIGHT + z), 0.25) for wider, z in steps]
    piece.add(loft(rings), steel, "objects")
    piece.add(cylinder(0.035, 0.003, (x, y, HEIGHT - 0.165), 18), finishes.dark(looks), "objects")
    tap = np.vstack(
        [
            [(x, 0.225, HEIGHT)],
            bow((x, 0.225, HEIGHT + 0.2), (x, 0.22, HEIGHT + 0.38), (x, 0.04, HEIGHT + 0.2)),
        ]
    )
    piece.add(tube(tap, 0.013, 10), steel, "objects")
    piece.add(cylinder(0.026, 0.04, (x, 0.225, HEIGHT), 16), steel, "objects")
    piece.add(
        tube([(x + 0.02, 0.225, HEIGHT + 0.06), (x + 0.09, 0.215, HEIGHT + 0.085)], 0.007, 8),
        steel,
        "objects",
    )


def hob(rng: np.random.Generator, looks: Looks, piece: Assembly, x: float, width: float = 0.56) -> None:
    """Four cooking zones: black glass with rings, or steel with gas burners."""
    gas = rng.random() < 0.4
    plate = finishes.steel(looks) if gas else finishes.dark(looks)
    piece.add(box((width, 0.5, 0.008), (x, -0.01, HEIGHT), 0.003), plate, "objects")
    top = HEIGHT + 0.008
    for dx, dy, r in ((-0.14, 0.1, 0.09), (0.14, 0.1, 0.07), (-0.14, -0.13, 0.07), (0.14, -0.13, 0.09)):
        at = (x + dx, dy, top)
        if gas:
            piece.add(cylinder(0.4 * r, 0.018, at, 18), finishes.dark(looks), "objects")
            for turn in (0.0, np.pi / 2):
                piece.add(
                    box((2.2 * r, 0.01, 0.012), (0, 0, 0.022)).moved(at, turn),
                    finishes.dark(looks),
                    "objects",
                )
        else:
            piece.add(cylinder(r, 0.0015, at, 28), finishes.steel(looks), "objects")
            piece.add(cylinder(r - 0.008, 0.0025, at, 28), finishes.dark(looks), "objects")


def _modules(rng: np.random.Generator, length: float) -> np.ndarray:
    """Edges of cupboards of 0.45 to 0.62 m that fill a run, shape (n + 1,)."""
    count = max(1, int(round(length / rng.uniform(0.5, 0.6))))
    return np.linspace(-length / 2, length / 2, count + 1)


def base_units(
    rng: np.random.Generator, looks: Looks, length: float = 2.4, sink: bool = True, cook: bool = True
) -> Assembly:
    """A run of base units of a given length [m] with a worktop, a sink and a hob over an oven where there is room."""
    piece, front, carcass = Assembly("furniture"), -DEPTH / 2 + 0.04, fronts_of(looks)
    edges, style = _modules(rng, length), int(rng.integers(3))
    body = HEIGHT - TOP - PLINTH
    cells = list(rng.permutation(len(edges) - 1))
    basin = cells.pop() if sink and cells else None
    cooker = cells.pop() if cook and cells else None
    for k, (x0, x1) in enumerate(zip(edges[:-1], edges[1:], strict=True)):
        x, w = (x0 + x1) / 2, x1 - x0
        deep = DEPTH - 0.04
        piece.add(box((w - 0.001, deep, body - (0.17 if k == basin else 0.0)), (x, 0.02, PLINTH)), carcass)
        piece.add(box((w, deep - 0.05, PLINTH), (x, 0.04, 0)), finishes.dark(looks))
        if k == cooker:
            oven_face(rng, looks, piece, (x, front, PLINTH + 0.11), (w, body - 0.11))
            _front(piece, looks, (x, front, PLINTH), (w, 0.11), style, True)
        elif k != basin and rng.random() < 0.35:
            heights = ([0.4, 0.35, 0.25], [0.5, 0.5])[rng.integers(2)]
            for low, part in zip(np.cumsum([0, *heights[:-1]]), heights, strict=True):
                _front(piece, looks, (x, front, PLINTH + low * body), (w, part * body), style, True)
        elif rng.random() < 0.5:
            _front(piece, looks, (x, front, PLINTH + 0.8 * body), (w, 0.2 * body), style, True)
            _front(piece, looks, (x, front, PLINTH), (w, 0.8 * body), style, False)
        else:
            _front(piece, looks, (x, front, PLINTH), (w, body), style, False)
    _worktop(rng, looks, piece, length, edges, basin, cooker)
    return piece


def _worktop(
    rng: np.random.Generator,
    looks: Looks,
    piece: Assembly,
    length: float,
    edges: np.ndarray,
    basin: int | None,
    cooker: int | None,
) -> None:
    """The board over a run with its sink and hob, an upstand at the wall, and the free stretches as surfaces."""
    middles, stone = (edges[:-1] + edges[1:]) / 2, finishes.stone(looks)
    cuts = []
    size = (length, DEPTH, TOP)
    if basin is None:
        piece.add(box(size, (0, 0, HEIGHT - TOP), 0.004), stone)
    else:
        width = min(0.5, float(edges[1] - edges[0]) - 0.09)
        x = float(middles[basin])
        piece.add(plate_with_hole(size, (width + 0.01, 0.41), (0, 0, HEIGHT - TOP), (x, -0.02), 0.25), stone)
        _sink(looks, piece, x, width)
        cuts.append((x - width / 2 - 0.05, x + width / 2 + 0.05))
    if cooker is not None:
        hob(rng, looks, piece, float(middles[cooker]))
        cuts.append((float(middles[cooker]) - 0.32, float(middles[cooker]) + 0.32))
    piece.add(box((length, 0.014, 0.05), (0, DEPTH / 2 - 0.007, HEIGHT)), stone)
    start = -length / 2 + 0.03
    for low, high in [*sorted(cuts), (length / 2 - 0.03, 0.0)]:
        if low - start > 0.15:
            piece.surfaces.append((start, -DEPTH / 2 + 0.05, low, DEPTH / 2 - 0.05, HEIGHT))
        start = high


def wall_cupboards(rng: np.random.Generator, looks: Looks, length: float = 1.8) -> Assembly:
    """A run of wall cupboards, some with glass doors or open; hang its lower edge at about 1.4 m."""
    piece, style = Assembly("furniture"), int(rng.integers(3))
    height, depth, edges = rng.uniform(0.6, 0.8), rng.uniform(0.32, 0.37), _modules(rng, length)
    carcass = fronts_of(looks)
    for x0, x1 in zip(edges[:-1], edges[1:], strict=True):
        x, w = (x0 + x1) / 2, x1 - x0
        if rng.random() < 0.2:
            for side in (-1, 1):
                piece.add(box((0.018, depth, height), (x + side * (w / 2 - 0.009), 0, 0)), carcass)
            piece.add(box((w - 0.036, 0.01, height), (x, depth / 2 - 0.005, 0)), carcass)
            for z in (0.0, height / 2, height - 0.018):
                piece.add(box((w - 0.036, depth - 0.012, 0.018), (x, -0.006, z)), carcass)
                if z < height - 0.1:
                    _dishes(rng, looks, piece, x, w - 0.06, -0.01, z + 0.018, height / 2 - 0.03)
            continue
        piece.add(box((w, depth - 0.02, height), (x, 0.01, 0)), carcass)
        _front(piece, looks, (x, -depth / 2 + 0.02, 0), (w, height), style, False)
    piece.surfaces.append(
        (-length / 2 + 0.06, -depth / 2 + 0.06, length / 2 - 0.06, depth / 2 - 0.05, height)
    )
    return piece


def _dishes(
    rng: np.random.Generator,
    looks: Looks,
    piece: Assembly,
    x: float,
    width: float,
    y: float,
    z: float,
    room: float,
) -> None:
    """A row of kitchen things on a board under the next one `room` above."""
    at = x - width / 2
    for _ in range(8):
        thing = pick(rng, looks, "kitchen")
        low, high = thing.bounds()
        if high[2] > room or high[0] - low[0] > width or high[1] - low[1] > 0.3:
            continue
        if at + high[0] - low[0] > x + width / 2:
            return
        piece.attach(thing, (at - low[0], y - (low[1] + high[1]) / 2, z))
        at += high[0] - low[0] + rng.uniform(0.015, 0.06)


def kitchen_shelf(rng: np.random.Generator, looks: Looks) -> Assembly:
    """Open boards with dishes and jars, and cups on hooks; hang its lower edge at about 1.3 m."""
    piece, wood = Assembly("furniture"), looks.wood()
    width, depth, gap = rng.uniform(0.7, 1.3), 0.25, rng.uniform(0.3, 0.36)
    for k in range(int(rng.integers(1, 4))):
        z = 0.1 + k * gap
        piece.add(box((width, depth, 0.026), (0, 0, z), 0.003), wood)
        for side in (-1, 1):
            piece.add(box((0.018, 0.2, 0.09), (side * (width / 2 - 0.12), 0.025, z - 0.09)), looks.metal)
        _dishes(rng, looks, piece, 0.0, width - 0.06, 0.0, z + 0.026, gap - 0.06)
    return piece


def island(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A free-standing counter with cupboards at the front and room for stools behind (+y)."""
    piece = base_units(rng, looks, rng.uniform(1.3, 1.8), False, rng.random() < 0.3)
    length = float(np.ptp(piece.bounds()[:, 0]))
    piece.parts = [p for p in piece.parts if p[0].bounds()[1, 2] < HEIGHT + 0.045 or p[2] == "objects"]
    piece.add(
        box((length + 0.02, 0.24, TOP), (0, DEPTH / 2 + 0.121, HEIGHT - TOP), 0.004), finishes.stone(looks)
    )
    return piece
