"""Materials that many pieces share: steel, porcelain, stone, mirror glass. One of each a room."""

import numpy as np

from dsmap.sim_scenes.scene import Material
from dsmap.sim_scenes.textures import patterns, surfaces
from dsmap.sim_scenes.textures.palette import Looks

_DARKS = ((0.07, 0.07, 0.08), (0.12, 0.12, 0.13), (0.16, 0.15, 0.15))
_STEELS = ((0.58, 0.59, 0.6), (0.66, 0.66, 0.66))
_PORCELAINS = ((0.88, 0.88, 0.86), (0.86, 0.85, 0.8))
_STONES = ((0.22, 0.22, 0.23), (0.55, 0.5, 0.45), (0.72, 0.7, 0.66), (0.4, 0.37, 0.35))
_LEATHERS = ((0.16, 0.12, 0.1), (0.36, 0.2, 0.12), (0.55, 0.5, 0.44), (0.1, 0.1, 0.11), (0.45, 0.12, 0.1))
_TOWELS = (
    (0.85, 0.84, 0.8),
    (0.3, 0.5, 0.58),
    (0.7, 0.35, 0.3),
    (0.5, 0.55, 0.4),
    (0.25, 0.28, 0.4),
    (0.8, 0.65, 0.4),
)
_PAPERS = ((0.9, 0.89, 0.86), (0.86, 0.86, 0.84))
_BASKETS = ((0.62, 0.46, 0.28), (0.5, 0.36, 0.22), (0.72, 0.6, 0.42))


def known(looks: Looks, kind: str) -> str | None:
    """The room's material of a kind, if it has one already."""
    return next((name for name in looks.materials if name.startswith(kind + "_")), None)


def _uniform(looks: Looks, kind: str, palette: tuple, specular: float, shininess: float) -> str:
    image = patterns.plain(looks.rng, looks.colour(palette, 0.04))
    return looks.add(kind, Material(image, 0.5, specular, shininess))


def steel(looks: Looks) -> str:
    """Brushed stainless steel or chrome."""
    found = known(looks, "steel")
    if found:
        return found
    image = surfaces.brushed(looks.rng, looks.colour(_STEELS, 0.04))
    return looks.add("steel", Material(image, 0.5, 0.6, 0.7, metallic=1.0))


def dark(looks: Looks) -> str:
    """Black or anthracite plastic."""
    return known(looks, "dark") or _uniform(looks, "dark", _DARKS, 0.25, 0.4)


def porcelain(looks: Looks) -> str:
    """White glazed ceramics and enamel."""
    return known(looks, "porcelain") or _uniform(looks, "porcelain", _PORCELAINS, 0.45, 0.8)


def paper(looks: Looks) -> str:
    """White paper."""
    return known(looks, "paper") or _uniform(looks, "paper", _PAPERS, 0.0, 0.1)


def stone(looks: Looks) -> str:
    """The worktop of a kitchen or bathroom: granite, marble, terrazzo, or a wood."""
    found = known(looks, "stone")
    if found:
        return found
    rng = looks.rng
    if rng.random() < 0.3:
        return looks.wood()
    make = (surfaces.granite, surfaces.marble, surfaces.terrazzo)[rng.integers(3)]
    return looks.add("stone", Material(make(rng, looks.colour(_STONES)), 0.8, 0.35, 0.6))


def leather(looks: Looks) -> str:
    """Smooth leather with a dull shine; a new colour each time."""
    image = patterns.shaded(
        looks.colour(_LEATHERS),
        0.1 * patterns.fractal(looks.rng, 8, 4) + 0.05 * patterns.noise(looks.rng, (90, 90)),
    )
    return looks.add("leather", Material(image, 0.5, 0.25, 0.3))


def towelling(looks: Looks) -> str:
    """Terry cloth; a new colour each time."""
    image = patterns.shaded(
        looks.colour(_TOWELS),
        0.12 * patterns.noise(looks.rng, (96, 96)) + 0.06 * patterns.fractal(looks.rng, 3, 3),
    )
    return looks.add("towel", Material(image, 0.35, 0.0, 0.1))


def wicker(looks: Looks) -> str:
    """Woven cane or rattan."""
    found = known(looks, "wicker")
    if found:
        return found
    y, x = np.mgrid[0 : patterns.SIZE, 0 : patterns.SIZE] / patterns.SIZE
    weave = 0.22 * np.sin(2 * np.pi * 10 * x) * np.sign(np.sin(2 * np.pi * 8 * y)) + 0.1 * np.sin(
        2 * np.pi * 16 * y
    )
    image = patterns.shaded(looks.colour(_BASKETS), weave + 0.1 * patterns.noise(looks.rng, (40, 40)))
    return looks.add("wicker", Material(image, 0.3, 0.05, 0.1))


def mirror_glass(looks: Looks) -> str:
    """A looking-glass: pale, with soft streaks like a blurred room; a depth sensor sees nothing there."""
    found = known(looks, "mirror")
    if found:
        return found
    rng = looks.rng
    y, x = np.mgrid[0:128, 0:128].astype(np.float32) / 128
    base = np.array([0.55, 0.6, 0.62], np.float32) * (1.15 - 0.45 * y)[..., None]
    lump = patterns.noise(rng, (3, 4), (128, 128)) * 0.16 + 0.05 * np.sin(9 * (x + y))
    image = np.clip(base + lump[..., None] * np.array([1.0, 0.9, 0.8], np.float32), 0, 1)
    return looks.add("mirror", Material((image * 255).astype(np.uint8), 1.0, 0.7, 0.9, 0.1, True))
