"""The rooms: what stands in them and by which rules. `build_scene(name, seed)` is the way in."""

from collections.abc import Callable

import numpy as np

from dsmap.errors import InputError
from dsmap.sim_scenes import decor, furniture, lighting, shell, storage, textures_art
from dsmap.sim_scenes.layout import Layout, Wall
from dsmap.sim_scenes.looks import Looks
from dsmap.sim_scenes.scene import Assembly, Room, Scene
from dsmap.sim_scenes.shapes import Shape, box
from dsmap.sim_scenes.textures import Rng


def build_scene(name: str, seed: int) -> Scene:
    """A furnished room; everything in it follows from its name and seed.

    Raises:
        InputError: there is no room of that name.
    """
    if name not in ROOMS:
        raise InputError(f"unknown scene {name!r}; expected one of: {', '.join(ROOMS)}")
    rng = np.random.default_rng([seed, list(ROOMS).index(name)])
    looks = Looks(rng)
    size = np.array([rng.uniform(4.4, 5.8), rng.uniform(3.9, 5.0), rng.uniform(2.45, 2.75)])
    scene = Scene(name, seed, size, looks.materials)
    scene.rooms.append(Room(name, -size[:2] / 2, size[:2] / 2, float(size[2])))
    layout = Layout(scene, rng)
    main = int(rng.integers(4))
    window, door = ((main + rng.permutation([1, 2, 3])) % 4)[:2]
    shell.build(rng, looks, layout, int(door), int(window))
    scene.targets.insert(0, ROOMS[name](rng, looks, layout, main))
    _pictures(rng, looks, layout, 2 + int(rng.integers(3)))
    lighting.light(rng, looks, layout, layout.walls[int(window)])
    return scene


def _living_room(rng: Rng, looks: Looks, layout: Layout, main: int) -> np.ndarray:
    """The sofa faces the television across a coffee table on a rug; a dining corner; shelves; a plant."""
    wall = layout.walls[main]
    case = storage.tv_cabinet(rng, looks)
    decor.stand_television(rng, looks, case)
    decor.clutter(rng, looks, case, 2)
    x = layout.against(case, wall, rng.uniform(-0.25, 0.25) * (wall.length - 2.2))
    x = layout.against(case, wall) or 0.0 if x is None else x
    couch = furniture.sofa(rng, looks, int(rng.integers(2, 4)))
    depth, deep = float(couch.size()[1]), float(layout.scene.size[1 - main % 2])
    against_wall = deep - depth / 2 - 0.05
    distances = np.minimum(rng.uniform(2.6, 3.1) + depth / 2 - np.array([0, -0.3, 0.2, 0.4]), against_wall)
    across = next((d for d in distances if layout.stand(couch, wall.point(x, d), wall.yaw + np.pi)), None)
    if across is None:
        layout.against(couch, layout.walls[(main + 2) % 4])
        across = against_wall
    low_table = furniture.coffee_table(rng, looks)
    decor.clutter(rng, looks, low_table, 4)
    at = wall.point(x + rng.uniform(-0.1, 0.1), across - depth / 2 - 0.75)
    layout.stand(low_table, at, wall.yaw + rng.uniform(-0.08, 0.08))
    _rug(rng, looks, layout, wall, x, across - depth / 2 - 0.6)
    others = [layout.walls[(main + k) % 4] for k in rng.permutation([1, 2, 3])]
    _fill(rng, layout, others, [storage.bookshelf(rng, looks) for _ in range(2)], looks, 4)
    _dining(rng, looks, layout)
    _fill(rng, layout, others, [furniture.sofa(rng, looks, 1), storage.dresser(rng, looks)], looks, 3)
    _fill(rng, layout, others, [decor.lamp(rng, looks, rng.uniform(1.35, 1.6)), decor.plant(rng, looks, 1.1)])
    return np.array([*at, 0.5])


def _bedroom(rng: Rng, looks: Looks, layout: Layout, main: int) -> np.ndarray:
    """A bed with its head against a wall between nightstands; wardrobe; desk with chair and monitor."""
    wall = layout.walls[main]
    bed = furniture.bed(rng, looks)
    width = float(bed.size()[0])
    x = layout.against(bed, wall, rng.uniform(-0.5, 0.5) * (wall.length - width - 1.2))
    if x is None:
        x = layout.against(bed, wall) or 0.0
    for side in (-1, 1):
        stand = storage.nightstand(rng, looks)
        if rng.random() < 0.75:
            stand.attach(decor.lamp(rng, looks, rng.uniform(0.42, 0.55)), (0, 0.05, stand.surfaces[0][4]))
        decor.clutter(rng, looks, stand, 2)
        layout.against(stand, wall, x + side * (width / 2 + float(stand.size()[0]) / 2 + 0.06))
    others = [layout.walls[(main + k) % 4] for k in rng.permutation([1, 2, 3])]
    _fill(rng, layout, others, [storage.wardrobe(rng, looks)])
    _desk(rng, looks, layout, others)
    chest = storage.dresser(rng, looks)
    if rng.random() < 0.5:
        decor.stand_television(rng, looks, chest)
    _fill(rng, layout, others, [chest, storage.bookshelf(rng, looks)], looks, 3)
    _fill(rng, layout, others, [furniture.sofa(rng, looks, 1)])
    _rug(rng, looks, layout, wall, x, 1.9)
    _fill(rng, layout, others, [decor.plant(rng, looks, rng.uniform(0.7, 1.1)), decor.hamper(rng, looks)])
    _scatter(rng, layout, [decor.ball(rng, looks), decor.carton(rng, looks)])
    return np.array([*wall.point(x, 1.2), 0.6])


