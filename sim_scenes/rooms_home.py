"""Living rooms and bedrooms: what stands in them and by which rules.

Every function furnishes the room of a `Furnisher` and returns the point to look at first.
"""

import numpy as np

from dsmap.sim_scenes import decor, furniture, storage
from dsmap.sim_scenes.furnish import Furnisher


def living_room(f: Furnisher) -> np.ndarray:
    """The sofa faces the television across a coffee table on a rug; a dining corner; shelves; a plant."""
    rng, layout = f.rng, f.layout
    main = f.longest_free_wall()
    wall = layout.walls[main]
    case = f.make(storage.tv_cabinet)
    decor.stand_television(rng, f.looks, case)
    x = layout.against(case, wall, rng.uniform(-0.25, 0.25) * (wall.length - 2.2))
    x = layout.against(case, wall) or 0.0 if x is None else x
    couch = f.make(furniture.sofa, int(rng.integers(2, 4)))
    depth, deep = float(couch.size()[1]), float(layout.size[1 - main % 2])
    against_wall = deep - depth / 2 - 0.05
    distances = np.minimum(rng.uniform(2.6, 3.1) + depth / 2 - np.array([0, -0.3, 0.2, 0.4]), against_wall)
    turn = wall.yaw + np.pi + rng.uniform(-0.05, 0.05)
    across = next((d for d in distances if layout.stand(couch, wall.point(x, d), turn)), None)
    if across is None:
        layout.against(couch, layout.walls[(main + 2) % 4])
        across = against_wall
    at = wall.point(x + rng.uniform(-0.1, 0.1), across - depth / 2 - 0.75)
    layout.stand(f.make(furniture.coffee_table), at, wall.yaw + rng.uniform(-0.08, 0.08))
    f.rug(wall.point(x, across - depth / 2 - 0.6), wall.yaw, rng.uniform(1.9, 2.5), rng.uniform(1.3, 1.7))
    others = f.walls(without=[main])
    f.fill(others, [f.make(storage.bookshelf) for _ in range(2)])
    f.dining(int(rng.integers(3, 5)))
    f.fill(others, [f.make(furniture.sofa, 1), f.make(storage.dresser)])
    f.fill(others, [f.make(decor.lamp, rng.uniform(1.35, 1.6)), f.make(decor.plant, 1.1)])
    return np.array([*at, 0.5])


def bedroom(f: Furnisher) -> np.ndarray:
    """A bed with its head against a wall between nightstands; wardrobe; desk with chair and monitor."""
    rng, layout = f.rng, f.layout
    main = f.longest_free_wall()
    wall = layout.walls[main]
    bed = f.make(furniture.bed)
    width = float(bed.size()[0])
    x = layout.against(bed, wall, rng.uniform(-0.5, 0.5) * (wall.length - width - 1.2))
    if x is None:
        x = layout.against(bed, wall) or 0.0
    for side in (-1, 1):
        stand = f.make(storage.nightstand)
        if rng.random() < 0.75:
            lamp = decor.lamp(rng, f.looks, rng.uniform(0.42, 0.55))
            stand.attach(lamp, (0, 0.05, stand.surfaces[0][4]))
        layout.against(stand, wall, x + side * (width / 2 + float(stand.size()[0]) / 2 + 0.06))
    others = f.walls(without=[main])
    f.fill(others, [f.make(storage.wardrobe)])
    f.desk(others)
    chest = f.make(storage.dresser)
    if rng.random() < 0.5:
        decor.stand_television(rng, f.looks, chest)
    f.fill(others, [chest, f.make(storage.bookshelf)])
    f.fill(others, [f.make(furniture.sofa, 1)])
    f.rug(wall.point(x, 1.9), wall.yaw, rng.uniform(1.9, 2.5), rng.uniform(1.3, 1.7))
    f.fill(others, [f.make(decor.plant, rng.uniform(0.7, 1.1)), f.make(decor.hamper)])
    return np.array([*wall.point(x, 1.2), 0.6])
