"""The palette of one room: materials with seeded colours and textures, made when they are first asked for."""

from collections.abc import Sequence

import numpy as np

from dsmap.sim_scenes import textures, textures_art
from dsmap.sim_scenes.scene import Material
from dsmap.sim_scenes.textures import Rng

WOODS = (
    (0.62, 0.44, 0.28),
    (0.45, 0.28, 0.17),
    (0.76, 0.6, 0.42),
    (0.3, 0.19, 0.13),
    (0.68, 0.5, 0.33),
    (0.55, 0.47, 0.4),
)
FABRICS = ((0.45, 0.47, 0.5), (0.25, 0.33, 0.45), (0.55, 0.25, 0.2), (0.62, 0.55, 0.42), (0.28, 0.4, 0.32),
           (0.7, 0.66, 0.6), (0.4, 0.3, 0.42), (0.3, 0.27, 0.26), (0.65, 0.45, 0.2), (0.2, 0.42, 0.48))  # fmt: skip
WALLS = ((0.78, 0.75, 0.68), (0.7, 0.76, 0.78), (0.76, 0.72, 0.62), (0.68, 0.74, 0.66), (0.8, 0.78, 0.75),
         (0.74, 0.66, 0.62), (0.6, 0.68, 0.74), (0.8, 0.72, 0.58))  # fmt: skip
WHITES = ((0.84, 0.83, 0.8), (0.8, 0.79, 0.77), (0.85, 0.82, 0.76))
CARPETS = ((0.5, 0.46, 0.4), (0.42, 0.44, 0.46), (0.52, 0.4, 0.34), (0.36, 0.4, 0.36), (0.56, 0.52, 0.46))
METALS = ((0.3, 0.3, 0.32), (0.55, 0.55, 0.56), (0.14, 0.14, 0.15), (0.55, 0.45, 0.28))

_FINISH = {"wood": (0.18, 0.25), "planks": (0.15, 0.25), "tiles": (0.25, 0.4), "plain": (0.3, 0.5)}


class Looks:
    """Materials by name. Furniture asks for a kind (`wood`, `fabric`...) and gets a name to put on its parts."""

    def __init__(self, rng: Rng) -> None:
        self.rng = rng
        self.materials: dict[str, Material] = {}
        self.metal = self.tiled("plain", METALS)
        self.white = self.tiled("plain", WHITES)
        self.trim = self.tiled("plain", WHITES) if rng.random() < 0.6 else self.tiled("wood", WOODS)
        self._woods = [self.tiled("wood", WOODS) for _ in range(2)]
        self.spines = self.printed("spines", textures_art.spines(rng), 0.15)

    def add(self, kind: str, material: Material) -> str:
        """Register a material; returns the name that parts refer to it by."""
        name = f"{kind}_{len(self.materials)}"
        self.materials[name] = material
        return name

    def colour(self, palette: Sequence[Sequence[float]], spread: float = 0.08) -> np.ndarray:
        """A colour near one of a palette's."""
        base = np.array(palette[int(self.rng.integers(len(palette)))])
        return np.clip(
            base * (1 + self.rng.uniform(-spread, spread)) + self.rng.uniform(-0.03, 0.03, 3), 0.04, 0.92
        )

    def tiled(self, kind: str, palette: Sequence[Sequence[float]]) -> str:
        """A new material with a tileable texture of `textures.TILED`."""
        make, tile = textures.TILED[kind]
        specular, shininess = _FINISH.get(kind, (0.04, 0.1))
        tile *= self.rng.uniform(0.85, 1.2)
        return self.add(kind, Material(make(self.rng, self.colour(palette)), tile, specular, shininess))

    def printed(
        self, kind: str, image: np.ndarray, specular: float = 0.05, emission: float = 0.0, glass: bool = False
    ) -> str:
        """A new material with a picture that spans the uv range 0..1."""
        return self.add(kind, Material(image, 1.0, specular, 0.5, emission, glass))

    def wood(self) -> str:
        """One of the room's two woods, so that its furniture belongs together; now and then a third."""
        if self.rng.random() < 0.15:
            return self.tiled("wood", WOODS)
        return self._woods[self.rng.integers(2)]

    def case(self) -> str:
        """For cabinets: wood or white lacquer."""
        return self.white if self.rng.random() < 0.25 else self.wood()

    def fabric(self) -> str:
        """A new upholstery or cloth."""
        if self.rng.random() < 0.25:
            first, second = self.colour(FABRICS), self.colour(FABRICS)
            return self.add(
                "cloth",
                Material(textures.motif(self.rng, first, second), self.rng.uniform(0.4, 0.9), 0.03, 0.1),
            )
        return self.tiled("fabric", FABRICS)

    def thing(self) -> str:
        """A plastic, ceramic or cardboard colour for small objects."""
        return self.tiled("plain", textures_art.SHADES)

    def wall(self) -> str:
        """Paint, wallpaper, or (rarely) bricks."""
        kind = self.rng.choice(4, p=[0.4, 0.28, 0.2, 0.12])
        if kind == 0:
            return self.tiled("paint", WALLS)
        if kind == 3:
            return self.tiled("bricks", ((0.6, 0.36, 0.27), (0.72, 0.68, 0.62)))
        first = self.colour(WALLS)
        second = np.clip(first * self.rng.uniform(0.72, 0.9) + self.rng.uniform(-0.05, 0.05, 3), 0, 0.9)
        make = textures.motif if kind == 1 else textures.stripes
        return self.add(
            "wallpaper", Material(make(self.rng, first, second), self.rng.uniform(0.8, 1.4), 0.03, 0.1)
        )

    def floor(self) -> str:
        """Parquet, carpet or stone tiles."""
        kind = self.rng.choice(["planks", "carpet", "tiles"], p=[0.55, 0.3, 0.15])
        return self.tiled(kind, {"planks": WOODS, "carpet": CARPETS, "tiles": WHITES}[kind])
