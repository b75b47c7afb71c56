"""What hangs on walls: pictures of many sizes, galleries, posters, clocks, a wall-mounted television.

Back at the largest y, lower edge at z = 0, as `Layout.hang` expects.
"""

import numpy as np

from dsmap.sim_scenes.geometry.lofts import tube
from dsmap.sim_scenes.geometry.shapes import box, cylinder, lathe, panel, rotation_x
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures import art, finishes, screens
from dsmap.sim_scenes.textures.palette import Looks


def framed(
    rng: np.random.Generator, looks: Looks, height: float, frame: str, rim: float, mount: float
) -> Assembly:
    """A picture of a given height without its frame [m]: rim of the frame, white mount around the image."""
    piece, image = Assembly("picture"), art.painting(rng)
    width = height * image.shape[1] / image.shape[0]
    w, h = width + 2 * mount, height + 2 * mount
    if mount:
        piece.add(box((w, 0.01, h), (0, 0.008, rim)), finishes.paper(looks))
    piece.add(panel(width, height, 0.012).moved((0, 0.006, rim + mount)), looks.printed("painting", image))
    for side in (-1, 1):
        piece.add(box((rim, 0.028, h + 2 * rim), (side * (w + rim) / 2, 0.0, 0), 0.004), frame)
        piece.add(box((w, 0.026, rim), (0, 0.0, 0 if side < 0 else h + rim), 0.004), frame)
    return piece


def _frame(rng: np.random.Generator, looks: Looks) -> str:
    return (looks.wood, lambda: looks.metal, lambda: finishes.dark(looks), lambda: looks.white)[
        rng.integers(4)
    ]()


def picture(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A framed picture of 0.2 to 1.1 m, or a canvas without a frame."""
    height = rng.uniform(0.2, 0.45) if rng.random() < 0.4 else rng.uniform(0.45, 0.95)
    if rng.random() < 0.2:
        piece, image = Assembly("picture"), art.painting(rng)
        width = height * image.shape[1] / image.shape[0]
        piece.add(box((width - 0.002, 0.028, height - 0.002), (0, 0.002, 0.001)), looks.white)
        piece.add(panel(width, height, 0.008).moved((0, -0.012, 0)), looks.printed("painting", image))
        return piece
    mount = rng.uniform(0.03, 0.09) if rng.random() < 0.5 else 0.0
    return framed(rng, looks, height, _frame(rng, looks), rng.uniform(0.015, 0.06), mount)


def gallery(rng: np.random.Generator, looks: Looks) -> Assembly:
    """Three to nine small pictures hung in rows with equal frames."""
    piece, frame = Assembly("picture"), _frame(rng, looks)
    columns, rows, height = int(rng.integers(2, 5)), int(rng.integers(1, 4)), rng.uniform(0.17, 0.3)
    pitch = height * 1.34 + 0.14
    for column in range(columns):
        for row in range(rows):
            if rows > 1 and rng.random() < 0.12:
                continue
            one = framed(rng, looks, height * rng.uniform(0.8, 1.0), frame, 0.018, rng.choice([0.0, 0.03]))
            x, z = (column - (columns - 1) / 2) * pitch, row * (height + 0.16)
            piece.attach(one, (x, 0, z))
    if not piece.parts:
        piece.attach(framed(rng, looks, height, frame, 0.018, 0.0), (0, 0, 0))
    low = piece.bounds()[0, 2]
    piece.reshape(lambda shape: shape.moved((0, 0, -low)))
    return piece


def poster(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A sheet of paper on the wall."""
    piece, image = (
        Assembly("picture"),
        art.painting(rng) if rng.random() < 0.5 else art.cover(rng),
    )
    height = rng.uniform(0.5, 1.0)
    width = height * image.shape[1] / image.shape[0]
    piece.add(panel(width, height, 0.003), looks.printed("poster", image))
    return piece


def wall_clock(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A round clock with two hands (an object)."""
    piece, r = Assembly("objects"), rng.uniform(0.12, 0.2)
    turn = rotation_x(np.pi / 2)
    rim = lathe([(r, 0), (r, 0.03), (0.93 * r, 0.036)], sides=40).turned(turn)
    piece.add(rim.moved((0, 0.018, r)), _frame(rng, looks))
    piece.add(cylinder(0.91 * r, 0.003, sides=40).turned(turn).moved((0, -0.0185, r)), finishes.paper(looks))
    for hour in range(12):
        a = hour * np.pi / 6
        tick = [
            (0.78 * r * np.sin(a), -0.022, r + 0.78 * r * np.cos(a)),
            (0.86 * r * np.sin(a), -0.022, r + 0.86 * r * np.cos(a)),
        ]
        piece.add(tube(tick, 0.003, 5), finishes.dark(looks))
    for long in (0.5, 0.72):
        a = rng.uniform(0, 2 * np.pi)
        piece.add(
            tube([(0, -0.024, r), (long * r * np.sin(a), -0.024, r + long * r * np.cos(a))], 0.004, 6),
            finishes.dark(looks),
        )
    return piece


def wall_television(rng: np.random.Generator, looks: Looks, width: float | None = None) -> Assembly:
    """A flat television on the wall (class tv)."""
    piece, width = Assembly("tv"), rng.uniform(0.8, 1.45) if width is None else width
    height, image = width * 0.5625, screens.screen(rng)
    glow = 0.35 if float(image.mean()) > 60 else 0.0
    body = finishes.dark(looks)
    piece.add(box((width + 0.02, 0.025, height + 0.024), (0, -0.03, 0), 0.005), body)
    piece.add(box((0.4 * width, 0.055, 0.4 * height), (0, 0.0, 0.3 * height)), body)
    piece.add(
        panel(width, height, 0.003).moved((0, -0.0435, 0.012)),
        looks.printed("screen", image, 0.35, glow, True),
    )
    return piece
