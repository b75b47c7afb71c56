"""The ray tracer's options: lens distortion, smooth images, shadows, and one compiled kernel for all of them."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from sim_toys import compiled_kernel

from dsmap.sim_scenes.geometry.shapes import box
from dsmap.sim_scenes.importers.load import load_scene
from dsmap.sim_scenes.render.renderer import default_camera, pixel_rays
from dsmap.sim_scenes.render.warp_renderer import WarpRenderer
from dsmap.sim_scenes.rooms.build import build_scene
from dsmap.sim_scenes.rooms.lighting import MOODS, SHARES
from dsmap.sim_scenes.scene import MAX_LIGHTS, Light, Material, Part, Scene

CAMERA = default_camera(64, 48)
DOWN = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 2], [0, 0, 0, 1]])
"""T_world_camera of a camera 2 m above the floor that looks straight down."""


def toy(size: float = 0.8, lights: int = 1) -> Scene:
    """A floor with a cube on it, lit from above at one side."""
    checks = (np.indices((16, 16)).sum(0) % 2 * 155 + 100).astype(np.uint8)
    looks = {"checks": Material(np.repeat(checks[..., None], 3, 2), 0.16)}
    parts = [
        Part(box((8, 8, 0.1), (0, 0, -0.1)), "checks", 5, 1),
        Part(box((size, size, 0.5)), "checks", 10, 2),
    ]
    lamps = [Light(np.array([0.9, 0, 1.8 + k]), np.full(3, 0.8 / lights), np.zeros(3)) for k in range(lights)]
    return Scene("toy", 0, np.array([8, 8, 2.5]), looks, parts, lamps, np.full(3, 0.1))


def test_a_distorted_camera_sees_points_where_opencv_projects_them() -> None:
    bent = replace(default_camera(160, 120), distortion=(-0.2, 0.05, 0.001, -0.002, 0.01))
    rays = pixel_rays(bent).reshape(-1, 3).astype(float)
    points, _ = cv2.projectPoints(
        rays / rays[:, 2:], np.zeros(3), np.zeros(3), bent.K, np.array(bent.distortion)
    )
    grid = np.stack(np.meshgrid(np.arange(160), np.arange(120)), -1).reshape(-1, 2)
    assert np.abs(points.reshape(-1, 2) - grid).max() < 1e-3
    image = WarpRenderer(toy(), replace(CAMERA, distortion=(-0.3, 0.0, 0.0, 0.0, 0.0)))(DOWN)
    straight = WarpRenderer(toy(), CAMERA)(DOWN)
    floor = np.array([0, 1], np.int32)[image.part] == 0
    assert np.abs(image.depth[floor] - 2.0).max() < 1e-4  # depth stays planar
    assert (image.part == 1).sum() < (
        straight.part == 1
    ).sum()  # barrel: things look smaller away from the middle


def test_smooth_images_average_four_rays_and_leave_depth_and_labels_alone() -> None:
    sharp, smooth = (WarpRenderer(toy(), CAMERA, smooth=s)(DOWN) for s in (False, True))
    assert (sharp.depth == smooth.depth).all() and (sharp.part == smooth.part).all()
    fine = WarpRenderer(toy(), default_camera(512, 384))(DOWN).rgb  # 64 rays a pixel
    truth = cv2.resize(fine, (64, 48), interpolation=cv2.INTER_AREA).astype(float)
    assert np.abs(smooth.rgb - truth).mean() < 0.75 * np.abs(sharp.rgb - truth).mean()


def test_shadows_darken_the_far_side_of_the_cube_only() -> None:
    with_, without = (
        WarpRenderer(toy(), CAMERA, shadows=s)(DOWN).rgb.astype(float).mean(-1) for s in (True, False)
    )
    changed = (without - with_) > 10
    assert changed[:, :20].any() and not changed[:, 45:].any()


def test_one_kernel_serves_rooms_toys_and_imported_scenes(tmp_path: Path) -> None:
    (tmp_path / "toy.xml").write_text(
        '<mujoco><worldbody><geom name="floor" type="plane" size="2 2 1"/></worldbody></mujoco>'
    )
    names = set()
    for scene in (
        build_scene("flat", 3),
        build_scene("office", 4),
        toy(lights=3),
        load_scene(tmp_path / "toy.xml"),
    ):
        renderer = WarpRenderer(scene, CAMERA)
        renderer(DOWN)
        names.add(compiled_kernel(renderer))
    bent = WarpRenderer(toy(), replace(CAMERA, distortion=(-0.1, 0.0, 0.0, 0.0, 0.0)), shadows=False)
    bent(DOWN)
    assert names == {compiled_kernel(bent)}


def test_every_mood_lights_every_room_of_a_flat() -> None:
    assert set(MOODS) == set(SHARES) and abs(sum(SHARES.values()) - 1) < 1e-9
    scene = build_scene("flat", 5)
    assert 0 < len(scene.lights) <= MAX_LIGHTS
    renderer, means = WarpRenderer(scene, default_camera(32, 24)), []
    for room in scene.rooms:
        for angle in np.arange(4) * np.pi / 2:
            pose = np.eye(4)
            forward = np.array([np.cos(angle), np.sin(angle), 0])
            pose[:3, 0], pose[:3, 1], pose[:3, 2] = np.cross(forward, [0, 0, 1]), (0, 0, -1), forward
            pose[:3, 3] = *(room.low + room.high) / 2, 1.5
            means.append(renderer(pose).rgb.mean() / 255)
    by_room = np.array(means).reshape(-1, 4).mean(1)
    assert by_room.min() > 0.1 and by_room.max() < 0.85 and by_room.max() < 4 * by_room.min()
