"""Pictures that are not tiled: paintings, the view from a window, book spines, rugs, covers."""

import cv2
import numpy as np

from dsmap.sim_scenes.textures.patterns import fractal, noise, to_bytes

SHADES = ((0.75, 0.2, 0.15), (0.15, 0.3, 0.55), (0.85, 0.65, 0.2), (0.2, 0.45, 0.3), (0.9, 0.87, 0.8),
          (0.25, 0.2, 0.2), (0.55, 0.3, 0.5), (0.2, 0.55, 0.6), (0.8, 0.45, 0.3), (0.6, 0.6, 0.62))  # fmt: skip
"""Colours of prints, spines and toys."""


def _gradient(height: int, width: int, top: np.ndarray, bottom: np.ndarray) -> np.ndarray:
    t = np.linspace(0, 1, height, dtype=np.float32)[:, None, None]
    return np.broadcast_to(top * (1 - t) + bottom * t, (height, width, 3)).astype(np.float32).copy()


def _hills(image: np.ndarray, rng: np.random.Generator, horizon: float, colours: list[np.ndarray]) -> None:
    """Draw ranges of hills from the horizon downwards into `image`."""
    height, width = image.shape[:2]
    for k, colour in enumerate(colours):
        knots = rng.uniform(-1, 1, 7).astype(np.float32)[None]
        ridge = cv2.resize(knots, (width, 1), interpolation=cv2.INTER_CUBIC)[0] * 0.07
        line = (horizon + 0.13 * k + ridge) * height
        mask = np.arange(height)[:, None] > line[None]
        rough = 1 + 0.18 * cv2.resize(fractal(rng, 6, 4), (width, height))
        image[mask] = (colour * rough[..., None])[mask]


def landscape(rng: np.random.Generator, height: int = 192, width: int = 256) -> np.ndarray:
    """A painted landscape with sky, sun and hills, uint8 (height, width, 3)."""
    top, bottom = rng.uniform(0.25, 0.7, 3), rng.uniform(0.6, 0.95, 3)
    image = _gradient(height, width, top, bottom)
    sun = (int(rng.uniform(0.15, 0.85) * width), int(rng.uniform(0.12, 0.35) * height))
    cv2.circle(image, sun, int(rng.uniform(0.05, 0.1) * height), (0.98, 0.9, 0.6), -1, cv2.LINE_AA)
    base = np.array(SHADES[rng.integers(len(SHADES))])
    _hills(image, rng, rng.uniform(0.4, 0.6), [base * f for f in (0.95, 0.7, 0.5, 0.35)])
    return to_bytes(image + 0.05 * noise(rng, (60, 60), (height, width))[..., None])


def abstract(rng: np.random.Generator, height: int = 192, width: int = 256) -> np.ndarray:
    """Overlapping discs, bars and strokes, uint8 (height, width, 3)."""
    image = np.broadcast_to(
        np.array(SHADES[rng.integers(len(SHADES))], np.float32), (height, width, 3)
    ).copy()
    for _ in range(rng.integers(8, 18)):
        colour = tuple(float(v) for v in np.array(SHADES[rng.integers(len(SHADES))]) * rng.uniform(0.7, 1.1))
        a = (int(rng.uniform(0, width)), int(rng.uniform(0, height)))
        b = (int(rng.uniform(0, width)), int(rng.uniform(0, height)))
        kind = rng.integers(3)
        if kind == 0:
            cv2.circle(image, a, int(rng.uniform(0.05, 0.25) * height), colour, -1, cv2.LINE_AA)
        elif kind == 1:
            cv2.rectangle(image, a, b, colour, -1)
        else:
            cv2.line(image, a, b, colour, int(rng.uniform(2, 14)), cv2.LINE_AA)
    return to_bytes(image * (1 + 0.08 * noise(rng, (48, 64), (height, width))[..., None]))


