"""The palette of one room: materials with seeded colours and textures, made when they are first asked for."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from dsmap.sim_scenes.scene import Material
from dsmap.sim_scenes.textures import art, patterns, surfaces

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
METALS = ((0.3, 0.3, 0.32), (0.55, 0.55, 0.56), (0.14, 0.14, 0.15), (0.55, 0.45, 0.28), (0.66, 0.66, 0.65))
STONES = ((0.8, 0.78, 0.74), (0.24, 0.24, 0.25), (0.6, 0.55, 0.48), (0.45, 0.42, 0.4), (0.72, 0.66, 0.58))
GLAZES = ((0.86, 0.86, 0.84), (0.8, 0.8, 0.76), (0.62, 0.72, 0.74), (0.55, 0.62, 0.55), (0.3, 0.42, 0.5),
          (0.76, 0.68, 0.58), (0.34, 0.34, 0.36))  # fmt: skip
BRICKS = ((0.6, 0.36, 0.27), (0.72, 0.68, 0.62), (0.5, 0.42, 0.36))
CONCRETES = ((0.58, 0.57, 0.55), (0.46, 0.46, 0.46))

FINISH = {
    "wood": (0.18, 0.25), "planks": (0.15, 0.25), "herringbone": (0.2, 0.35), "tiles": (0.25, 0.4),
    "checker": (0.3, 0.5), "plain": (0.3, 0.5), "marble": (0.4, 0.7), "granite": (0.35, 0.6), "terrazzo": (0.3, 0.5),
    "slate": (0.1, 0.2), "ceramic": (0.4, 0.7), "brushed": (0.55, 0.6), "concrete": (0.06, 0.15),
    "paint": (0.04, 0.15),
}  # fmt: skip
"""Kind of surface to (specular, shininess); all others are dull."""

_FABRIC_KINDS = ("fabric", "corduroy", "tweed", "knit", "plaid")
POOL = 12
"""Most colours of small things, and most fabrics, that one scene has: they are reused after that."""


class Looks:
    """Materials by name. Furniture asks for a kind (`wood`, `fabric`...) and gets a name to put on its parts."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.materials: dict[str, Material] = {}
        self._pools: dict[str, list[str]] = {}
        self.metal = self.tiled("brushed", METALS)
        self.white = self.tiled("plain", WHITES)
        self.trim = self.tiled("plain", WHITES) if rng.random() < 0.6 else self.tiled("wood", WOODS)
        self._woods = [self.tiled("wood", WOODS) for _ in range(2)]
        self.spines = self.printed("spines", art.spines(rng), 0.15)

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
        """A new material with a tileable texture of `_KINDS`."""
        make, tile = _KINDS[kind]
        specular, shininess = FINISH.get(kind, (0.04, 0.1))
        tile *= self.rng.uniform(0.85, 1.2)
        image = make(self.rng, self.colour(palette))
        return self.add(kind, Material(image, tile, specular, shininess, metallic=float(kind == "brushed")))

    def pooled(self, kind: str, make: Callable[[], str], most: int = POOL) -> str:
        """One of at most `most` materials of a kind in this scene: made until there are that many, then reused."""
        pool = self._pools.setdefault(kind, [])
        if len(pool) < most:
            pool.append(make())
            return pool[-1]
        return pool[int(self.rng.integers(most))]

    def printed(
        self, kind: str, image: np.ndarray, specular: float = 0.05, emission: float = 0.0, glass: bool = False
    ) -> str:
        """A new material with a picture that spans the uv range 0..1."""
        return self.add(kind, Material(image, 1.0, specular, 0.5, emission=emission, glass=glass))

    def wood(self) -> str:
        """One of the room's two woods, so that its furniture belongs together; now and then a third."""
        if self.rng.random() < 0.15:
            return self.tiled("wood", WOODS)
        return self._woods[self.rng.integers(2)]

    def upright(self, name: str) -> str:
        """The same material with its texture turned by a quarter: the grain of doors and posts runs upwards."""
        turned = f"{name}_upright"
        if turned not in self.materials:
            look = self.materials[name]
            self.materials[turned] = replace(
                look, texture=np.ascontiguousarray(look.texture.transpose(1, 0, 2))
            )
        return turned

    def case(self) -> str:
        """For cabinets: wood or white lacquer."""
        return self.white if self.rng.random() < 0.25 else self.wood()

    def fabric(self) -> str:
        """An upholstery or cloth: woven, ribbed, knitted, checked or printed."""
        return self.pooled("fabric", self._fabric)

    def _fabric(self) -> str:
        kind = self.rng.choice(6, p=[0.34, 0.12, 0.13, 0.09, 0.1, 0.22])
        if kind < 5:
            return self.tiled(_FABRIC_KINDS[kind], FABRICS)
        make = (patterns.motif, surfaces.sprigs)[self.rng.integers(2)]
        image = make(self.rng, self.colour(FABRICS), self.colour(FABRICS))
        return self.add("cloth", Material(image, self.rng.uniform(0.4, 0.9), 0.03, 0.1))

    def thing(self) -> str:
        """A plastic, ceramic or cardboard colour for small objects."""
        return self.pooled("thing", lambda: self.tiled("plain", art.SHADES))

    def wall(self, room: str = "") -> str:
        """Paint, wallpaper, tiles (in wet rooms), or rarely bricks or concrete."""
        if room == "bathroom" and self.rng.random() < 0.75:
            return self.tiles()
        weights = (
            [0.62, 0.28, 0.05, 0.05] if room in ("", "living_room", "bedroom") else [0.84, 0.06, 0.05, 0.05]
        )
        kind = self.rng.choice(4, p=weights)
        if kind == 0:
            return self.tiled("paint", WALLS)
        if kind > 1:
            return self.tiled("bricks", BRICKS) if kind == 2 else self.tiled("concrete", CONCRETES)
        first = self.colour(WALLS)
        second = np.clip(first * self.rng.uniform(0.72, 0.9) + self.rng.uniform(-0.05, 0.05, 3), 0, 0.9)
        makes = (patterns.motif, patterns.stripes, surfaces.sprigs, surfaces.lattice)
        image = makes[self.rng.integers(4)](self.rng, first, second)
        return self.add("wallpaper", Material(image, self.rng.uniform(0.8, 1.4), 0.03, 0.1))

    def tiles(self) -> str:
        """Wall tiles of bathrooms and kitchens: glazed, or slabs of marble."""
        return self.tiled("marble", STONES) if self.rng.random() < 0.15 else self.tiled("ceramic", GLAZES)

    def floor(self, room: str = "") -> str:
        """Parquet, carpet, tiles or stone, as fits the kind of room."""
        kinds = FLOORS.get(room, FLOORS[""])
        kind = self.rng.choice(list(kinds), p=list(kinds.values()))
        palette = {
            "planks": WOODS,
            "herringbone": WOODS,
            "checker": STONES,
            "tiles": WHITES,
            "concrete": CONCRETES,
        }
        return self.tiled(kind, palette.get(kind, STONES if kind in STONY else CARPETS))


_KINDS: dict[str, tuple[Callable[..., np.ndarray], float]] = {
    **patterns.TILED_PATTERNS,
    **surfaces.TILED_SURFACES,
}
"""Kind of a tiled surface to (generator, metres that one tile spans)."""
STONY = ("marble", "granite", "terrazzo", "slate")
FLOORS: dict[str, dict[str, float]] = {
    "": {"planks": 0.4, "herringbone": 0.14, "carpet": 0.14, "loop_pile": 0.1, "figured_carpet": 0.07,
         "tiles": 0.1, "slate": 0.05},
    "bathroom": {"tiles": 0.35, "checker": 0.2, "slate": 0.15, "terrazzo": 0.15, "marble": 0.15},
    "kitchen": {"tiles": 0.3, "checker": 0.15, "slate": 0.1, "terrazzo": 0.1, "planks": 0.35},
    "office": {"loop_pile": 0.35, "carpet": 0.2, "figured_carpet": 0.1, "planks": 0.25, "concrete": 0.1},
    "corridor": {"planks": 0.35, "herringbone": 0.15, "tiles": 0.2, "terrazzo": 0.1, "loop_pile": 0.2},
}  # fmt: skip
"""Kind of room ("" = any other) to the kinds of its floor and how often they come."""
