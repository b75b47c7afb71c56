"""Cameras of any intrinsics and moving bodies, in every renderer."""

from dataclasses import replace

import numpy as np
import pytest

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sim_scenes.geometry.shapes import box
from dsmap.sim_scenes.render import egl
from dsmap.sim_scenes.render.open_renderer import open_renderer
from dsmap.sim_scenes.render.renderer import RENDERERS
from dsmap.sim_scenes.scene import Body, Light, Material, Part, Scene

ODD = Intrinsics(120, 90, 110.0, 84.0, 41.3, 57.8)
"""Off-centre principal point, and pixels that are not square."""


def toy() -> Scene:
    """A wall at y = 3 and a cube of 0.4 m before it, around (0.2, 2, 0.1), that can move; camera looks along +y."""
    paint = Material(np.full((4, 4, 3), 180, np.uint8), 1.0)
    parts = [
        Part(box((12, 0.2, 12), (0, 3.1, -6)), "paint", 12, 1),
        Part(box((0.4, 0.4, 0.4), (0.2, 2.2, -0.1)), "paint", 7, 2, body=1),
    ]
    rest = np.eye(4)
    rest[:3, 3] = 0.2, 2.2, 0.1
    light = Light(np.array([0, -1.0, 1]), np.ones(3), np.zeros(3))
    scene = Scene("toy", 0, np.array([12, 6, 12.0]), {"paint": paint}, parts, [light])
    scene.bodies.append(Body("cube", 2, rest))
    return scene


FORWARD = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""T_world_camera of a level camera at the origin that looks along +y."""


def expected_part(camera: Intrinsics, shift: np.ndarray) -> np.ndarray:
    """Which part each pixel sees, once the cube was shifted parallel to the wall: its front face at y = 2."""
    x = (np.arange(camera.width) - camera.cx) / camera.fx * 2.0
    z = -(np.arange(camera.height) - camera.cy) / camera.fy * 2.0
    inside = (np.abs(z - 0.1 - shift[2]) < 0.2)[:, None] & (np.abs(x - 0.2 - shift[0]) < 0.2)[None]
    return inside


@pytest.mark.parametrize("name", RENDERERS)
def test_any_pinhole_camera_and_moving_bodies(name: str) -> None:
    if name != "warp":
        try:
            egl.use_egl()
        except InputError as error:
            pytest.skip(str(error))
    scene = toy()
    renderer = open_renderer(name, scene, ODD)
    for shift in (np.zeros(3), np.array([-0.35, 0.0, 0.3])):
        now = scene.bodies[0].T_world_rest.copy()
        now[:3, 3] += shift
        image = renderer(FORWARD, now[None])
        front = expected_part(ODD, shift)
        # All that is not the cube's front is its sides or the wall; one pixel of outline may differ.
        depth = np.where(front, 2.0, 3.0)
        off = np.abs(image.depth - depth) > 0.005
        sides = (image.part == 1) & ~front
        assert (off & ~sides).mean() < 0.002
        assert (image.part[front] == 1).mean() > 0.97
        assert 0 < sides.mean() < 0.2
    front = expected_part(ODD, np.zeros(3))
    assert (np.abs(renderer(FORWARD).depth[front] - 2.0) < 0.005).mean() > 0.97
    renderer.close()


def test_a_turned_body_shows_its_corner() -> None:
    scene = toy()
    renderer = open_renderer("warp", scene, replace(ODD, cx=59.5, cy=44.5))
    now = scene.bodies[0].T_world_rest.copy()
    c = np.sqrt(0.5)
    now[:3, :3] = [[c, -c, 0], [c, c, 0], [0, 0, 1]]
    assert renderer(FORWARD, now[None]).depth.min() == pytest.approx(2.2 - 0.2 * np.sqrt(2), abs=0.01)
    renderer.close()
