"""What screens show and what hangs on walls beside paintings: desktops, programmes, posters, photographs."""

import cv2
import numpy as np

from dsmap.sim_scenes.textures.art import SHADES, abstract, figure, landscape, portrait
from dsmap.sim_scenes.textures.patterns import noise, to_bytes


def _shade(rng: np.random.Generator, low: float = 0.7, high: float = 1.1) -> list[float]:
    return np.clip(np.array(SHADES[rng.integers(len(SHADES))]) * rng.uniform(low, high), 0, 1).tolist()


def screen(rng: np.random.Generator, height: int = 180, width: int = 320, on: float = 0.4) -> np.ndarray:
    """A television or monitor: off (dark, with soft reflections), or with share `on` a picture, uint8."""
    if rng.random() >= on:
        return _off(rng, height, width)
    return (_programme, _desktop, _news, _code)[rng.integers(4)](rng, height, width)


def _off(rng: np.random.Generator, height: int, width: int) -> np.ndarray:
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    glow = np.exp(
        -(((x / width - rng.uniform(0.2, 0.8)) / 0.25) ** 2 + ((y / height - rng.uniform(0, 0.5)) / 0.3) ** 2)
    )
    slant = 0.03 * np.sin(6 * (x / width + y / height) + rng.uniform(0, 6))
    shade = 0.05 + 0.12 * glow + slant + 0.02 * noise(rng, (12, 20), (height, width))
    return to_bytes(shade[..., None] * np.array([0.95, 1.0, 1.1]))


def _programme(rng: np.random.Generator, height: int, width: int) -> np.ndarray:
    """A film still with black bars above and below."""
    image = (landscape if rng.random() < 0.7 else portrait)(rng, height, width)
    bar = int(height * rng.uniform(0, 0.13))
    if bar:
        image[:bar], image[-bar:] = 8, 8
    return image


def _news(rng: np.random.Generator, height: int, width: int) -> np.ndarray:
    """A speaker before a studio wall, a headline below."""
    image = abstract(rng, height, width).astype(np.float32) / 255 * 0.5 + 0.2
    for _ in range(int(rng.integers(1, 3))):
        figure(image, rng, int(rng.uniform(0.2, 0.8) * width), int(rng.uniform(0.75, 0.95) * height))
    band = _shade(rng)
    image[int(0.8 * height) : int(0.93 * height)] = band
    _lines(image, rng, (int(0.05 * width), int(0.85 * height)), int(0.7 * width), 2, (0.95, 0.95, 0.95), 8)
    return to_bytes(image)


def _lines(
    image: np.ndarray,
    rng: np.random.Generator,
    at: tuple[int, int],
    length: int,
    count: int,
    ink: tuple[float, ...],
    step: int,
) -> None:
    """Words as dashes: `count` rows of text from `at`, `step` texels apart."""
    for row in range(count):
        x, y = at[0], at[1] + row * step
        end = at[0] + int(length * rng.uniform(0.4, 1.0))
        while x < end:
            word = int(rng.integers(4, 22))
            cv2.line(image, (x, y), (min(x + word, end), y), ink, max(1, step // 3))
            x += word + 4


def _desktop(rng: np.random.Generator, height: int, width: int) -> np.ndarray:
    """A wallpaper picture, one or two windows, a task bar."""
    back = (landscape if rng.random() < 0.6 else abstract)(rng, height, width)
    image = back.astype(np.float32) / 255
    for _ in range(int(rng.integers(1, 3))):
        w, h = int(width * rng.uniform(0.4, 0.7)), int(height * rng.uniform(0.4, 0.75))
        x, y = int(rng.uniform(0, width - w)), int(rng.uniform(0, 0.85 * height - h))
        image[y : y + h, x : x + w] = 0.94
        image[y : y + 10, x : x + w] = _shade(rng)
        _lines(image, rng, (x + 8, y + 18), w - 16, max(1, (h - 24) // 8), (0.25, 0.25, 0.3), 8)
        if rng.random() < 0.6:
            side = min(h // 2, w // 3)
            chart = cv2.resize(abstract(rng, 64, 64), (side, side)).astype(np.float32) / 255
            image[y + h - side : y + h, x + w - side : x + w] = chart
    image[-12:] = 0.15
    for k in range(int(rng.integers(4, 10))):
        image[-10:-3, 6 + 12 * k : 14 + 12 * k] = _shade(rng)
    return to_bytes(image)


def _code(rng: np.random.Generator, height: int, width: int) -> np.ndarray:
    """An editor: coloured words on a dark or light ground."""
    dark = rng.random() < 0.7
    image = np.full((height, width, 3), 0.13 if dark else 0.95, np.float32)
    image[:, : width // 6] = 0.2 if dark else 0.85
    indent = 0
    for y in range(10, height - 8, 7):
        indent = int(np.clip(indent + rng.integers(-1, 2), 0, 4))
        x = width // 6 + 8 + 12 * indent
        for _ in range(int(rng.integers(0, 6))):
            word = int(rng.integers(6, 32))
            ink = np.array(_shade(rng)) * (1.0 if dark else 0.6)
            cv2.line(image, (x, y), (min(x + word, width - 4), y), ink.tolist(), 3)
            x += word + 5
    return to_bytes(image)
