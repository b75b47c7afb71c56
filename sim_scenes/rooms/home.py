"""Living rooms and bedrooms: what stands in them and by which rules.

Every function furnishes the room of a `Furnisher` and returns the point to look at first.
"""

import numpy as np

from dsmap.sim_scenes.pieces import (  # fmt: skip
    beds,
    decor,
    hallway,
    lamps,
    plants,
    seats,
    shelves,
    sofas,
    storage,
    tables,
    wall_art,
)
from dsmap.sim_scenes.rooms.furnisher import CHAIRS, Furnisher
from dsmap.sim_scenes.rooms.layout import Wall
from dsmap.sim_scenes.scene import Assembly


def living_room(f: Furnisher) -> np.ndarray:
    """The sofa faces the television across a low table on a rug; easy chairs; shelves; a dining corner; plants."""
    rng, layout = f.rng, f.layout
    main = f.best_wall()
    wall, opposite = layout.walls[main], layout.walls[(main + 2) % 4]
    x = _media(f, wall)
    couch = f.make(sofas.corner_sofa) if f.odds(0.25) else f.make(sofas.sofa, int(rng.integers(2, 4)))
    depth, deep = float(np.ptp(couch.bounds()[:, 1])), float(layout.size[1 - main % 2])
    wish = rng.uniform(2.5, 3.1) + depth / 2
    turn = wall.yaw + np.pi + rng.uniform(-0.05, 0.05)
    distances = [d for d in wish - np.array([0, -0.3, 0.2, 0.4]) if d < deep - depth / 2 - 0.75]
    across = next((d for d in distances if layout.stand(couch, wall.point(x, d), turn)), None)
    if across is None:
        at = layout.against(couch, opposite, -x)
        x = x if at is not None else -(layout.against(couch, opposite) or 0.0)
        across = deep - depth / 2 - 0.03
    middle = wall.point(x + rng.uniform(-0.1, 0.1), across - depth / 2 - rng.uniform(0.65, 0.8))
    f.rug(middle, wall.yaw, rng.uniform(1.8, 2.6), rng.uniform(1.3, 1.8))
    layout.stand(f.one_of(tables.coffee_table, tables.low_table), middle, wall.yaw + rng.uniform(-0.08, 0.08))
    for side in rng.permutation([-1, 1])[: int(rng.integers(1, 3))]:
        _easy_chair(f, wall, middle, int(side))
    others = f.walls(without=[main])
    if f.odds(0.8):
        f.dining(int(rng.integers(3, 7)))
    cases = (storage.bookshelf, storage.toy_chest, storage.sideboard, storage.dresser, shelves.open_rack)
    f.fill(others, [f.one_of(*cases) for _ in range(int(rng.integers(2, 5)))])
    f.fill(others, [f.one_of(tables.side_table, tables.console_table, seats.dining_chair)])
    f.fill(others, [f.make(lamps.floor_lamp)])
    f.fill(others, [f.make(plants.plant) for _ in range(int(rng.integers(2, 5)))])
    if f.odds(0.4):
        f.fill(others, [f.one_of(tables.side_table, seats.pouf, storage.toy_chest)])
    return np.array([*middle, 0.5])


def _media(f: Furnisher, wall: Wall) -> float:
    """A low cabinet with a television (on it or above it), or without one; returns where along the wall."""
    case = f.one_of(storage.tv_cabinet, storage.tv_cabinet, storage.sideboard)
    hung = f.odds(0.35)
    if not hung and f.odds(0.75):
        decor.stand_television(f.rng, f.looks, case)
    x = f.layout.against(case, wall, f.rng.uniform(-0.25, 0.25) * (wall.length - 2.2))
    if x is None:
        x = f.layout.against(case, wall)
    if x is None:
        return 0.0
    if hung and f.odds(0.6):
        f.layout.hang(f.make(wall_art.wall_television), wall, x, f.rng.uniform(1.0, 1.15))
    return x


def _easy_chair(f: Furnisher, wall: Wall, middle: np.ndarray, side: int) -> None:
    """An easy chair beside the low table that looks at it."""
    piece = f.one_of(sofas.armchair, seats.windsor_chair, seats.upholstered_chair, seats.beanbag)
    for out in (1.35, 1.5, 1.7, 1.9):
        at = middle + side * out * wall.along + f.rng.uniform(-0.3, 0.3) * wall.normal
        look = middle - at
        yaw = float(np.arctan2(look[1], look[0]) + np.pi / 2 + f.rng.uniform(-0.3, 0.3))
        if f.layout.stand(piece, at, yaw):
            return


def bedroom(f: Furnisher) -> np.ndarray:
    """A bed with its head against a wall between nightstands; wardrobe; desk or dresser; sometimes a child's room."""
    rng, layout = f.rng, f.layout
    main = f.best_wall()
    wall = layout.walls[main]
    child = f.odds(0.18)
    bed = f.one_of(beds.bunk_bed, beds.bed, beds.bed) if child else f.make(beds.bed)
    width = float(np.ptp(bed.bounds()[:, 0]))
    x = layout.against(bed, wall, rng.uniform(-0.5, 0.5) * max(0.0, wall.length - width - 1.2))
    if x is None:
        found = f.fill([wall, *f.walls()], [bed])
        x = 0.0 if found[0] is None else found[0]
    for side in (-1, 1):
        stand = f.make(storage.nightstand)
        if f.odds(0.75):
            f.put_on(stand, f.make(lamps.table_lamp), stand.surfaces[-1], (0.3, 0.7), (0.6, 1.0), 0.0)
        layout.against(stand, wall, x + side * (width / 2 + float(stand.size()[0]) / 2 + 0.07))
    others = f.walls(without=[main])
    f.fill(others, [f.make(storage.wardrobe)], front=0.45)
    if f.odds(0.85):
        f.desk(others, (seats.office_chair, seats.dining_chair))
    if child:
        f.fill(others, [f.one_of(storage.toy_chest, beds.crib), f.make(storage.toy_chest)])
    _chest(f, others)
    f.fill(others, [f.one_of(*CHAIRS)])
    f.fill(
        others,
        [f.one_of(storage.bookshelf, shelves.cube_shelf, shelves.ladder_shelf, hallway.hall_bench)],
    )
    if f.odds(0.6):
        f.fill(
            others,
            [
                f.one_of(
                    sofas.armchair, sofas.day_bed, seats.upholstered_chair, seats.dining_chair, seats.beanbag
                )
            ],
        )
    f.rug(wall.point(x, 1.9), wall.yaw, rng.uniform(1.9, 2.5), rng.uniform(1.3, 1.7))
    f.fill(
        others,
        [
            f.one_of(plants.plant, decor.hamper),
            f.one_of(decor.hamper, lamps.floor_lamp, hallway.coat_stand),
        ],
    )
    return np.array([*wall.point(x, 1.2), 0.6])


def _chest(f: Furnisher, walls: list[Wall]) -> None:
    """A chest of drawers, with a television, a mirror above or a lamp on it."""
    chest: Assembly = f.one_of(storage.dresser, storage.dresser, storage.sideboard)
    choice = f.rng.random()
    if choice < 0.3:
        decor.stand_television(f.rng, f.looks, chest)
    elif choice < 0.6:
        f.put_on(chest, f.make(lamps.table_lamp), chest.surfaces[-1], (0.0, 1.0), (0.4, 0.9), 0.0)
    for wall in walls:
        x = f.layout.against(chest, wall, front=0.4)
        if x is not None:
            if choice > 0.5:
                f.layout.hang(f.make(hallway.wall_mirror), wall, x, float(chest.bounds()[1, 2]) + 0.2)
            return
