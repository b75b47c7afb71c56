"""Offices, kitchens, bathrooms, corridors; as `rooms_home`."""

import numpy as np

from dsmap.sim_scenes.pieces import (  # fmt: skip
    appliances,
    decor,
    hallway,
    lamps,
    plants,
    seats,
    shelves,
    soft_goods,
    storage,
    tables,
    wall_art,
)
from dsmap.sim_scenes.pieces import bathroom as bath_pieces
from dsmap.sim_scenes.pieces import kitchen as kitchen_pieces
from dsmap.sim_scenes.pieces import office as office_pieces
from dsmap.sim_scenes.rooms.furnisher import CHAIRS, Furnisher
from dsmap.sim_scenes.rooms.layout import Wall


def office(f: Furnisher) -> np.ndarray:
    """Work places against walls, shelves with folders and books, cabinets, a whiteboard, a bin, plants."""
    rng = f.rng
    f.desk(f.walls())
    first = f.layout.scene.targets[-1] if f.layout.scene.targets else np.array([*f.layout.centre, 0.8])
    cases = (
        shelves.folder_shelf,
        shelves.wide_bookcase,
        storage.bookshelf,
        shelves.open_rack,
        storage.sideboard,
    )
    f.fill(f.walls(), [f.one_of(*cases) for _ in range(int(rng.integers(1, 3)))])
    f.hang(f.one_of(office_pieces.whiteboard, office_pieces.pinboard), 0.95)
    for _ in range(int(rng.integers(1, 3))):
        f.desk(f.walls())
    f.fill(f.walls(), [f.make(storage.filing_cabinet) for _ in range(int(rng.integers(1, 4)))])
    f.fill(f.walls(), [f.one_of(*cases)])
    if f.odds(0.5):
        f.dining(int(rng.integers(2, 6)), 30)
    f.fill(f.walls(), [f.one_of(*CHAIRS) for _ in range(int(rng.integers(1, 4)))])
    if f.odds(0.4):
        f.fill(f.walls(), [f.one_of(hallway.radiator, office_pieces.water_cooler, hallway.coat_stand)])
    extras = (office_pieces.waste_bin, office_pieces.pc_tower, plants.plant, office_pieces.waste_bin)
    f.fill(f.walls(), [f.make(extra) for extra in extras])
    return first


def kitchen(f: Furnisher) -> np.ndarray:
    """Units with a worktop along one wall or two, cupboards above, refrigerator, a table with chairs where it fits."""
    rng, layout = f.rng, f.layout
    main = f.best_wall()
    wall = layout.walls[main]
    x = _run(f, wall, rng.uniform(2.2, 3.6), True)
    for k in rng.permutation([1, 3]):
        if f.odds(0.55):
            _run(f, layout.walls[(main + int(k)) % 4], rng.uniform(0.9, 1.8), False)
    f.fill(
        f.walls(), [f.one_of(appliances.tall_oven, shelves.open_rack, appliances.washing_machine)], front=0.4
    )
    if min(layout.size[:2]) > 3.5 and f.odds(0.3):
        island = f.make(kitchen_pieces.island)
        at = wall.point(x, 0.65 + 1.05 + float(island.size()[1]) / 2)
        block = layout.stand(island, at, wall.yaw)
        if block is not None:
            edge = float(island.bounds()[1, 1])
            stool = f.make(seats.bar_stool)
            for shift in (-0.45, 0.25):
                seat = wall.point(
                    x + shift, float((at - wall.centre) @ wall.normal) + edge + rng.uniform(0.1, 0.3)
                )
                layout.stand(stool, seat, wall.yaw + rng.uniform(-0.4, 0.4), under=[block])
    f.dining(int(rng.integers(2, 7)))
    f.fill(f.walls(), [f.one_of(storage.sideboard, shelves.open_rack, shelves.cube_shelf, hallway.radiator)])
    f.fill(f.walls(), [f.one_of(office_pieces.waste_bin, plants.plant)])
    if f.odds(0.5):
        f.hang(f.make(kitchen_pieces.kitchen_shelf), 1.35)
    return np.array([*wall.point(x, 0.6), 0.95])