def figure(image: np.ndarray, rng: np.random.Generator, cx: int, scale: int) -> None:
    """Draw a head and shoulders at the foot of `image` (float, 0..1): middle column `cx`, `scale` texels wide."""
    height = image.shape[0]
    cy = height - int(0.78 * scale)
    skin = np.array([0.85, 0.65, 0.5]) * rng.uniform(0.5, 1.05)
    clothes, hair = rng.uniform(0.1, 0.7, 3), rng.uniform(0.05, 0.5) * np.array([1, 0.75, 0.5])
    for at, axes, colour in (
        ((cx, height), (0.42, 0.46), clothes),
        ((cx, cy - scale // 22), (0.21, 0.28), hair),
        ((cx, cy + scale // 30), (0.16, 0.24), skin),
    ):
        size = (int(axes[0] * scale), int(axes[1] * scale))
        cv2.ellipse(image, at, size, 0, 0, 360, colour.tolist(), -1, cv2.LINE_AA)
    for side in (-1, 1):
        at = (cx + side * int(0.06 * scale), cy)
        cv2.circle(image, at, max(1, scale // 60), (0.1, 0.08, 0.08), -1, cv2.LINE_AA)
    mouth = cy + int(0.14 * scale)
    cv2.line(
        image, (cx - scale // 20, mouth), (cx + scale // 20, mouth), (0.55, 0.2, 0.2), max(1, scale // 60), cv2.LINE_AA
    )  # fmt: skip


def portrait(rng: np.random.Generator, height: int = 224, width: int = 176) -> np.ndarray:
    """A head and shoulders against a dark ground, uint8 (height, width, 3)."""
    image = _gradient(height, width, rng.uniform(0.15, 0.4, 3), rng.uniform(0.1, 0.5, 3))
    figure(image, rng, int(width * rng.uniform(0.42, 0.58)), int(min(width, 0.8 * height)))
    return to_bytes(image * (1 + 0.1 * noise(rng, (56, 44), (height, width))[..., None]))


def painting(rng: np.random.Generator) -> np.ndarray:
    """One of the three kinds of pictures."""
    return (landscape, abstract, portrait)[rng.integers(3)](rng)


def outdoors(rng: np.random.Generator, height: int = 256, width: int = 256) -> np.ndarray:
    """What one sees through a window: sky with clouds, far hills, trees; bright, uint8."""
    image = _gradient(height, width, np.array([0.5, 0.7, 0.95]), np.array([0.86, 0.92, 0.98]))
    clouds = np.clip(cv2.resize(fractal(rng, 3, 5), (width, height)) * 0.8, 0, 1)[..., None]
    image = image * (1 - clouds) + np.array([0.97, 0.97, 0.98]) * clouds
    green = np.array([0.4, 0.55, 0.32]) * rng.uniform(0.8, 1.2)
    _hills(image, rng, rng.uniform(0.5, 0.62), [np.array([0.6, 0.68, 0.72]), green, green * 0.75])
    for _ in range(rng.integers(3, 8)):
        x, y, r = rng.uniform(0, width), rng.uniform(0.6, 0.85) * height, rng.uniform(0.06, 0.16) * height
        cv2.rectangle(
            image, (int(x - r / 8), int(y)), (int(x + r / 8), int(y + 2 * r)), (0.3, 0.22, 0.16), -1
        )
        for _ in range(14):
            dx, dy = rng.normal(0, 0.45, 2) * r
            leaf = (green * rng.uniform(0.5, 1.0)).tolist()
            cv2.circle(
                image, (int(x + dx), int(y + dy)), int(r * rng.uniform(0.25, 0.5)), leaf, -1, cv2.LINE_AA
            )
    return to_bytes(image)


SPINES = 24
"""Book spines side by side in one image of `spines`."""


def spines(rng: np.random.Generator, height: int = 128, width: int = 384) -> np.ndarray:
    """An atlas of `SPINES` book spines, each of one of four designs, uint8."""
    image = np.zeros((height, width, 3), np.float32)
    step = width // SPINES
    for k in range(SPINES):
        spine = image[:, k * step : (k + 1) * step]
        first, second = (
            np.array(SHADES[rng.integers(len(SHADES))]) * rng.uniform(0.5, 1.15) + rng.uniform(-0.06, 0.06, 3)
            for _ in range(2)
        )
        spine[:] = np.clip(first, 0.03, 0.95)
        _spine(spine, rng, np.clip(second, 0.03, 0.95))
        spine *= 1 - 0.25 * np.abs(np.linspace(-1, 1, spine.shape[1]))[None, :, None] ** 3
    return to_bytes(image * (1 + 0.05 * noise(rng, (32, 96), (height, width))[..., None]))


def _spine(spine: np.ndarray, rng: np.random.Generator, ink: np.ndarray) -> None:
    """Print one spine (height, width, 3): bands, a label, two halves, or ribs of gold; and a title."""
    height, width = spine.shape[:2]
    design = rng.integers(4)
    start, stop = int(height * rng.uniform(0.15, 0.3)), int(height * rng.uniform(0.6, 0.85))
    if design == 0:
        for _ in range(rng.integers(1, 4)):
            y = int(rng.uniform(0, 0.95) * height)
            spine[y : y + int(rng.uniform(3, 14))] = ink
    elif design == 1:
        spine[start:stop, 2:-2], ink = ink, spine[0, 0].copy()
        start, stop = start + 4, stop - 4
    elif design == 2:
        spine[: int(height * rng.uniform(0.3, 0.7))] = ink
        ink = np.array([0.92, 0.9, 0.85])
    else:
        ink = np.array([0.8, 0.66, 0.32])
        for y in np.linspace(0.06, 0.94, int(rng.integers(4, 7))):
            spine[int(y * height) : int(y * height) + 2] = ink
    for y in range(start, stop, 5):
        if rng.random() < 0.85:
            spine[y : y + 3, width // 3 : 2 * width // 3] = ink


def rug(rng: np.random.Generator, height: int = 256, width: int = 384) -> np.ndarray:
    """A woven rug: borders and a symmetric field of figures, uint8."""
    colours = [
        np.array(SHADES[i]) * rng.uniform(0.6, 0.95) for i in rng.choice(len(SHADES), 3, replace=False)
    ]
    quarter = noise(rng, (7, 9), (height // 2, width // 2))
    half = np.concatenate([quarter, quarter[:, ::-1]], 1)
    field = np.concatenate([half, half[::-1]], 0)
    image = np.where((field > 0.1)[..., None], colours[0], colours[1])
    image = np.where((np.abs(field) < 0.06)[..., None], colours[2], image)
    for inset, colour in ((26, 2), (18, 0), (8, 1)):
        frame = np.ones((height, width), bool)
        frame[inset:-inset, inset:-inset] = False
        image[frame] = colours[colour]
    pile = 0.1 * noise(rng, (96, 128), (height, width)) + 0.07 * noise(rng, (24, 32), (height, width))
    return to_bytes(image * (1 + pile[..., None]))


def cover(rng: np.random.Generator, height: int = 128, width: int = 96) -> np.ndarray:
    """A book or magazine cover, a box's print: blocks of colour with lines of text, uint8."""
    image = abstract(rng, height, width).astype(np.float32) / 255
    paper = np.array(SHADES[rng.integers(len(SHADES))])
    image[: height // 4] = paper
    for row in range(4):
        y = 6 + row * 7
        cv2.line(image, (8, y), (int(width * rng.uniform(0.4, 0.9)), y), (1 - paper).tolist(), 3)
    return to_bytes(image)
