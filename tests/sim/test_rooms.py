"""Generated rooms and flats: nothing overlaps, one can walk through, things lie still, every class is there."""

import numpy as np
import pytest

from dsmap.classes import CLASS_NAMES
from dsmap.sim_scenes.geometry.shapes import box, cylinder, merged, rotation_z
from dsmap.sim_scenes.physics.colliders import Collider, colliders_of, touch
from dsmap.sim_scenes.physics.settle import LooseThing, settle
from dsmap.sim_scenes.rooms.build import MIX, ROOM_KINDS, SCENES, build_scene
from dsmap.sim_scenes.rooms.check import blocked_ways, check_scene, interpenetrations, overlaps, strays
from dsmap.sim_scenes.rooms.flats import ROUND_TRIP_M, circle, draw_flat
from dsmap.sim_scenes.rooms.layout import Layout
from dsmap.sim_scenes.scene import Assembly, Room, Scene
from dsmap.sim_scenes.space.walkable import Walkable

FEW = [(kind, seed) for kind in ROOM_KINDS for seed in (0, 1)]


def cube(size: tuple[float, float, float] = (0.2, 0.2, 0.2), label: str = "objects") -> Assembly:
    """A box-shaped thing."""
    piece = Assembly(label)
    piece.add(box(size), "any")
    return piece


def bare_scene(*rooms: Room) -> Scene:
    """Rooms without walls."""
    return Scene("bare", 0, np.array([4.0, 4.0, 2.5]), {}, rooms=list(rooms) or [room()])


def room() -> Room:
    """A room of 4 x 4 m about the origin."""
    return Room("office", np.array([-2.0, -2.0]), np.array([2.0, 2.0]), 2.5)