def _run(f: Furnisher, wall: Wall, length: float, main: bool) -> float:
    """Units in the widest free stretch of a wall, a refrigerator beside them; returns the middle of the run."""
    rng, layout = f.rng, f.layout
    fridge = f.make(appliances.fridge)
    wide = float(np.ptp(fridge.bounds()[:, 0]))
    stretches = layout.stretches(wall, 0.95)
    if not stretches or stretches[0][1] - stretches[0][0] < 0.7:
        return 0.0
    low, high = stretches[0]
    cold = main and high - low > wide + 1.3
    length = min(length, high - low - (wide + 0.08 if cold else 0.0) - 0.1)
    side = rng.choice([-1, 1])
    start = low + 0.02 if side < 0 else high - 0.02
    if cold:
        layout.against(fridge, wall, start - side * wide / 2, front=0.45)
        start -= side * (wide + 0.04)
    units = f.make(kitchen_pieces.base_units, length, main, main)
    top = units.surfaces[0][4]
    reach = float(np.ptp(units.bounds()[:, 0]))
    x = start - side * reach / 2
    for thing in rng.permutation(4)[: int(rng.integers(1, 4))]:
        kinds = (appliances.microwave, appliances.kettle, appliances.toaster, appliances.coffee_machine)
        surface = units.surfaces[int(rng.integers(len(units.surfaces)))]
        f.put_on(units, f.make(kinds[int(thing)]), surface, (0.0, 1.0), (0.4, 0.8))
    if layout.against(units, wall, x, front=0.5, top=top) is None:
        return x
    cupboards = f.make(kitchen_pieces.wall_cupboards, length)
    if layout.hang(cupboards, wall, x, rng.uniform(1.38, 1.48)) is None:
        for half in (-1, 1):
            shorter = f.make(kitchen_pieces.wall_cupboards, max(0.5, length / 2 - 0.5))
            at = x + half * (reach - float(np.ptp(shorter.bounds()[:, 0]))) / 2
            layout.hang(shorter, wall, at, 1.42)
    return x


def bathroom(f: Furnisher) -> np.ndarray:
    """Tub or shower in a corner, toilet, basin under a mirror, towels, a mat, a basket."""
    rng, layout = f.rng, f.layout
    bathing = f.one_of(bath_pieces.bath_tub, bath_pieces.bath_tub, bath_pieces.shower)
    for wall in f.walls():
        half = wall.length / 2 - float(np.ptp(bathing.bounds()[:, 0])) / 2 - 0.032
        if any(
            layout.against(bathing, wall, x, front=0.5) is not None for x in rng.permutation([-half, half])
        ):
            at = wall.point(float(rng.uniform(-0.1, 0.1)), float(np.ptp(bathing.bounds()[:, 1])) + 0.4)
            mat, turn = f.make(soft_goods.bath_mat), wall.yaw + rng.uniform(-0.2, 0.2)
            block = layout.block(mat, at, turn)
            if layout.fits(block, 0.0, [b for b in layout.taken if b.piece < 0]):
                layout.scene.place(mat, (*at, 0.0), turn, room=layout.index)
                layout.taken.append(block)
            break
    basin = f.one_of(bath_pieces.vanity, bath_pieces.vanity, bath_pieces.washbasin)
    target = np.array([*layout.centre, 0.8])
    for wall in f.walls():
        x = layout.against(basin, wall, front=0.5)
        if x is not None:
            layout.hang(
                f.one_of(bath_pieces.mirror_cabinet, hallway.wall_mirror),
                wall,
                x,
                rng.uniform(1.15, 1.25),
            )
            target = np.array([*wall.point(x, 0.3), 0.9])
            break
    toilet = f.make(bath_pieces.toilet)
    for wall in f.walls():
        x = layout.against(toilet, wall, front=0.45)
        if x is not None:
            f.layout.hang(f.make(bath_pieces.toilet_roll), wall, x + rng.choice([-0.42, 0.42]), 0.7)
            break
    f.hang(f.make(bath_pieces.towel_rail), 0.8)
    extras = (
        decor.hamper,
        office_pieces.waste_bin,
        shelves.open_rack,
        storage.nightstand,
        appliances.washing_machine,
    )
    f.fill(f.walls(), [f.one_of(*extras) for _ in range(int(rng.integers(1, 4)))])
    if f.odds(0.4):
        f.hang(f.make(shelves.wall_shelf), 1.3)
    return target


def corridor(f: Furnisher) -> np.ndarray:
    """Shallow things along the walls: console, bench, shoe rack, coats, mirror, umbrella stand."""
    rng = f.rng
    walls = f.walls()
    f.hang(f.make(hallway.coat_rack), rng.uniform(1.55, 1.7))
    shallow = (
        tables.console_table,
        hallway.hall_bench,
        hallway.shoe_rack,
        storage.bookshelf,
        hallway.radiator,
    )
    f.fill(walls, [f.one_of(*shallow) for _ in range(int(rng.integers(2, 5)))])
    f.hang(f.one_of(hallway.wall_mirror, wall_art.gallery), rng.uniform(1.1, 1.3))
    ends = (
        hallway.umbrella_stand,
        hallway.coat_stand,
        plants.plant,
        lamps.floor_lamp,
        seats.chair,
    )
    f.fill(walls, [f.one_of(*ends) for _ in range(int(rng.integers(1, 3)))])
    return np.array([*f.layout.centre, 1.0])
