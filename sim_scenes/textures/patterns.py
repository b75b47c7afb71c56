"""Procedural surface textures as NumPy images: uint8 RGB, tileable unless said otherwise.

Detail finer than about 5 mm on the wall would alias (the ray tracer takes one sample a pixel), so noise
starts at a few texels and carries most of its energy at centimetres.
"""

from collections.abc import Callable, Sequence

import cv2
import numpy as np

Colour = Sequence[float] | np.ndarray

SIZE = 384
"""Texels along each side of a tileable texture."""


def noise(
    rng: np.random.Generator, cells: tuple[int, int], size: tuple[int, int] = (SIZE, SIZE)
) -> np.ndarray:
    """Smooth tileable noise in about [-1, 1], float32, shape `size` (rows, columns), with `cells` lumps."""
    lattice = rng.uniform(-1, 1, cells).astype(np.float32)
    padded = np.pad(lattice, 2, mode="wrap")
    scale = (size[0] / cells[0], size[1] / cells[1])
    big = cv2.resize(
        padded,
        (round(padded.shape[1] * scale[1]), round(padded.shape[0] * scale[0])),
        interpolation=cv2.INTER_CUBIC,
    )
    top, left = round(2 * scale[0]), round(2 * scale[1])
    return big[top : top + size[0], left : left + size[1]]


