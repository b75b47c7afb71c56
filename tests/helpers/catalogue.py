"""All pieces by name: how to make one, where it belongs, how big it gets, which classes it shows.

Rooms may draw from it, tests and contact sheets go through it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dsmap.sim_scenes.pieces import (  # fmt: skip
    appliances,
    bathroom,
    beds,
    books,
    clutter,
    decor,
    dishes,
    hallway,
    kitchen,
    lamps,
    office,
    plants,
    seats,
    shelves,
    small_things,
    sofas,
    soft_goods,
    storage,
    tables,
    wall_art,
)
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures.palette import Looks

Size = tuple[float, float, float]


@dataclass(frozen=True)
class Entry:
    """One kind of piece."""

    make: Callable[[np.random.Generator, Looks], Assembly]
    place: str
    """wall: on the floor, back (largest y) to a wall; corner: also with its right side (+x); centre: on the floor
    with room around it; floor: left on the floor; top: on a surface; edge: at the front edge of a high surface;
    hang: on a wall; ceiling: under the ceiling, which is z = 0; rug: lies under everything."""
    low: Size
    """Least width, depth, height [m]."""
    high: Size
    """Largest width, depth, height [m]."""
    label: str
    """Its own class."""
    also: tuple[str, ...] = ()
    """Classes of what it may carry."""
    hung: float = 0.0
    """Usual height of its lowest point above the floor [m], for place hang."""


_THINGS = ("objects",)
_ALL = (
    Entry(seats.dining_chair, "centre", (0.37, 0.37, 0.72), (0.6, 0.57, 1.07), "chair"),
    Entry(seats.upholstered_chair, "centre", (0.41, 0.43, 0.76), (0.58, 0.57, 1.07), "chair"),
    Entry(seats.shell_chair, "centre", (0.41, 0.46, 0.7), (0.55, 0.55, 0.92), "chair"),
    Entry(seats.windsor_chair, "centre", (0.41, 0.43, 0.8), (0.55, 0.54, 1.09), "chair"),
    Entry(seats.folding_chair, "centre", (0.39, 0.44, 0.72), (0.51, 0.52, 0.93), "chair"),
    Entry(seats.bar_stool, "centre", (0.37, 0.37, 0.85), (0.46, 0.47, 1.22), "chair"),
    Entry(seats.beanbag, "centre", (0.7, 0.7, 0.66), (1.02, 1.02, 0.78), "chair"),
    Entry(seats.pouf, "centre", (0.37, 0.37, 0.33), (0.64, 0.64, 0.47), "furniture"),
    Entry(seats.chair, "centre", (0.37, 0.37, 0.76), (0.5, 0.5, 1.07), "chair"),
    Entry(seats.office_chair, "centre", (0.55, 0.54, 0.89), (0.69, 0.66, 1.5), "chair"),
    Entry(tables.coffee_table, "centre", (0.69, 0.46, 0.35), (1.25, 1.02, 0.5), "table"),
    Entry(sofas.sofa, "wall", (1.86, 0.76, 0.76), (2.58, 1.02, 1.02), "sofa", _THINGS),
    Entry(sofas.corner_sofa, "wall", (2.2, 1.34, 0.74), (3.75, 1.85, 0.99), "sofa", _THINGS),
    Entry(sofas.armchair, "wall", (0.66, 0.66, 0.68), (0.94, 0.88, 1.12), "sofa", _THINGS),
    Entry(sofas.day_bed, "wall", (1.39, 0.6, 0.7), (1.91, 0.81, 0.82), "sofa", _THINGS),
    Entry(beds.bed, "wall", (0.87, 1.83, 0.57), (2.16, 2.44, 1.32), "bed", _THINGS),
    Entry(beds.bunk_bed, "wall", (0.99, 1.98, 1.48), (1.25, 2.3, 1.87), "bed", _THINGS),
    Entry(beds.crib, "wall", (0.65, 1.16, 0.76), (0.76, 1.51, 1.02), "bed", _THINGS),
    Entry(tables.dining_table, "centre", (1.12, 0.72, 0.66), (1.55, 1.04, 0.82), "table"),
    Entry(tables.round_table, "centre", (0.68, 0.68, 0.66), (1.32, 1.32, 0.82), "table"),
    Entry(tables.low_table, "centre", (0.56, 0.47, 0.31), (1.32, 0.88, 0.5), "table"),
    Entry(tables.side_table, "centre", (0.33, 0.33, 0.41), (0.54, 0.54, 0.64), "table"),
    Entry(tables.console_table, "wall", (0.75, 0.25, 0.7), (1.33, 0.41, 0.94), "table"),
    Entry(tables.desk, "wall", (1.04, 0.54, 0.65), (1.81, 0.83, 0.81), "table", ("furniture",)),
    Entry(tables.standing_desk, "wall", (1.13, 0.6, 0.64), (1.81, 0.85, 1.17), "table"),
    Entry(tables.corner_desk, "wall", (1.31, 1.11, 0.67), (1.92, 1.59, 0.79), "table"),
    Entry(storage.bookshelf, "wall", (0.71, 0.24, 0.99), (1.28, 0.36, 2.07), "furniture", ("books",)),
    Entry(storage.tv_cabinet, "wall", (1.24, 0.4, 0.38), (2.04, 0.55, 0.6), "furniture"),
    Entry(storage.dresser, "wall", (0.72, 0.43, 0.7), (1.28, 0.6, 1.02), "furniture"),
    Entry(storage.wardrobe, "wall", (0.85, 0.56, 1.71), (2.21, 0.72, 2.34), "furniture", _THINGS),
    Entry(storage.nightstand, "wall", (0.39, 0.38, 0.42), (0.58, 0.53, 0.62), "furniture"),
    Entry(storage.sideboard, "wall", (1.14, 0.39, 0.67), (1.92, 0.55, 0.97), "furniture"),
    Entry(storage.filing_cabinet, "wall", (0.35, 0.48, 0.59), (0.51, 0.7, 1.47), "furniture"),
    Entry(storage.toy_chest, "wall", (0.57, 0.36, 0.46), (1.17, 0.44, 0.8), "furniture", _THINGS),
    Entry(shelves.wide_bookcase, "wall", (1.05, 0.24, 1.55), (3.05, 0.35, 2.42), "furniture", ("books",)),
    Entry(shelves.cube_shelf, "wall", (0.7, 0.35, 0.7), (1.59, 0.43, 1.98), "furniture", ("books", "objects",)),
    Entry(shelves.ladder_shelf, "wall", (0.51, 0.41, 1.49), (0.86, 0.49, 1.97), "furniture", ("books",)),
    Entry(
        shelves.open_rack, "wall", (0.69, 0.31, 1.39), (1.06, 0.48, 2.03), "furniture", ("books", "objects", "picture")
    ),
    Entry(shelves.folder_shelf, "wall", (0.75, 0.33, 1.05), (1.18, 0.39, 2.02), "furniture", ("books",)),
    Entry(shelves.wall_shelf, "hang", (0.57, 0.18, 0.13), (1.27, 0.28, 1.3), "furniture", ("books",), hung=1.2),
    Entry(kitchen.base_units, "wall", (2.22, 0.57, 1.11), (2.62, 0.67, 1.3), "furniture", _THINGS),
    Entry(kitchen.island, "centre", (1.24, 0.77, 0.83), (1.94, 0.93, 1.02), "furniture", _THINGS),
    Entry(kitchen.wall_cupboards, "hang", (1.67, 0.3, 0.55), (1.93, 0.43, 0.85), "furniture", _THINGS, hung=1.4),
    Entry(kitchen.kitchen_shelf, "hang", (0.66, 0.22, 0.22), (1.38, 0.33, 1.11), "furniture", _THINGS, hung=1.3),
    Entry(appliances.fridge, "wall", (0.5, 0.6, 1.39), (0.95, 0.82, 2.02), "furniture", _THINGS),
    Entry(appliances.tall_oven, "wall", (0.55, 0.57, 1.86), (0.65, 0.67, 2.36), "furniture", _THINGS),
    Entry(appliances.washing_machine, "wall", (0.55, 0.52, 0.78), (0.64, 0.69, 0.92), "objects"),
    Entry(appliances.microwave, "top", (0.4, 0.32, 0.23), (0.56, 0.47, 0.34), "objects"),
    Entry(appliances.kettle, "top", (0.22, 0.15, 0.2), (0.27, 0.19, 0.3), "objects"),
    Entry(appliances.toaster, "top", (0.25, 0.14, 0.16), (0.37, 0.21, 0.23), "objects"),
    Entry(appliances.coffee_machine, "top", (0.17, 0.24, 0.33), (0.21, 0.3, 0.39), "objects"),
    Entry(bathroom.bath_tub, "wall", (1.4, 0.64, 0.61), (1.93, 0.9, 2.16), "objects"),
    Entry(bathroom.toilet, "wall", (0.33, 0.53, 0.61), (0.47, 0.74, 1.2), "objects"),
    Entry(bathroom.vanity, "wall", (0.58, 0.44, 0.64), (1.54, 0.61, 1.07), "furniture", _THINGS),
    Entry(bathroom.washbasin, "wall", (0.42, 0.35, 0.45), (0.7, 0.51, 1.07), "objects"),
    Entry(bathroom.shower, "corner", (0.76, 0.74, 1.96), (1.09, 1.1, 2.27), "objects"),
    Entry(bathroom.mirror_cabinet, "hang", (0.48, 0.02, 0.55), (1.17, 0.18, 0.93), "objects", hung=1.15),
    Entry(bathroom.towel_rail, "hang", (0.4, 0.06, 0.37), (0.72, 0.09, 1.32), "objects", hung=0.5),
    Entry(bathroom.toilet_roll, "hang", (0.11, 0.11, 0.09), (0.14, 0.14, 0.13), "objects", hung=0.7),
    Entry(soft_goods.bath_mat, "rug", (0.56, 0.37, 0.0), (0.91, 0.59, 0.02), "floor"),
    Entry(decor.hamper, "floor", (0.33, 0.33, 0.49), (0.52, 0.52, 0.69), "objects"),
    Entry(office.monitor, "top", (0.45, 0.16, 0.29), (0.73, 0.24, 0.59), "objects"),
    Entry(office.dual_monitors, "top", (0.93, 0.19, 0.33), (1.28, 0.26, 0.54), "objects"),
    Entry(office.laptop, "top", (0.27, 0.24, 0.17), (0.41, 0.38, 0.28), "objects"),
    Entry(office.keyboard, "top", (0.43, 0.13, 0.03), (0.6, 0.18, 0.05), "objects"),
    Entry(office.printer, "top", (0.35, 0.43, 0.2), (0.52, 0.62, 0.37), "objects"),
    Entry(office.telephone, "top", (0.16, 0.18, 0.09), (0.2, 0.22, 0.12), "objects"),
    Entry(office.paper_tray, "top", (0.22, 0.3, 0.06), (0.28, 0.36, 0.22), "objects"),
    Entry(office.paper_stack, "top", (0.19, 0.27, 0.0), (0.32, 0.39, 0.07), "objects"),
    Entry(office.pc_tower, "floor", (0.15, 0.36, 0.33), (0.24, 0.51, 0.5), "objects"),
    Entry(office.waste_bin, "floor", (0.21, 0.21, 0.23), (0.38, 0.44, 0.57), "objects"),
    Entry(office.water_cooler, "wall", (0.29, 0.3, 1.23), (0.35, 0.36, 1.43), "objects"),
    Entry(office.whiteboard, "hang", (0.96, 0.08, 0.76), (2.12, 0.11, 1.18), "objects", hung=0.9),
    Entry(office.pinboard, "hang", (0.66, 0.02, 0.46), (1.28, 0.05, 0.9), "objects", hung=1.1),
    Entry(hallway.coat_stand, "floor", (0.46, 0.46, 1.57), (0.74, 0.75, 2.03), "objects"),
    Entry(hallway.umbrella_stand, "floor", (0.19, 0.18, 0.78), (0.37, 0.31, 1.06), "objects"),
    Entry(hallway.shoe_rack, "wall", (0.56, 0.29, 0.48), (1.07, 0.36, 0.78), "furniture", _THINGS),
    Entry(hallway.hall_bench, "wall", (0.75, 0.29, 0.39), (1.38, 0.43, 0.59), "furniture"),
    Entry(hallway.radiator, "wall", (0.63, 0.07, 0.57), (1.53, 0.11, 0.77), "objects"),
    Entry(hallway.coat_rack, "hang", (0.57, 0.14, 0.42), (1.6, 0.3, 1.25), "furniture", _THINGS, hung=0.5),
    Entry(hallway.wall_mirror, "hang", (0.37, 0.02, 0.45), (0.92, 0.04, 1.65), "objects", hung=0.8),
    Entry(soft_goods.throw_cushion, "top", (0.33, 0.33, 0.1), (0.54, 0.54, 0.19), "objects"),
    Entry(soft_goods.pillow, "top", (0.51, 0.35, 0.1), (0.75, 0.49, 0.19), "objects"),
    Entry(soft_goods.garment_heap, "top", (0.29, 0.24, 0.07), (0.55, 0.44, 0.21), "objects"),
    Entry(soft_goods.folded_clothes, "top", (0.22, 0.19, 0.02), (0.39, 0.35, 0.24), "objects"),
    Entry(soft_goods.towel_stack, "top", (0.29, 0.22, 0.07), (0.35, 0.27, 0.24), "objects"),
    Entry(soft_goods.backpack, "floor", (0.25, 0.24, 0.39), (0.37, 0.34, 0.57), "objects"),
    Entry(soft_goods.handbag, "floor", (0.25, 0.09, 0.3), (0.43, 0.19, 0.48), "objects"),
    Entry(soft_goods.shoes, "floor", (0.19, 0.22, 0.08), (0.27, 0.34, 0.33), "objects"),
    Entry(dishes.plate, "top", (0.16, 0.16, 0.02), (0.3, 0.3, 0.05), "objects"),
    Entry(dishes.plate_stack, "top", (0.18, 0.18, 0.04), (0.31, 0.31, 0.12), "objects"),
    Entry(dishes.bowl_stack, "top", (0.12, 0.12, 0.04), (0.24, 0.24, 0.15), "objects"),
    Entry(dishes.glass, "top", (0.05, 0.05, 0.08), (0.09, 0.09, 0.23), "objects"),
    Entry(dishes.bottle, "top", (0.05, 0.05, 0.18), (0.1, 0.1, 0.36), "objects"),
    Entry(dishes.jar, "top", (0.06, 0.06, 0.07), (0.16, 0.16, 0.22), "objects"),
    Entry(dishes.can, "top", (0.05, 0.05, 0.09), (0.11, 0.11, 0.16), "objects"),
    Entry(dishes.pot, "top", (0.23, 0.16, 0.09), (0.4, 0.32, 0.27), "objects"),
    Entry(dishes.pan, "top", (0.3, 0.18, 0.06), (0.53, 0.33, 0.09), "objects"),
    Entry(dishes.fruit, "top", (0.05, 0.05, 0.04), (0.1, 0.1, 0.1), "objects"),
    Entry(dishes.cutting_board, "top", (0.26, 0.16, 0.01), (0.45, 0.28, 0.13), "objects"),
    Entry(small_things.basket, "top", (0.2, 0.16, 0.11), (0.4, 0.3, 0.24), "objects"),
    Entry(small_things.toy_blocks, "top", (0.04, 0.04, 0.08), (0.09, 0.09, 0.3), "objects"),
    Entry(small_things.toy_car, "top", (0.11, 0.07, 0.05), (0.3, 0.17, 0.15), "objects"),
    Entry(small_things.teddy, "top", (0.13, 0.13, 0.19), (0.29, 0.29, 0.41), "objects"),
    Entry(small_things.remote, "top", (0.04, 0.12, 0.01), (0.06, 0.22, 0.03), "objects"),
    Entry(small_things.pens, "top", (0.07, 0.07, 0.13), (0.09, 0.09, 0.19), "objects"),
    Entry(small_things.clock, "top", (0.09, 0.05, 0.1), (0.2, 0.07, 0.21), "objects"),
    Entry(small_things.photo_frame, "top", (0.12, 0.05, 0.14), (0.41, 0.13, 0.31), "picture"),
    Entry(small_things.globe, "top", (0.18, 0.18, 0.26), (0.33, 0.33, 0.42), "objects"),
    Entry(small_things.speaker, "top", (0.12, 0.11, 0.2), (0.22, 0.21, 0.38), "objects"),
    Entry(small_things.tissue_box, "top", (0.21, 0.1, 0.12), (0.25, 0.14, 0.2), "objects"),
    Entry(small_things.soap_bottle, "top", (0.04, 0.03, 0.1), (0.09, 0.08, 0.25), "objects"),
    Entry(small_things.open_book, "top", (0.25, 0.19, 0.02), (0.4, 0.3, 0.04), "books"),
    Entry(small_things.parcel, "floor", (0.23, 0.18, 0.13), (0.54, 0.74, 0.4), "objects"),
    Entry(books.magazine_stack, "top", (0.19, 0.26, 0.0), (0.32, 0.38, 0.07), "books"),
    Entry(clutter.stack_of_books, "top", (0.21, 0.16, 0.03), (0.35, 0.28, 0.26), "books"),
    Entry(clutter.one_book, "top", (0.18, 0.13, 0.01), (0.34, 0.28, 0.06), "books"),
    Entry(decor.vase, "top", (0.08, 0.08, 0.14), (0.2, 0.2, 0.35), "objects"),
    Entry(decor.bowl, "top", (0.18, 0.18, 0.09), (0.33, 0.33, 0.12), "objects"),
    Entry(decor.mug, "top", (0.09, 0.07, 0.07), (0.12, 0.1, 0.12), "objects"),
    Entry(decor.carton, "top", (0.09, 0.09, 0.09), (0.28, 0.28, 0.28), "objects"),
    Entry(decor.candles, "top", (0.23, 0.11, 0.08), (0.29, 0.15, 0.19), "objects"),
    Entry(decor.ball, "floor", (0.11, 0.11, 0.11), (0.26, 0.26, 0.26), "objects"),
    Entry(plants.palm, "floor", (0.61, 0.58, 0.88), (1.52, 1.53, 1.92), "objects"),
    Entry(plants.rubber_plant, "floor", (0.29, 0.32, 0.54), (0.77, 0.82, 1.9), "objects"),
    Entry(plants.snake_plant, "floor", (0.18, 0.18, 0.38), (0.33, 0.33, 0.95), "objects"),
    Entry(lamps.floor_lamp, "floor", (0.31, 0.29, 1.31), (1.05, 0.52, 1.86), "objects"),
    Entry(lamps.table_lamp, "top", (0.17, 0.17, 0.22), (0.46, 0.46, 0.64), "objects"),
    Entry(lamps.desk_lamp, "top", (0.15, 0.32, 0.4), (0.27, 0.42, 0.47), "objects"),
    Entry(lamps.pendant, "ceiling", (0.2, 0.2, 0.33), (0.64, 0.67, 0.97), "objects"),
    Entry(lamps.ceiling_lamp, "ceiling", (0.29, 0.12, 0.02), (1.63, 0.65, 0.1), "objects"),
    Entry(wall_art.picture, "hang", (0.14, 0.02, 0.18), (1.61, 0.04, 1.28), "picture", hung=1.2),
    Entry(wall_art.gallery, "hang", (0.57, 0.02, 0.2), (2.2, 0.04, 1.4), "picture", hung=1.2),
    Entry(wall_art.poster, "hang", (0.36, 0.0, 0.49), (1.41, 0.01, 1.07), "picture", hung=1.2),
    Entry(wall_art.wall_television, "hang", (0.78, 0.06, 0.45), (1.56, 0.09, 0.9), "tv", hung=1.2),
    Entry(wall_art.wall_clock, "hang", (0.22, 0.03, 0.22), (0.43, 0.06, 0.43), "objects", hung=1.7),
)  # fmt: skip
PIECES: dict[str, Entry] = {entry.make.__name__: entry for entry in _ALL}
"""The name of the function that makes a piece, to its entry."""
