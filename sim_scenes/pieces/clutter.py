"""Which small things stand where: `pick` draws one for a place, as an assembly of its own to be dropped there.

They are compact and stand stably as made (bottom at z = 0): their convex hull at about 400 kg/m^3 with
friction 0.7 is good enough to settle them.
"""

from collections.abc import Callable

import numpy as np

from dsmap.sim_scenes.pieces import books, decor, dishes, small_things, soft_goods
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures.palette import Looks

SmallThingMaker = Callable[[np.random.Generator, Looks], Assembly]


def stack_of_books(rng: np.random.Generator, looks: Looks) -> Assembly:
    """Two to six books lying on each other."""
    return books.pile_of_books(rng, looks, int(rng.integers(2, 7)))


def one_book(rng: np.random.Generator, looks: Looks) -> Assembly:
    """A single book lying with its cover up."""
    return books.pile_of_books(rng, looks, 1)


_READING: tuple[SmallThingMaker, ...] = (
    stack_of_books,
    stack_of_books,
    one_book,
    books.magazine_stack,
    small_things.open_book,
)
_DRINKS: tuple[SmallThingMaker, ...] = (decor.mug, dishes.glass, dishes.bottle)
PLACES: dict[str, tuple[SmallThingMaker, ...]] = {
    "desk": (
        *_READING, decor.mug, decor.carton, small_things.pens, small_things.photo_frame, small_things.tissue_box,
        dishes.bottle, dishes.jar,
    ),
    "table": (
        *_DRINKS, decor.bowl, dishes.plate, dishes.plate, dishes.fruit, one_book, books.magazine_stack, decor.vase,
        decor.candles,
    ),
    "living": (
        *_READING, decor.mug, dishes.glass, decor.bowl, small_things.remote, decor.candles, decor.vase,
        small_things.tissue_box,
    ),
    "shelf": (
        stack_of_books, stack_of_books, decor.vase, small_things.photo_frame, small_things.globe, small_things.basket,
        small_things.clock, decor.carton, small_things.speaker, dishes.jar, small_things.teddy, decor.candles,
    ),
    "kitchen": (
        *_DRINKS, dishes.pot, dishes.pan, dishes.bottle, dishes.jar, dishes.jar, dishes.cutting_board,
        dishes.plate_stack, dishes.bowl_stack, dishes.can, dishes.fruit, decor.bowl, dishes.plate,
    ),
    "bath": (
        small_things.soap_bottle, small_things.soap_bottle, small_things.soap_bottle, dishes.jar, dishes.glass,
        small_things.tissue_box, soft_goods.towel_stack,
    ),
    "bedside": (
        small_things.clock, one_book, stack_of_books, dishes.glass, decor.mug, small_things.photo_frame,
        small_things.remote, small_things.tissue_box,
    ),
    "bed": (soft_goods.throw_cushion, soft_goods.garment_heap, soft_goods.folded_clothes, one_book, small_things.teddy),
    "toys": (small_things.toy_blocks, small_things.toy_car, small_things.toy_car, small_things.teddy, decor.ball),
    "floor": (
        decor.ball, small_things.parcel, small_things.parcel, small_things.toy_car, small_things.basket,
        stack_of_books, small_things.teddy, soft_goods.backpack, soft_goods.handbag, soft_goods.shoes,
        soft_goods.garment_heap,
    ),
    "hall": (soft_goods.shoes, soft_goods.shoes, soft_goods.handbag, soft_goods.backpack, small_things.parcel),
}  # fmt: skip
"""What stands where: place to the functions `pick` draws from."""


def pick(rng: np.random.Generator, looks: Looks, place: str = "living") -> Assembly:
    """One random thing for a place (a key of `PLACES`)."""
    make = PLACES[place][int(rng.integers(len(PLACES[place])))]
    thing = make(rng, looks)
    thing.name = thing.name or make.__name__
    return thing
