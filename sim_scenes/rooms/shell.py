"""The bare room: floor, ceiling, walls with holes, what fills the holes, skirting, sockets."""

from collections.abc import Sequence

import numpy as np

from dsmap.sim_scenes.geometry.shapes import box, cylinder, rotation_x
from dsmap.sim_scenes.rooms import openings
from dsmap.sim_scenes.rooms.layout import Layout, Wall
from dsmap.sim_scenes.rooms.openings import WINDOW, Opening
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures.palette import WHITES, Looks


def close_room(
    rng: np.random.Generator, looks: Looks, layout: Layout, holes: Sequence[Sequence[Opening]]
) -> None:
    """Close a room whose walls have the holes `holes[wall]`; walls say how thick they are."""
    paper = looks.wall(layout.room.kind)
    accent = looks.wall() if layout.room.kind != "bathroom" and rng.random() < 0.5 else paper
    accented = int(rng.integers(4))
    south, east, north, west = (wall.thickness for wall in layout.walls)
    low, high = layout.room.low - [west, south], layout.room.high + [east, north]
    for kind, z in (("floor", -0.1), ("ceiling", layout.room.height)):
        slab = Assembly(kind)
        material = looks.floor(layout.room.kind) if kind == "floor" else looks.tiled("plaster", WHITES)
        slab.add(box((*(high - low), 0.1), (*((low + high) / 2), z)), material)
        layout.scene.place(slab, (0, 0, 0), room=layout.index)
    for k, wall in enumerate(layout.walls):
        ends = layout.walls[(k + 1) % 4].thickness, layout.walls[k - 1].thickness
        body = Assembly("wall")
        _body(body, wall, sorted(holes[k], key=lambda o: o.x0), ends, accent if k == accented else paper)
        _skirting(body, looks, wall, sorted(holes[k], key=lambda o: o.x0))
        layout.scene.place(body, (*wall.centre, 0), wall.yaw, room=layout.index)
        for opening in holes[k]:
            openings.fill_opening(rng, looks, layout, wall, opening)
        _sockets(rng, looks, layout, wall, holes[k])


def _body(
    body: Assembly, wall: Wall, holes: Sequence[Opening], ends: tuple[float, float], material: str
) -> None:
    """Boxes around the holes; the inner face at y = 0, uv continuous."""
    left, right = -wall.length / 2 - ends[0], wall.length / 2 + ends[1]

    def slab(x0: float, x1: float, z0: float, z1: float) -> None:
        if x1 - x0 > 1e-6 and z1 - z0 > 1e-6:
            body.add(
                box((x1 - x0, wall.thickness, z1 - z0), ((x0 + x1) / 2, wall.thickness / 2, z0)), material
            )

    for hole in holes:
        slab(left, hole.x0, 0, wall.height)
        slab(hole.x0, hole.x1, 0, hole.z0)
        slab(hole.x0, hole.x1, hole.z1, wall.height)
        left = hole.x1
    slab(left, right, 0, wall.height)


def _skirting(body: Assembly, looks: Looks, wall: Wall, holes: Sequence[Opening]) -> None:
    """Along the foot between doors, and along the ceiling."""
    left, reach = -wall.length / 2, wall.length / 2
    stretches = []
    for hole in holes:
        if hole.kind != WINDOW:
            stretches.append((left, hole.x0 - 0.08))
            left = hole.x1 + 0.08
    for x0, x1 in [*stretches, (left, reach)]:
        if x1 - x0 > 0.01:
            body.add(box((x1 - x0, 0.016, 0.09), ((x0 + x1) / 2, -0.008, 0)), looks.trim)
            body.add(box((x1 - x0, 0.008, 0.012), ((x0 + x1) / 2, -0.02, 0)), looks.trim)
    body.add(box((2 * reach, 0.04, 0.075), (0, -0.02, wall.height - 0.075)), looks.trim)


def _sockets(
    rng: np.random.Generator, looks: Looks, layout: Layout, wall: Wall, holes: Sequence[Opening]
) -> None:
    gaps = [(hole.x0 - 0.2, hole.x1 + 0.2) for hole in holes]
    for _ in range(int(rng.integers(1, 3))):
        x = rng.uniform(-wall.length / 2 + 0.2, wall.length / 2 - 0.2)
        if any(x0 < x < x1 for x0, x1 in gaps):
            continue
        gaps.append((x - 0.2, x + 0.2))
        socket = Assembly("objects", name="socket")
        socket.add(box((0.15, 0.012, 0.08), (0, -0.006, 0.26), 0.003), looks.white)
        for side in (-1, 1):
            hole = cylinder(0.022, 0.004, sides=16).turned(rotation_x(np.pi / 2))
            socket.add(hole.moved((side * 0.036, -0.012, 0.3)), looks.metal)
        layout.scene.place(socket, (*wall.point(x, 0), 0), wall.yaw, room=layout.index)
