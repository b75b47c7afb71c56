"""The room itself: floor, ceiling, walls with openings, door, window with curtains, skirting, sockets."""

import numpy as np

from dsmap.sim_scenes import textures_art
from dsmap.sim_scenes.layout import Layout, Wall
from dsmap.sim_scenes.looks import WHITES, Looks
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.shapes import Shape, box, cylinder, panel, rotation_x, sheet
from dsmap.sim_scenes.textures import Rng

THICK = 0.16
"""Thickness of the walls [m]."""
Opening = tuple[float, float, float, float]


def build(rng: Rng, looks: Looks, layout: Layout, door: int, window: int) -> None:
    """Close the room: a door in wall number `door`, a window in wall number `window`."""
    size = layout.scene.size
    paper = looks.wall()
    accent = looks.wall() if rng.random() < 0.5 else paper
    accented = int(rng.integers(4))
    for kind, z in (("floor", -0.1), ("ceiling", size[2])):
        slab = Assembly(kind)
        material = looks.floor() if kind == "floor" else looks.tiled("plaster", WHITES)
        slab.add(box((size[0] + 2 * THICK, size[1] + 2 * THICK, 0.1), (0, 0, z)), material)
        layout.scene.place(slab, (0, 0, 0))
    for k, wall in enumerate(layout.walls):
        opening = (
            _door(rng, looks, layout, wall)
            if k == door
            else _window(rng, looks, layout, wall)
            if k == window
            else None
        )
        body = Assembly("wall")
        _wall_body(body, wall, opening, accent if k == accented else paper)
        _skirting(rng, body, looks, wall, opening if k == door else None)
        layout.scene.place(body, (*wall.centre, 0), wall.yaw)
        _sockets(rng, looks, layout, wall, opening)


def _wall_body(body: Assembly, wall: Wall, opening: Opening | None, material: str) -> None:
    """Boxes around the opening (x0, x1, z0, z1); the inner face at y = 0, uv continuous."""
    left, right = -wall.length / 2 - THICK, wall.length / 2 + THICK

    def slab(x0: float, x1: float, z0: float, z1: float) -> None:
        if x1 - x0 > 1e-6 and z1 - z0 > 1e-6:
            body.add(box((x1 - x0, THICK, z1 - z0), ((x0 + x1) / 2, THICK / 2, z0)), material)

    if opening is None:
        slab(left, right, 0, wall.height)
        return
    x0, x1, z0, z1 = opening
    slab(left, x0, 0, wall.height)
    slab(x1, right, 0, wall.height)
    slab(x0, x1, 0, z0)
    slab(x0, x1, z1, wall.height)


def _skirting(rng: Rng, body: Assembly, looks: Looks, wall: Wall, gap: Opening | None) -> None:
    height = 0.09
    reach = wall.length / 2
    for x0, x1 in [(-reach, reach)] if gap is None else [(-reach, gap[0] - 0.08), (gap[1] + 0.08, reach)]:
        body.add(box((x1 - x0, 0.016, height), ((x0 + x1) / 2, -0.008, 0)), looks.trim)
        body.add(box((x1 - x0, 0.008, 0.012), ((x0 + x1) / 2, -0.02, 0)), looks.trim)
    body.add(box((2 * reach, 0.04, 0.075), (0, -0.02, wall.height - 0.075)), looks.trim)


def _sockets(rng: Rng, looks: Looks, layout: Layout, wall: Wall, opening: Opening | None) -> None:
    for _ in range(int(rng.integers(1, 3))):
        x = rng.uniform(-wall.length / 2 + 0.3, wall.length / 2 - 0.3)
        if opening and opening[0] - 0.2 < x < opening[1] + 0.2:
            continue
        socket = Assembly("objects")
        socket.add(box((0.15, 0.012, 0.08), (0, -0.006, 0.26), 0.003), looks.white)
        for side in (-1, 1):
            hole = cylinder(0.022, 0.004, sides=16).turned(rotation_x(np.pi / 2))
            socket.add(hole.moved((side * 0.036, -0.012, 0.3)), looks.metal)
        layout.scene.place(socket, (*wall.point(x, 0), 0), wall.yaw)


