"""What the readers of foreign files give: meshes with materials, and what may say their classes."""

from collections.abc import Hashable
from dataclasses import dataclass

from dsmap.sim_scenes.geometry.shapes import Shape
from dsmap.sim_scenes.importers.class_map import ClassMap
from dsmap.sim_scenes.scene import Light, Material


@dataclass
class Chunk:
    """A piece of a foreign file: one mesh of one material that is one thing, or part of one."""

    shape: Shape
    """Vertices as in the file [m]; texture coordinates as `Material.tile` wants them."""
    material: Material
    keys: list[Hashable]
    """Names or ids that may say its class, best first."""
    thing: Hashable
    """Chunks with the same value are one instance."""


@dataclass
class Foreign:
    """What a reader found in a file."""

    chunks: list[Chunk]
    lights: list[Light]
    up: str
    """`y` or `z`: what points up by the format's rules."""
    lit: bool
    """Whether its colours hold the light already (a scan): it is then shown as it is."""
    class_map: ClassMap | None = None
    """What the file itself says about its classes."""
