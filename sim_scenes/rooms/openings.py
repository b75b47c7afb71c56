"""Doors, ways without doors, and windows: what fills the holes in walls, and the floor kept free before them."""

from dataclasses import dataclass

import numpy as np

from dsmap.sim_scenes.geometry.shapes import Shape, box, panel
from dsmap.sim_scenes.pieces import windows as window_dressing
from dsmap.sim_scenes.rooms.layout import Block, Layout, Wall, strip
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures import art
from dsmap.sim_scenes.textures.palette import Looks

CASING, LINING = 0.075, 0.022
"""Width of the frame around a door, thickness of the boards inside its hole [m]."""
CLOSED, OPEN, WAY, WINDOW = "closed", "open", "way", "window"
"""Kinds of openings: a closed door, a door that stands open, a way without a door, a window."""


@dataclass(frozen=True)
class Opening:
    """A hole in a wall, in the wall's own x."""

    x0: float
    x1: float
    z0: float
    z1: float
    kind: str
    leaf: bool = True
    """Of an open door: whether its leaf hangs on this side of the wall."""

    @property
    def x(self) -> float:
        """Its middle."""
        return (self.x0 + self.x1) / 2

    @property
    def width(self) -> float:
        """Of the hole."""
        return self.x1 - self.x0


def fill_opening(
    rng: np.random.Generator, looks: Looks, layout: Layout, wall: Wall, opening: Opening
) -> None:
    """Put the door, frame or window into its hole and keep the floor before it free."""
    if opening.kind == WINDOW:
        _window(rng, looks, layout, wall, opening)
        return
    _frame(looks, layout, wall, opening)
    if opening.kind == CLOSED:
        _closed(looks, layout, wall, opening)
    elif opening.kind == OPEN and opening.leaf:
        _ajar(rng, looks, layout, wall, opening)
    if opening.kind != CLOSED:
        layout.scene.targets.append(np.array([*wall.point(opening.x, 0.0), 1.1]))
    wall.busy.append((opening.x0 - 0.1, opening.x1 + 0.1, 0.0, opening.z1 + 0.1))
    layout.keep_out(wall, opening.x0, opening.x1, 0.85)
    layout.floor.anchors.append(wall.point(opening.x, 0.5))


def _frame(looks: Looks, layout: Layout, wall: Wall, opening: Opening) -> None:
    """Casing on this side and this side's half of the lining."""
    frame = Assembly("wall", name="door_frame")
    width, height, deep = opening.width, opening.z1, wall.thickness
    for side in (-1, 1):
        edge = side * width / 2
        frame.add(
            box((CASING, 0.03, height + CASING), (edge + side * CASING / 2, -0.015, 0), 0.006), looks.trim
        )
        frame.add(box((LINING, deep, height), (edge - side * LINING / 2, deep / 2, 0)), looks.trim)
    frame.add(box((width, 0.03, CASING), (0, -0.015, height), 0.006), looks.trim)
    frame.add(box((width - 2 * LINING, deep, LINING), (0, deep / 2, height - LINING)), looks.trim)
    layout.scene.place(frame, (*wall.point(opening.x, 0), 0), wall.yaw, room=layout.index)


def _leaf(looks: Looks, width: float, height: float) -> Assembly:
    """A door leaf with panels and handles, its hinge edge at the origin, reaching to x = width, y = 0..0.04."""
    leaf = Assembly("wall", name="door_leaf")
    wood = looks.upright(looks.case())
    leaf.add(box((width, 0.04, height - 0.008), (width / 2, 0.02, 0.008)), wood)
    board = width / 2 - 0.12
    for low, high in ((0.12, 0.85), (0.97, height - 0.14)):
        for x in (width / 4 + 0.015, 3 * width / 4 - 0.015):
            for y in (-0.006, 0.046):
                leaf.add(box((board, 0.012, high - low), (x, y, low), 0.005), wood)
    for y, out in ((-0.006, -1), (0.046, 1)):
        leaf.add(box((0.03, 0.014, 0.16), (width - 0.055, y, 0.95)), looks.metal)
        leaf.add(box((0.022, 0.05, 0.022), (width - 0.055, y + out * 0.025, 1.04)), looks.metal)
        leaf.add(box((0.12, 0.02, 0.022), (width - 0.1, y + out * 0.045, 1.04), 0.006), looks.metal)
    return leaf


def _closed(looks: Looks, layout: Layout, wall: Wall, opening: Opening) -> None:
    leaf = _leaf(looks, opening.width - 2 * LINING, opening.z1 - LINING)
    hinge = wall.point(opening.x0 + LINING, -0.05)
    layout.scene.place(leaf, (*hinge, 0), wall.yaw, room=layout.index)