def fractal(
    rng: np.random.Generator, cells: int = 4, octaves: int = 5, roughness: float = 0.55
) -> np.ndarray:
    """Sum of octaves of noise, about [-1, 1], shape (SIZE, SIZE)."""
    total, amplitude, image = 0.0, 1.0, np.zeros((SIZE, SIZE), np.float32)
    for octave in range(octaves):
        n = min(cells * 2**octave, SIZE // 3)
        image += amplitude * noise(rng, (n, n))
        total += amplitude**2
        amplitude *= roughness
    return image / np.sqrt(total)


def to_bytes(image: np.ndarray) -> np.ndarray:
    """Colours 0..1, any shape, to uint8."""
    return cv2.addWeighted(image, 255.0, image, 0.0, 0.0, dtype=cv2.CV_8U)


def shaded(colour: Colour, brightness: np.ndarray) -> np.ndarray:
    """A colour (0..1) times 1 + brightness, as uint8."""
    return to_bytes((1 + brightness[..., None].astype(np.float32)) * np.asarray(colour, np.float32))


def mixed(
    first: Colour, second: Colour, weight: np.ndarray, brightness: np.ndarray | float = 0.0
) -> np.ndarray:
    """Blend of two colours by `weight` in [0, 1], as uint8."""
    weight = np.clip(weight, 0, 1)[..., None].astype(np.float32)
    image = np.asarray(first, np.float32) * (1 - weight) + np.asarray(second, np.float32) * weight
    image *= 1 + np.broadcast_to(np.asarray(brightness, np.float32), weight.shape[:2])[..., None]
    return to_bytes(image)


def grid() -> tuple[np.ndarray, np.ndarray]:
    """Texel coordinates in [0, 1): rows, columns."""
    line = (np.arange(SIZE, dtype=np.float32) + 0.5) / SIZE
    return np.meshgrid(line, line, indexing="ij")


def wood(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Grain along the columns: stretched noise, growth rings and a few knots. One tile is about 1 m."""
    y, x = grid()
    warp = 0.03 * noise(rng, (3, 2)) + 0.012 * noise(rng, (12, 4))
    for _ in range(rng.integers(1, 4)):
        ky, kx = rng.uniform(0.15, 0.85, 2)
        warp += 0.05 * np.exp(-(((y - ky) / 0.05) ** 2 + ((x - kx) / 0.08) ** 2))
    rings = np.sin(2 * np.pi * (rng.integers(7, 15) * (y + warp)))
    fine = noise(rng, (SIZE // 3, 6)) + 0.6 * noise(rng, (SIZE // 4, 12))
    return shaded(colour, 0.10 * rings + 0.09 * fine + 0.07 * fractal(rng, 3, 3))


def planks(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """A parquet floor: rows of boards with their own tone and grain, joints dark. One tile is about 1.6 m."""
    rows, image = 10, np.zeros((SIZE, SIZE), np.float32)
    height = SIZE // rows
    for row in range(rows + 1):
        cuts = np.sort((rng.uniform(0, 1) + np.arange(3) / 3 + rng.uniform(-0.08, 0.08, 3)) % 1)
        tone = rng.uniform(-0.2, 0.16, 3)
        which = np.searchsorted(cuts, (np.arange(SIZE) + 0.5) / SIZE) % 3
        strip = slice(row * height, (row + 1) * height)
        image[strip] = tone[which]
        edges = np.flatnonzero(np.diff(which, append=which[0]))
        image[strip][:, edges] = -0.55
        image[row * height : row * height + 2] = -0.45
    grain = 0.08 * noise(rng, (SIZE // 3, 10)) + 0.05 * noise(rng, (60, 20)) + 0.06 * fractal(rng, 3, 3)
    return shaded(colour, image + grain)


def tiles(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Square stone tiles with light joints, four by four in a tile of about 1.6 m."""
    y, x = grid()
    count = 4
    tone = np.kron(rng.uniform(-0.08, 0.08, (count, count)), np.ones((SIZE // count, SIZE // count)))
    edge = np.minimum(np.abs((y * count) % 1 - 0.5), np.abs((x * count) % 1 - 0.5))
    joint = (np.maximum(np.abs((y * count) % 1 - 0.5), np.abs((x * count) % 1 - 0.5)) > 0.485).astype(
        np.float32
    )
    veins = np.abs(fractal(rng, 4, 5)) ** 0.5
    return mixed(colour, (0.62, 0.6, 0.57), joint, tone + 0.18 * (veins - 0.6) + 0.02 * edge)


def carpet(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Short pile: strong lumps of a few centimetres and worn areas. One tile is about 1.2 m."""
    speckle = 0.13 * noise(rng, (96, 96)) + 0.1 * noise(rng, (48, 48))
    return shaded(colour, speckle + 0.13 * fractal(rng, 3, 4))


def fabric(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Upholstery: a visible weave, mottling and sometimes stripes or checks. One tile is about 0.6 m."""
    y, x = grid()
    threads = 48
    weave = 0.06 * np.sin(2 * np.pi * threads * x) * np.sin(2 * np.pi * threads * y)
    image = weave + 0.1 * noise(rng, (64, 64)) + 0.12 * fractal(rng, 4, 4)
    kind, other = rng.integers(4), np.clip(np.asarray(colour) * rng.uniform(0.45, 1.6), 0, 0.95)
    pattern = np.zeros_like(image)
    if kind == 1:
        pattern = (np.sin(2 * np.pi * rng.integers(3, 7) * x) > rng.uniform(0, 0.6)).astype(np.float32)
    elif kind == 2:
        n = rng.integers(3, 6)
        pattern = 0.5 * (np.sin(2 * np.pi * n * x) > 0.3) + 0.5 * (np.sin(2 * np.pi * n * y) > 0.3)
    return mixed(colour, other, pattern * 0.8, image)


def motif(rng: np.random.Generator, colour: Colour, second: Colour) -> np.ndarray:
    """A printed cloth or wallpaper: a symmetric figure drawn from low-frequency noise, repeated. Tile about 1 m."""
    repeat = int(rng.integers(3, 7))
    size = SIZE // repeat
    lump = noise(rng, (6, 6), (size, size))
    figure = lump + lump[:, ::-1] + (0.5 * (lump[::-1] + lump[::-1, ::-1]) if rng.random() < 0.5 else 0)
    tile = np.tile(cv2.GaussianBlur((figure > 0.25).astype(np.float32), (0, 0), 1.2), (repeat, repeat))
    tile = cv2.resize(tile, (SIZE, SIZE))
    return mixed(colour, second, tile, 0.05 * fractal(rng, 8, 4) + 0.03 * noise(rng, (90, 90)))


def stripes(rng: np.random.Generator, colour: Colour, second: Colour) -> np.ndarray:
    """Vertical stripes of two widths. One tile is about 1 m."""
    _, x = grid()
    count = int(rng.integers(4, 9))
    phase = (x * count) % 1
    weight = (phase < rng.uniform(0.3, 0.6)).astype(np.float32) + 0.6 * ((phase > 0.75) & (phase < 0.82))
    return mixed(colour, second, weight, 0.05 * fractal(rng, 6, 4) + 0.03 * noise(rng, (90, 90)))


def paint(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """A painted wall, fresh to worn: roller texture, patches and faint marks. One tile is about 2.5 m."""
    marks = np.clip(fractal(rng, 10, 3) - 1.1, 0, 1) * 0.35
    patches = 0.05 * fractal(rng, 3, 4) + 0.03 * noise(rng, (48, 48)) - marks
    return shaded(colour, rng.uniform(0.3, 1.0) * patches + 0.025 * noise(rng, (SIZE // 4, SIZE // 4)))


def bricks(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """A visible brick wall. One tile is about 1 m."""
    y, x = grid()
    rows, columns = 12, 4
    row = np.floor(y * rows).astype(int)
    shifted = (x * columns + 0.5 * (row % 2)) % columns
    tone = rng.uniform(-0.22, 0.16, (rows, columns))[row, np.floor(shifted).astype(int)]
    joint = ((y * rows) % 1 < 0.13) | (shifted % 1 < 0.045)
    joint = cv2.GaussianBlur(joint.astype(np.float32), (0, 0), 0.8)
    return mixed(
        colour,
        (0.66, 0.64, 0.6),
        joint,
        tone * (1 - joint) + 0.08 * noise(rng, (80, 80)) + 0.06 * fractal(rng, 6, 4),
    )


def plaster(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """A ceiling: fine lumps and large faint stains. One tile is about 2 m."""
    return shaded(
        colour, 0.035 * noise(rng, (100, 100)) + 0.04 * noise(rng, (40, 40)) + 0.035 * fractal(rng, 3, 4)
    )


def plain(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Lacquer, plastic or ceramic: nearly uniform, with faint smears. One tile is about 0.5 m."""
    small = (SIZE // 3, SIZE // 3)
    smears = 0.03 * noise(rng, (4, 4), small) + 0.025 * noise(rng, (16, 16), small)
    return shaded(colour, smears + 0.02 * noise(rng, (48, 48), small))


def leaves(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Foliage: veins and spots. One tile is about 0.2 m."""
    y, x = grid()
    veins = np.abs(np.sin(2 * np.pi * (6 * y + 3 * np.abs(x - 0.5))))
    return shaded(colour, 0.15 * fractal(rng, 5, 4) - 0.12 * (veins < 0.15))


TILED_PATTERNS: dict[str, tuple[Callable[..., np.ndarray], float]] = {
    "wood": (wood, 0.9), "planks": (planks, 1.6), "tiles": (tiles, 1.6), "carpet": (carpet, 1.2),
    "fabric": (fabric, 0.6), "paint": (paint, 2.2), "bricks": (bricks, 1.0), "plaster": (plaster, 2.0),
    "plain": (plain, 0.5), "leaves": (leaves, 0.2),
}  # fmt: skip
"""Texture kind to (generator, metres that one tile spans)."""