def _fill(
    rng: Rng,
    layout: Layout,
    walls: list[Wall],
    pieces: list[Assembly],
    looks: Looks | None = None,
    things: int = 0,
) -> None:
    """Stand pieces against whichever of the walls has room, each with up to `things` small things on it."""
    for piece in pieces:
        if looks is not None:
            decor.clutter(rng, looks, piece, things)
        for k in rng.permutation(len(walls)):
            if layout.against(piece, walls[k]) is not None:
                break


def _dining(rng: Rng, looks: Looks, layout: Layout) -> None:
    """A table with chairs pushed towards it, wherever the floor is free."""
    width = rng.uniform(0.95, 1.4)
    depth = width if width < 1.15 else rng.uniform(0.75, 0.85)
    half = layout.scene.size[:2] / 2
    board = furniture.table(rng, looks, width, depth, rng.uniform(0.72, 0.76))
    for attempt in range(60):
        room = 0.3 if attempt < 40 else 0.05
        yaw = rng.choice([0.0, np.pi / 2])
        xy = rng.uniform(-half + 0.5, half - 0.5)
        rect = layout.footprint(board, xy, yaw)
        if layout.fits(rect + np.array([[-room], [room]])):
            break
    else:
        return
    decor.clutter(rng, looks, board, 3)
    layout.stand(board, xy, yaw)
    table_rect = layout.taken.pop()
    seat = furniture.chair(rng, looks)
    for side in rng.permutation(4)[: int(rng.integers(3, 5))]:
        angle = yaw + side * np.pi / 2
        reach = (depth if side % 2 == 0 else width) / 2 + rng.uniform(0.08, 0.22)
        at = xy + reach * np.array([np.sin(angle), -np.cos(angle)])
        layout.stand(seat, at, angle + np.pi + rng.uniform(-0.15, 0.15))
    layout.taken.append(table_rect)


def _desk(rng: Rng, looks: Looks, layout: Layout, walls: list[Wall]) -> None:
    """A desk against a wall with a monitor, books and a chair before it."""
    width, depth = rng.uniform(1.1, 1.5), rng.uniform(0.58, 0.7)
    desk = furniture.table(rng, looks, width, depth, rng.uniform(0.72, 0.76))
    height = desk.surfaces[0][4]
    desk.attach(
        decor.television(rng, looks, rng.uniform(0.5, 0.62)),
        (rng.uniform(-0.15, 0.15), 0.12, height),
        rng.uniform(-0.15, 0.15),
    )
    row = storage.row_of_books(rng, looks, 0.3, 0.3)
    desk.attach(row, (rng.choice([-1, 1]) * (width / 2 - 0.22), depth / 2 - 0.14, height))
    decor.clutter(rng, looks, desk, 3)
    for k in rng.permutation(len(walls)):
        x = layout.against(desk, walls[k])
        if x is None:
            continue
        seat = furniture.office_chair(rng, looks) if rng.random() < 0.6 else furniture.chair(rng, looks)
        for out in (0.36, 0.42, 0.5, 0.6):
            at = walls[k].point(x + rng.uniform(-0.15, 0.15), depth + out)
            if layout.stand(seat, at, walls[k].yaw + np.pi + rng.uniform(-0.4, 0.4)):
                return
        return


def _rug(rng: Rng, looks: Looks, layout: Layout, wall: Wall, x: float, out: float) -> None:
    width, depth = rng.uniform(1.9, 2.5), rng.uniform(1.3, 1.7)
    plate = box((width, depth, 0.012))
    uv = np.stack([plate.vertices[:, 0] / width + 0.5, 0.5 - plate.vertices[:, 1] / depth], 1)
    rug = Assembly("floor")
    rug.add(
        Shape(plate.vertices, plate.faces, np.clip(uv, 0.003, 0.997)),
        looks.printed("rug", textures_art.rug(rng), 0.02),
    )
    layout.scene.place(rug, (*wall.point(x, out), 0.0), wall.yaw + rng.uniform(-0.04, 0.04))


def _scatter(rng: Rng, layout: Layout, pieces: list[Assembly]) -> None:
    """Leave things lying on the floor."""
    half = layout.scene.size[:2] / 2 - 0.2
    for piece in pieces:
        for _ in range(20):
            if layout.stand(piece, rng.uniform(-half, half), rng.uniform(-np.pi, np.pi)):
                break


def _pictures(rng: Rng, looks: Looks, layout: Layout, count: int) -> None:
    for k in range(count):
        wall = layout.walls[(k + int(rng.integers(2))) % 4]
        layout.hang(decor.picture(rng, looks), wall, None, rng.uniform(1.45, 1.7))


ROOMS: dict[str, Callable[[Rng, Looks, Layout, int], np.ndarray]] = {
    "living_room": _living_room,
    "bedroom": _bedroom,
}
"""Name of a room to the function that furnishes it and returns the point to look at first."""
MIX: dict[str, float] = {"living_room": 1.0, "bedroom": 1.0}
"""Shares of the kinds of rooms in a training set."""
