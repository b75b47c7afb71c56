"""Flats in a row: one can walk from any room to any other, and nothing lies in anything else's place."""

import numpy as np
import pytest

from dsmap.errors import InputError
from dsmap.sim_scenes.rooms.blueprint import Blueprint
from dsmap.sim_scenes.rooms.build import is_scene
from dsmap.sim_scenes.rooms.joined_flats import draw_flats
from dsmap.sim_scenes.rooms.layout import walls_of


def reached_from_first(plan: Blueprint) -> set[int]:
    reached: set[int] = set()
    new = {0}
    while new:
        reached |= new
        new = {j for d in plan.doors for j in d.rooms if reached & set(d.rooms)} - reached
    return reached


@pytest.mark.parametrize("count", [2, 4])
def test_all_rooms_of_all_flats_are_joined(count: int) -> None:
    for seed in range(15):
        plan = draw_flats(np.random.default_rng(seed), 2.6, count)
        assert len(plan.bare) == count - 1
        assert len(plan.rooms) >= 5 * count + count - 1
        assert reached_from_first(plan) == set(range(len(plan.rooms)))


def test_doors_lead_from_room_to_room_and_each_has_its_two_holes() -> None:
    for seed in range(15):
        plan = draw_flats(np.random.default_rng(seed), 2.6, 3)
        for door in plan.doors:
            for side, k in zip((-1, 1), door.rooms, strict=True):
                room = plan.rooms[k]
                point = door.centre + side * 0.3 * door.normal
                assert (point > room.low).all() and (point < room.high).all()
                walls = zip(walls_of(room), plan.holes[k], strict=True)
                holes = [wall.point(hole.x, 0.0) for wall, own in walls for hole in own]
                assert any(np.linalg.norm(at - door.centre) < 0.07 for at in holes)


def test_rooms_do_not_overlap() -> None:
    for seed in range(15):
        rooms = draw_flats(np.random.default_rng(seed), 2.6, 3).rooms
        for i, a in enumerate(rooms):
            for b in rooms[:i]:
                assert (np.minimum(a.high, b.high) - np.maximum(a.low, b.low)).min() < 0


def test_other_numbers_of_flats_are_refused_in_a_sentence() -> None:
    assert is_scene("flats:2") and not is_scene("flats")
    for name in ("flats:1", "flats:99"):
        with pytest.raises(InputError, match="expected flats:2 to flats:6"):
            is_scene(name)
