"""The OpenGL renderers against the ray tracer: same depth, same labels, like colours."""

import ctypes
from dataclasses import replace

import cv2
import numpy as np
import pytest

from dsmap.errors import InputError
from dsmap.sim_scenes.camera_paths.paths import camera_path
from dsmap.sim_scenes.geometry.shapes import box
from dsmap.sim_scenes.render import egl
from dsmap.sim_scenes.render.open_renderer import open_renderer
from dsmap.sim_scenes.render.renderer import RENDERERS, Image, default_camera, part_tables
from dsmap.sim_scenes.rooms.build import build_scene
from dsmap.sim_scenes.scene import Light, Material, Part, Scene

CAMERA = default_camera(160, 120)


def edges(image: Image, label: np.ndarray) -> np.ndarray:
    """Pixels within two of a bend or step in depth, or of an outline between classes."""
    bend = np.abs(cv2.Laplacian(image.depth, cv2.CV_32F)) > 0.02
    outline = cv2.morphologyEx(label[image.part], cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0
    return cv2.dilate((bend | outline).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0


@pytest.mark.parametrize(("kind", "seed"), [("bedroom", 2), ("kitchen", 1)])
def test_all_three_renderers_agree_in_depth_labels_and_looks(kind: str, seed: int) -> None:
    try:
        egl.use_egl()
    except InputError as error:
        pytest.skip(str(error))
    scene = build_scene(kind, seed)
    label, poses = part_tables(scene)[0], camera_path(scene, "views", 3, 30.0, seed)
    # OpenGL's lamps cast other shadows than rays do, or none: compared are the looks without.
    pictures = {}
    for name in RENDERERS:
        renderer = open_renderer(name, scene, CAMERA, shadows=False, smooth=True)
        pictures[name] = [renderer(pose) for pose in poses]
        renderer.close()
    for name, alike in (("mujoco", 0.8), ("pyrender", 0.5)):
        for ours, theirs in zip(pictures["warp"], pictures[name], strict=True):
            off, apart = ~edges(ours, label), np.abs(ours.depth - theirs.depth)
            assert off.mean() > 0.3
            assert np.median(apart) < 0.001 and (apart[off] < 0.005).mean() > 0.99
            assert (label[ours.part] == label[theirs.part])[off].mean() > 0.99
            assert (
                theirs.rgb.shape == (120, 160, 3) and theirs.rgb.std() > 10 and 25 < theirs.rgb.mean() < 220
            )
            # pyrender's lamps burn what is next to them, as 1 / distance^2 does.
            fair = (theirs.rgb < 250).all(-1)
            assert fair.mean() > 0.6
            a, b = ours.rgb[fair].astype(float), theirs.rgb[fair].astype(float)
            assert np.corrcoef(a.mean(-1), b.mean(-1))[0, 1] > alike  # the textures lie the same way round
            assert np.corrcoef(a[:, 0] - a[:, 2], b[:, 0] - b[:, 2])[0, 1] > alike  # and red is red


def test_lamps_cast_shadows_in_pyrender() -> None:
    try:
        egl.use_egl()
    except InputError as error:
        pytest.skip(str(error))
    white = {"white": Material(np.full((4, 4, 3), 200, np.uint8), 1.0)}
    parts = [
        Part(box((6, 6, 0.1), (0, 0, -0.1)), "white", 5, 1),
        Part(box((0.5, 0.5, 0.1), (0, 0, 1.0)), "white", 10, 2),
    ]
    lamp = Light(np.array([0, 0, 2.2]), np.ones(3), np.zeros(3))
    scene = Scene("toy", 0, np.array([6, 6, 2.5]), white, parts, [lamp], np.full(3, 0.2))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]], (0, -2.5, 0.6)  # level, along +y
    for shadows in (True, False):
        renderer = open_renderer("pyrender", scene, CAMERA, shadows=shadows)
        rgb = renderer(pose).rgb.astype(float)
        renderer.close()
        row = int(CAMERA.cy + CAMERA.fy * 0.6 / 2.5)  # the floor below the board
        below, beside = rgb[row, 78:82].mean(), rgb[row, 28:32].mean()
        assert (below < 0.75 * beside) == shadows


def test_distortion_is_refused_with_the_renderer_that_can() -> None:
    bent = replace(CAMERA, distortion=(-0.05, 0.0, 0.0, 0.0, 0.0))
    with pytest.raises(InputError, match="--renderer mujoco .* expected warp"):
        open_renderer("mujoco", build_scene("bedroom", 2), bent)


def test_a_missing_library_is_named_with_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(ctypes, "CDLL", missing)
    monkeypatch.setattr(egl.sys, "platform", "linux")
    with pytest.raises(InputError, match="libEGL.so.1 is missing; install the system packages libegl1"):
        open_renderer("mujoco", build_scene("bedroom", 2), CAMERA)


def test_unknown_renderer_is_an_input_error() -> None:
    with pytest.raises(InputError, match="expected one of: warp, mujoco, pyrender"):
        open_renderer("blender", build_scene("bedroom", 2), CAMERA)