def _door(rng: Rng, looks: Looks, layout: Layout, wall: Wall) -> Opening:
    width, height = rng.uniform(0.8, 0.92), rng.uniform(2.0, 2.08)
    x = rng.choice([-1, 1]) * (wall.length / 2 - width / 2 - rng.uniform(0.2, 0.5))
    opening = (x - width / 2, x + width / 2, 0.0, height)
    leaf = Assembly("wall")
    wood = looks.case()
    leaf.add(box((width, 0.04, height), (0, 0.07, 0)), wood)
    for low, high in ((0.12, 0.85), (0.97, height - 0.14)):
        for side in (-1, 1):
            leaf.add(
                box((width / 2 - 0.16, 0.02, high - low), (side * (width / 4 - 0.02), 0.05, low), 0.008), wood
            )
    for side in (-1, 1):
        leaf.add(
            box((0.075, 0.03, height + 0.075), (side * (width / 2 + 0.0375), -0.015, 0), 0.006), looks.trim
        )
    leaf.add(box((width, 0.03, 0.075), (0, -0.015, height), 0.006), looks.trim)
    leaf.add(box((0.03, 0.01, 0.16), (0.4 * width, 0.045, 0.95)), looks.metal)
    leaf.add(box((0.12, 0.02, 0.022), (0.4 * width - 0.045, 0.005, 1.04), 0.006), looks.metal)
    leaf.add(box((0.022, 0.05, 0.022), (0.4 * width, 0.02, 1.04)), looks.metal)
    layout.scene.place(leaf, (*wall.point(x, 0), 0), wall.yaw)
    layout.scene.targets.append(np.array([*wall.point(x, 0.0), 1.1]))
    wall.busy.append((opening[0] - 0.1, opening[1] + 0.1, 0.0, height + 0.1))
    corners = np.array([wall.point(x - width / 2, 0.02), wall.point(x + width / 2, 0.8)])
    layout.taken.append(np.array([corners.min(0), corners.max(0)]))
    return opening


def _window(rng: Rng, looks: Looks, layout: Layout, wall: Wall) -> Opening:
    width, low, high = rng.uniform(1.2, 1.9), rng.uniform(0.82, 0.98), rng.uniform(2.05, 2.25)
    width = min(width, wall.length - 1.4)
    x = rng.uniform(-1, 1) * max(0.0, wall.length / 2 - width / 2 - 0.6)
    piece = Assembly("window")
    pane = looks.printed("pane", textures_art.outdoors(rng), 0.0, rng.uniform(0.3, 0.45), glass=True)
    tall = high - low
    piece.add(panel(width, tall, 0.02).moved((0, 0.13, low)), pane)
    for side in (-1, 1):
        piece.add(box((0.06, 0.06, tall), (side * (width / 2 - 0.03), 0.09, low)), looks.trim)
        piece.add(box((width - 0.12, 0.06, 0.06), (0, 0.09, low if side < 0 else high - 0.06)), looks.trim)
    for k in range(1, 3 if width > 1.55 else 2):
        at = (k / (3 if width > 1.55 else 2) - 0.5) * width
        piece.add(box((0.055, 0.055, tall - 0.12), (at, 0.088, low + 0.06)), looks.trim)
    if rng.random() < 0.5:
        piece.add(box((width - 0.12, 0.04, 0.035), (0, 0.092, low + 0.62 * tall)), looks.trim)
    piece.add(box((width + 0.1, 0.09, 0.035), (0, -0.045, low - 0.035), 0.008), looks.trim)
    curtain_width, cloth = rng.uniform(0.3, 0.5), looks.fabric()
    foot, top = (0.04 if rng.random() < 0.6 else low - 0.25), high + 0.12
    for side in (-1, 1):
        piece.add(
            _curtain(rng, curtain_width, top - foot).moved((side * (width / 2 + 0.02), -0.15, foot)), cloth
        )
    rod = cylinder(0.014, width + 2 * curtain_width + 0.1, sides=16).turned(
        np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    )
    piece.add(rod.moved((-(width / 2 + curtain_width + 0.05), -0.15, top + 0.012)), looks.metal)
    layout.scene.place(piece, (*wall.point(x, 0), 0), wall.yaw)
    layout.scene.targets.append(np.array([*wall.point(x, 0.0), 1.25]))
    reach = width / 2 + curtain_width
    wall.busy.append((x - reach, x + reach, low - 0.1, top + 0.1))
    for side in (-1, 1):
        edge = x + side * (width / 2 + 0.02)
        wall.busy.append((edge - curtain_width / 2 - 0.03, edge + curtain_width / 2 + 0.03, 0.0, top))
    return (x - width / 2, x + width / 2, low, high)


def _curtain(rng: Rng, width: float, height: float) -> Shape:
    """A hanging cloth in folds that widen towards the floor, bottom centre at the origin."""
    columns, rows = 49, 14
    s, t = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows))
    folds = rng.integers(4, 7)
    phase = 2 * np.pi * folds * s + 0.5 * np.sin(3 * s + rng.uniform(0, 6)) * (1 - t)
    points = np.empty((rows, columns, 3))
    points[..., 0] = (s - 0.5) * width * (1 + 0.08 * (1 - t))
    points[..., 1] = (0.022 + 0.022 * (1 - t)) * np.sin(phase)
    points[..., 2] = t * height
    return sheet(points, 0.006)
