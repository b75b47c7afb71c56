"""Scenes and camera paths, without rendering: classes, layout, free space, pace."""

import numpy as np
import pytest

from dsmap.classes import CLASS_NAMES
from dsmap.errors import InputError
from dsmap.sim_scenes.camera_paths.paths import FreeSpace, camera_path, frame_rotations, walked_length
from dsmap.sim_scenes.geometry import shapes
from dsmap.sim_scenes.rooms.build import build_scene
from dsmap.sim_scenes.scene import Scene

ROOMS = [("living_room", 1), ("living_room", 2), ("bedroom", 2), ("kitchen", 1)]


@pytest.fixture(scope="module")
def scenes() -> dict[tuple[str, int], Scene]:
    """The rooms that the tests below look at."""
    return {key: build_scene(*key) for key in ROOMS}


def signed_volume(shape: shapes.Shape) -> float:
    """Volume inside a closed mesh with outward faces [m^3]."""
    a, b, c = shape.vertices[shape.faces].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def cloth() -> shapes.Shape:
    """A flat sheet of 1 x 2 m, 0.1 thick."""
    x, z = np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 2, 6))
    return shapes.sheet(np.stack([x, 0 * x, z], -1), 0.1)


@pytest.mark.parametrize(
    ("shape", "volume"),
    [
        (shapes.box((1, 2, 3), (4, 5, 6)), 6.0),
        (shapes.box((1, 1, 1), bevel=0.1), 1 - 12 * 0.8 * 0.005 - 8 * (0.001 - 0.001 / 6)),
        (shapes.cylinder(0.5, 2.0, sides=64), np.pi / 2),
        (shapes.lathe([(1.0, 0), (0.5, 1.0)], sides=96), np.pi * 1.75 / 3),
        (shapes.cushion((1, 1, 1), softness=1.0, rings=32), np.pi / 6),
        (cloth(), 0.2),
    ],
)
def test_shapes_are_closed_and_face_outwards(shape: shapes.Shape, volume: float) -> None:
    assert signed_volume(shape) == pytest.approx(volume, rel=0.01)


def test_seed_varies_everything_and_repeats_exactly(scenes: dict) -> None:
    first, second, again = scenes["living_room", 1], scenes["living_room", 2], build_scene("living_room", 1)
    for name in first.materials:
        assert np.array_equal(first.materials[name].texture, again.materials[name].texture)
    assert np.array_equal(first.surface()[0], again.surface()[0])
    assert np.allclose([light.position for light in first.lights], [light.position for light in again.lights])
    assert not np.allclose(first.size, second.size)
    assert not np.allclose(first.targets[0], second.targets[0])
    assert not np.allclose(first.lights[0].diffuse, second.lights[0].diffuse)
    wall = [next(s.materials[p.material].texture for p in s.parts if p.label == 12) for s in (first, second)]
    assert abs(wall[0].mean() - wall[1].mean()) > 0.5


def test_rooms_are_closed_and_furniture_stands_inside(scenes: dict) -> None:
    for scene in scenes.values():
        half = scene.size[:2] / 2
        for part in scene.parts:
            low, high = part.shape.bounds()
            if CLASS_NAMES[part.label] in ("wall", "floor", "ceiling", "window"):
                continue
            assert (low[:2] > -half - 0.01).all() and (high[:2] < half + 0.01).all()
            assert low[2] > -0.01 and high[2] < scene.size[2] + 0.01


def test_unknown_names_are_input_errors(scenes: dict) -> None:
    with pytest.raises(InputError, match="expected one of: living_room, bedroom"):
        build_scene("garage", 1)
    with pytest.raises(InputError, match="expected one of: walk, views"):
        camera_path(scenes["bedroom", 2], "fly", 10, 30.0, 1)


@pytest.mark.parametrize("key", ROOMS)
def test_walk_is_long_calm_and_clear_of_everything(scenes: dict, key: tuple[str, int]) -> None:
    scene = scenes[key]
    poses = camera_path(scene, "walk", 300, 30.0, key[1])
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    turns = frame_rotations(poses)
    assert walked_length(poses[:, :3, 3]) >= 4.0
    assert turns.sum() >= 180.0
    assert steps.max() < 0.03 and turns.max() < 3.0
    assert FreeSpace(scene).clearance(poses[:, :3, 3]).min() >= 0.4
    assert np.allclose(poses[:, :3, :3] @ poses[:, :3, :3].transpose(0, 2, 1), np.eye(3), atol=1e-9)
    assert np.allclose(np.linalg.det(poses[:, :3, :3]), 1.0)


def test_a_longer_walk_begins_like_a_shorter_one(scenes: dict) -> None:
    scene = scenes["bedroom", 2]
    short, long = (camera_path(scene, "walk", n, 30.0, 2) for n in (60, 450))
    assert np.allclose(short, long[:60])


def test_views_are_diverse_and_in_free_space(scenes: dict) -> None:
    scene = scenes["living_room", 2]
    poses = camera_path(scene, "views", 60, 30.0, 2)
    assert FreeSpace(scene).clearance(poses[:, :3, 3]).min() >= 0.3
    heading = np.arctan2(poses[:, 1, 2], poses[:, 0, 2])
    assert len(np.unique(np.floor((heading + np.pi) / (np.pi / 4)))) >= 6
    assert poses[:, 2, 3].std() > 0.15