def _ajar(rng: np.random.Generator, looks: Looks, layout: Layout, wall: Wall, opening: Opening) -> None:
    """A leaf that stands open into this room, away from the nearer corner or towards it, as there is room."""
    width = opening.width - LINING  # a rebated leaf: shut, it lies on the frame
    sides = [-1, 1] if wall.length / 2 + opening.x0 < wall.length / 2 - opening.x1 else [1, -1]
    for side in (sides if rng.random() < 0.8 else sides[::-1]) * 4:
        angle = np.radians(rng.uniform(86, 112))
        leaf = _leaf(looks, width, opening.z1 - LINING - 0.01)
        if side > 0:
            leaf.reshape(_mirrored)
        hinge = wall.point(opening.x0 if side < 0 else opening.x1, 0.036)
        yaw = wall.yaw + side * angle
        block = layout.block(leaf, hinge, yaw)
        if layout.fits(block, 0.0, wall=0.0):
            layout.taken.append(block)
            layout.floor.block(block.corners)
            layout.scene.place(leaf, (*hinge, 0), yaw, room=layout.index)
            return


def _mirrored(shape: Shape) -> Shape:
    return Shape(shape.vertices * [-1, 1, 1], shape.faces[:, ::-1], shape.uv)


def _window(rng: np.random.Generator, looks: Looks, layout: Layout, wall: Wall, opening: Opening) -> None:
    width, low, high = opening.width, opening.z0, opening.z1
    piece = Assembly("window", name="window")
    pane = looks.printed("pane", art.outdoors(rng), 0.0, rng.uniform(0.3, 0.45), glass=True)
    tall = high - low
    piece.add(panel(width, tall, 0.02).moved((0, 0.13, low)), pane)
    for side in (-1, 1):
        piece.add(box((0.06, 0.06, tall), (side * (width / 2 - 0.03), 0.09, low)), looks.trim)
        piece.add(box((width - 0.12, 0.06, 0.06), (0, 0.09, low if side < 0 else high - 0.06)), looks.trim)
    bars = 1 + int(width > 1.55) if width > 0.8 else 0
    for k in range(bars):
        at = ((k + 1) / (bars + 1) - 0.5) * width
        piece.add(box((0.055, 0.055, tall - 0.12), (at, 0.088, low + 0.06)), looks.trim)
    if rng.random() < 0.5:
        piece.add(box((width - 0.12, 0.04, 0.035), (0, 0.092, low + 0.62 * tall)), looks.trim)
    piece.add(box((width + 0.1, 0.09, 0.035), (0, -0.045, low - 0.035), 0.008), looks.trim)
    reach = _dressing(rng, looks, layout, wall, opening, piece)
    layout.scene.place(piece, (*wall.point(opening.x, 0), 0), wall.yaw, room=layout.index)
    layout.scene.targets.append(np.array([*wall.point(opening.x, 0.0), 1.25]))
    wall.busy.append((opening.x - reach, opening.x + reach, low - 0.1, high + 0.14))
    sill = strip(wall, opening.x0 - 0.06, opening.x1 + 0.06, 0.0, 0.1)
    layout.taken.append(Block(sill, low - 0.04, low + 0.02))


def _dressing(
    rng: np.random.Generator, looks: Looks, layout: Layout, wall: Wall, opening: Opening, piece: Assembly
) -> float:
    """Curtains or a blind, as there is room beside the window; returns how far it reaches from its middle [m]."""
    aside = min(opening.x0 + wall.length / 2, wall.length / 2 - opening.x1)
    if rng.random() < 0.15:
        return opening.width / 2 + 0.05
    make = window_dressing.roller_blind
    if opening.z0 < 1.04 and aside > 0.3:
        make = window_dressing.dressing
    elif rng.random() < 0.4:
        make = window_dressing.venetian_blind
    for kind in (make, window_dressing.roller_blind):
        cloth = kind(rng, looks, opening.width, opening.z0, opening.z1)
        low, high = cloth.bounds()
        x0, x1 = float(opening.x + low[0]), float(opening.x + high[0])
        foot, deep = float(low[2]), float(high[1] - low[1])
        block = Block(strip(wall, x0, x1, 0.0, deep), max(foot, 0.0), float(high[2]))
        if (
            max(-x0, x1) < wall.length / 2 - 0.02
            and high[2] < wall.height - 0.08
            and layout.fits(block, 0.02, wall=0.0)
        ):
            for shape, material, label, _ in cloth.parts:
                piece.add(shape, material, label)
            layout.taken.append(block)
            wall.busy.append((x0 - 0.02, x1 + 0.02, foot, float(high[2])))
            return max(opening.x - x0, x1 - opening.x)
    return opening.width / 2 + 0.05
