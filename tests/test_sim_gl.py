"""The OpenGL renderers against the ray tracer: same depth, same labels."""

import ctypes

import numpy as np
import pytest

from dsmap.errors import InputError
from dsmap.sim_scenes import gl
from dsmap.sim_scenes.render import default_camera, open_renderer, part_tables
from dsmap.sim_scenes.rooms import build_scene
from dsmap.sim_scenes.trajectories import camera_path

CAMERA = default_camera(160, 120)


@pytest.mark.parametrize("name", ["mujoco", "pyrender"])
def test_agrees_with_the_ray_tracer_in_depth_and_labels(name: str) -> None:
    try:
        gl.use_egl()
    except InputError as error:
        pytest.skip(str(error))
    scene = build_scene("bedroom", 2)
    label = part_tables(scene)[0]
    renderers = [open_renderer(which, scene, CAMERA) for which in ("warp", name)]
    for pose in camera_path(scene, "views", 3, 30.0, 2):
        ours, theirs = (renderer(pose) for renderer in renderers)
        assert np.median(np.abs(ours.depth - theirs.depth)) < 0.0005
        assert (np.abs(ours.depth - theirs.depth) < 0.001).mean() > 0.98
        assert (label[ours.part] == label[theirs.part]).mean() > 0.99
        assert theirs.rgb.shape == (120, 160, 3) and theirs.rgb.std() > 15 and 30 < theirs.rgb.mean() < 220
        correlation = np.corrcoef(ours.rgb.mean(-1).ravel(), theirs.rgb.mean(-1).ravel())[0, 1]
        assert correlation > 0.75  # the textures lie the same way round
        ours_warm, theirs_warm = (im.rgb[..., 0].astype(float) - im.rgb[..., 2] for im in (ours, theirs))
        assert np.corrcoef(ours_warm.ravel(), theirs_warm.ravel())[0, 1] > 0.7  # and red is red
    for renderer in renderers:
        renderer.close()


def test_a_missing_library_is_named_with_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(ctypes, "CDLL", missing)
    monkeypatch.setattr(gl.sys, "platform", "linux")
    with pytest.raises(InputError, match="libEGL.so.1 is missing; install the system packages libegl1"):
        open_renderer("mujoco", build_scene("bedroom", 2), CAMERA)


def test_unknown_renderer_is_an_input_error() -> None:
    with pytest.raises(InputError, match="expected one of: warp, mujoco, pyrender"):
        open_renderer("blender", build_scene("bedroom", 2), CAMERA)