def at(x: float, y: float, z: float, yaw: float = 0.0) -> np.ndarray:
    """A pose."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation_z(yaw), (x, y, z)
    return T


@pytest.fixture(scope="module")
def scenes() -> dict[tuple[str, int], Scene]:
    """Two rooms of every kind and a flat."""
    return {key: build_scene(*key) for key in [*FEW, ("flat", 0)]}


def test_generated_scenes_are_sound(scenes: dict[tuple[str, int], Scene]) -> None:
    for key, scene in scenes.items():
        assert check_scene(scene) == [], key


def test_rooms_hold_what_they_are_for(scenes: dict[tuple[str, int], Scene]) -> None:
    wanted = {
        "living_room": {"sofa", "corner_sofa"},
        "bedroom": {"bed", "bunk_bed"},
        "office": {"desk", "corner_desk", "standing_desk"},
        "kitchen": {"base_units"},
        "bathroom": {"toilet", "bath_tub", "shower"},
    }
    for (kind, _), scene in scenes.items():
        names = {piece.name for piece in scene.pieces}
        assert kind not in wanted or names & wanted[kind], (kind, names)
        assert scene.rooms[0].kind == kind or kind == "flat"
        assert sum(p.name == "ceiling_lamp" for p in scene.pieces) <= len(scene.rooms)


def test_small_things_settle_in_every_kind_of_room(scenes: dict[tuple[str, int], Scene]) -> None:
    tilted = 0
    for scene in scenes.values():
        for piece in scene.pieces:
            tilted += abs(piece.T_world_piece[2, 2] - 1) > 1e-9  # only physics tilts
    assert tilted > 40


def test_a_scene_is_the_same_every_time() -> None:
    first, again = build_scene("kitchen", 5), build_scene("kitchen", 5)
    assert len(first.parts) == len(again.parts)
    assert np.array_equal(first.surface()[0], again.surface()[0])


def test_flats_have_a_round_trip() -> None:
    lengths = []
    for seed in range(40):
        plan = draw_flat(np.random.default_rng(seed), 2.6)
        assert len(plan.rooms) >= 5
        reached, frontier = {0}, [0]
        while frontier:
            k = frontier.pop()
            new = {j for d in plan.doors for j in d.rooms if k in d.rooms} - reached
            reached |= new
            frontier += new
        assert reached == set(range(len(plan.rooms)))
        ring = 3 if {plan.doors[2].rooms[0], plan.doors[2].rooms[1]} == {2, 0} else 4
        lengths.append(circle(plan.doors[:ring]))
        for door in plan.doors:
            gap = [door.centre + side * 0.3 * door.normal for side in (-1, 1)]
            for point, k in zip(gap, door.rooms, strict=True):
                assert (point > plan.rooms[k].low).all() and (point < plan.rooms[k].high).all()
    assert min(lengths) >= ROUND_TRIP_M


def test_the_mix_names_scenes() -> None:
    assert set(MIX) <= set(SCENES)
    assert all(share > 0 for share in MIX.values())


def test_things_fall_onto_what_is_below_and_rest() -> None:
    table = Collider(np.array([0, 0, 0.375]), np.eye(3), np.array([0.5, 0.5, 0.375]), None)
    things = [LooseThing(cube(), at(0.1, 0.1, 0.76, 0.4), 0.75), LooseThing(cube(), at(0.1, 0.1, 0.98), 0.75)]
    low, high = settle(things, [table])
    assert low is not None and high is not None
    assert low[2, 3] == pytest.approx(0.75, abs=2e-3) and high[2, 3] == pytest.approx(0.95, abs=4e-3)


def test_what_falls_off_is_left_out_and_so_is_what_lay_on_it() -> None:
    table = Collider(np.array([0, 0, 0.375]), np.eye(3), np.array([0.5, 0.5, 0.375]), None)
    floor = Collider(np.array([0, 0, -0.5]), np.eye(3), np.array([5, 5, 0.5]), None)
    over_the_edge = LooseThing(cube(), at(0.62, 0.0, 0.76), 0.75)
    rider = LooseThing(cube((0.1, 0.1, 0.1)), at(0.62, 0.0, 0.97), 0.75)
    safe = LooseThing(cube(), at(-0.2, 0.0, 0.76), 0.75)
    poses = settle([over_the_edge, rider, safe], [table, floor])
    assert poses[0] is None and poses[1] is None and poses[2] is not None


def test_an_overlap_is_found_and_measured() -> None:
    scene = bare_scene()
    scene.place(cube(label="table"), (0, 0, 0))
    scene.place(cube(label="chair"), (0.18, 0, 0))
    scene.place(cube(label="sofa"), (-0.197, 0, 0))
    ((a, b, deep),) = overlaps(scene)
    assert (a, b) == (0, 1) and deep == pytest.approx(0.02, abs=1e-3)
    assert "overlap by 20" in interpenetrations(scene)[0]


def test_a_hollow_made_of_parts_is_not_filled() -> None:
    legs = merged([box((0.05, 0.05, 0.7), (x, y, 0)) for x in (-0.5, 0.5) for y in (-0.3, 0.3)])
    table = Assembly("table")
    table.add(legs, "any")
    assert len(colliders_of(table)) == 4
    scene = bare_scene()
    scene.place(table, (0, 0, 0))
    scene.place(cube(), (0, 0, 0))
    assert overlaps(scene) == []


def test_round_things_are_hulls_and_boxes_are_boxes() -> None:
    piece = Assembly("objects")
    piece.add(box((0.3, 0.2, 0.1), bevel=0.01).moved((1, 2, 3), 0.7), "any")
    piece.add(cylinder(0.1, 0.3), "any")
    boxy, round_one = colliders_of(piece)
    assert boxy.hull is None and sorted(boxy.half) == pytest.approx([0.05, 0.1, 0.15])
    assert round_one.hull is not None


def test_touch_sees_turned_boxes() -> None:
    def turned(x: float, yaw: float) -> list[Collider]:
        return [Collider(np.array([x, 0, 0]), rotation_z(yaw), np.array([0.1, 0.1, 0.1]), None)]

    assert touch(turned(0, 0), turned(0.23, np.pi / 4), 0.0)
    assert not touch(turned(0, 0), turned(0.23, 0.0), 0.0)
    assert touch(turned(0, 0), turned(0.23, 0.0), 0.04)


def test_a_barred_way_and_a_stray_are_found() -> None:
    scene = bare_scene()
    scene.place(cube((3.9, 0.3, 1.0)), (0, 0, 0))
    assert blocked_ways(scene) == []  # one half is still a place to stand
    scene.place(cube((3.9, 3.5, 1.0)), (0, 0, 0))
    assert "bars the way" in blocked_ways(scene)[0]
    scene.place(cube(), (2.0, 0, 0))
    assert "100 mm out of room 0" in strays(scene)[0]


def test_a_way_needs_its_width() -> None:
    floor = Walkable(np.zeros(2), np.array([4.0, 4.0]))
    floor.anchors = [np.array([2.0, 0.5]), np.array([2.0, 3.5])]

    def bar(x0: float, x1: float) -> np.ndarray:
        return np.array([[x0, 1.9], [x1, 1.9], [x1, 2.1], [x0, 2.1]])

    assert floor.stays_open([bar(0.0, 3.1)])
    assert not floor.stays_open([bar(0.0, 3.5)])
    assert not floor.stays_open([bar(0.0, 4.0)])


def test_layout_keeps_pieces_apart_and_doors_free() -> None:
    scene = bare_scene()
    layout = Layout(scene, np.random.default_rng(0))
    wall = layout.walls[0]
    layout.keep_out(wall, -0.5, 0.5, 0.9)
    chest = cube((0.8, 0.4, 0.9), "furniture")
    assert layout.against(chest, wall, 0.0) is None
    assert layout.against(chest, wall, 1.2, front=0.4) == pytest.approx(1.2)
    assert layout.stand(chest, wall.point(1.2, 0.7), 0.0) is None  # in front of the drawers
    assert layout.stretches(wall, 0.5)[0][1] == pytest.approx(-0.5, abs=0.06)


@pytest.mark.slow
def test_500_seeds_in_a_row_are_sound_and_show_every_class() -> None:
    kinds, shares = list(MIX), np.array(list(MIX.values())) / sum(MIX.values())
    labels: list[set[int]] = []
    wrong: dict[tuple[str, int], list[str]] = {}
    for seed in range(500):
        kind = str(np.random.default_rng([seed, 500]).choice(kinds, p=shares))
        scene = build_scene(kind, seed)
        problems = check_scene(scene)
        if problems:
            wrong[kind, seed] = problems
        labels.append({part.label for part in scene.parts})
    assert wrong == {}
    for first in range(451):
        assert set.union(*labels[first : first + 50]) == set(range(1, len(CLASS_NAMES)))
