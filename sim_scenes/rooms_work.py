"""Offices, kitchens, bathrooms, corridors."""

import numpy as np

from dsmap.sim_scenes import decor, furniture, storage
from dsmap.sim_scenes.furnish import Furnisher


def office(f: Furnisher) -> np.ndarray:
    """Desks with monitors and swivel chairs, full shelves, a cabinet."""
    f.desk(f.walls(), 1.0)
    f.fill(f.walls(), [f.make(storage.bookshelf) for _ in range(3)])
    f.desk(f.walls(), 1.0)
    f.fill(f.walls(), [f.make(storage.dresser), f.make(decor.plant, 1.1)])
    return np.array([*f.layout.centre, 0.8])


def kitchen(f: Furnisher) -> np.ndarray:
    """A dining table and cabinets along the walls."""
    f.fill(f.walls(), [f.make(storage.dresser) for _ in range(3)])
    f.dining(4)
    f.fill(f.walls(), [f.make(storage.bookshelf)])
    return np.array([*f.layout.centre, 0.8])


def bathroom(f: Furnisher) -> np.ndarray:
    """Cabinets along the walls."""
    f.fill(f.walls(), [f.make(storage.nightstand), f.make(decor.hamper)])
    return np.array([*f.layout.centre, 0.8])


def corridor(f: Furnisher) -> np.ndarray:
    """A shelf and a plant along the walls."""
    f.fill(f.walls(), [f.make(storage.bookshelf), f.make(furniture.chair), f.make(decor.plant, 0.8)])
    return np.array([*f.layout.centre, 1.0])
