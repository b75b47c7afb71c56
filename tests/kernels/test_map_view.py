"""Index map and model prediction: against their NumPy twins, and against what a camera must see."""

import numpy as np
import pytest
import warp as wp

from dsmap.kernels.camera import make_camera
from dsmap.kernels.index_map import render_index
from dsmap.kernels.predict import predict_model
from dsmap.kernels.types import ModelMaps, SurfelMap
from dsmap.tools.twins import scene as random_scene
from dsmap.tools.twins import surfels as reference_map

CAMERA, SHAPE = random_scene.CAMERA, (48, 64)


def index_of(surfels, T, camera=CAMERA, **options) -> np.ndarray:
    index = wp.empty((camera.height, camera.width), dtype=wp.int32, device="cpu")
    render_index(surfels, camera, T, index=index, **{"max_depth": 3.0} | options)
    return index.numpy()


def plane(
    depth: float, spacing: float, half: float = 2.0, weight: float = 20.0, radius: float = 1.0
) -> SurfelMap:
    """A wall of surfels facing the camera at the origin; `radius` in units of sqrt(2) spacing."""
    a = np.arange(-half, half, spacing)
    x, y = (v.ravel() for v in np.meshgrid(a, a))
    surfels = SurfelMap.empty("cpu", capacity=len(x))
    surfels.count = len(x)
    s = surfels.numpy()
    s["position"][:] = np.stack([x, y, np.full_like(x, depth)], 1)
    s["normal"][:] = [0, 0, -1]
    s["weight"][:], s["radius"][:] = weight, radius * np.sqrt(2) * spacing
    return surfels


def joined(*maps: SurfelMap) -> SurfelMap:
    result = SurfelMap.empty("cpu", capacity=sum(m.count for m in maps))
    result.count = result.capacity
    for name, array in result.numpy().items():
        array[:] = np.concatenate([m.numpy()[name] for m in maps])
    return result


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"stable_weight": 10.0, "penalty": 0.05},
        {"min_weight": 5.0, "t_min": 10, "t_max": 30, "max_depth": 1.4},
    ],
)
def test_index_map_equals_its_twin(seed, options):
    T = random_scene.pose(seed)
    surfels = random_scene.surfel_map(T, seed=seed)
    options = {"max_depth": 3.0} | options
    expected = reference_map.render_index(reference_map.arrays(surfels), CAMERA, T, **options)
    found = index_of(surfels, T, **options)
    assert (expected >= 0).mean() > 0.1
    # Borderline decisions may fall the other way in single precision: 3 pixels of 3072.
    assert (found != expected).sum() <= 3


def test_prediction_equals_its_twin():
    T = random_scene.pose(5)
    surfels = random_scene.surfel_map(T, seed=5)
    maps = ModelMaps.empty(*SHAPE, "cpu")
    predict_model(surfels, CAMERA, T, max_depth=3.0, maps=maps)
    index = maps.index.numpy()
    expected = reference_map.predict_model(reference_map.arrays(surfels), CAMERA, T, index)
    for name, value in expected.items():
        np.testing.assert_allclose(getattr(maps, name).numpy(), value, atol=2e-4, err_msg=name)
    predict_model(SurfelMap.empty("cpu"), CAMERA, T, max_depth=3.0, maps=maps)
    for name, value in ModelMaps.empty(*SHAPE, "cpu").__dict__.items():
        assert (getattr(maps, name).numpy() == value.numpy()).all(), f"{name} keeps an old view"


@pytest.mark.parametrize("depth", [0.3, 0.6, 1.0, 2.5])
def test_a_wall_has_no_holes_from_any_distance(depth):
    """Surfels one pixel apart at 1 m, seen from 0.3 to 2.5 m."""
    surfels = plane(depth, spacing=1.0 / CAMERA.fx)
    maps = ModelMaps.empty(*SHAPE, "cpu")
    predict_model(surfels, CAMERA, np.eye(4), max_depth=3.0, maps=maps)
    assert (maps.index.numpy() >= 0).all()
    np.testing.assert_allclose(maps.vertex.numpy()[..., 2], depth, rtol=1e-5)


def test_a_slanted_wall_has_no_holes():
    T = np.eye(4)
    c, s = np.cos(1.1), np.sin(1.1)
    T[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    T[:3, 3] = [-1.2, 0, 0.5]
    surfels = plane(1.0, spacing=0.5 / CAMERA.fx, half=4.0)
    index = index_of(surfels, T, max_depth=10.0)
    view = reference_map.rays(CAMERA) @ T[:3, :3].T
    meets = (0.5 / np.maximum(view[..., 2], 1e-9))[..., None] * view[..., :2] + T[:2, 3]
    inside = (view[..., 2] > 0.1) & (np.abs(meets) < 3.9).all(-1)
    assert inside.mean() > 0.3
    assert (index[inside] >= 0).all()


def test_the_front_surface_hides_what_is_behind_even_between_its_surfels():
    """A table top 0.2 m before a wall, seen from so near that its surfels are two pixels apart."""
    top = plane(0.5, spacing=1.0 / CAMERA.fx, half=0.1)
    surfels = joined(plane(0.7, spacing=0.4 / CAMERA.fx), top)
    index = index_of(surfels, np.eye(4))
    y, x = np.mgrid[:48, :64]
    on_top = (np.abs((x - CAMERA.cx) / CAMERA.fx) < 0.17) & (np.abs((y - CAMERA.cy) / CAMERA.fy) < 0.17)
    first_of_top = surfels.count - top.count
    assert (index[on_top] >= first_of_top).all()
    off_top = (np.abs((x - CAMERA.cx) / CAMERA.fx) > 0.27) | (np.abs((y - CAMERA.cy) / CAMERA.fy) > 0.27)
    assert (index[off_top] < first_of_top).all() and (index[off_top] >= 0).all()


def test_unstable_surfels_fill_holes_but_hide_nothing_within_the_penalty():
    spacing = 1.0 / CAMERA.fx
    for gap, wins in ((0.03, False), (0.2, True)):
        ghost = plane(1.0 - gap, spacing, weight=1.0)
        wall = plane(1.0, spacing)
        index = index_of(joined(wall, ghost), np.eye(4), stable_weight=10.0, penalty=0.05)
        assert ((index >= wall.count) == wins).all()
    assert (index_of(ghost, np.eye(4), stable_weight=10.0) >= 0).all()


def test_surfels_that_face_away_are_dead_or_old_are_not_drawn():
    surfels = plane(1.0, 1.0 / CAMERA.fx)
    surfels.t_updated.fill_(7)
    assert (index_of(surfels, np.eye(4), t_min=7, t_max=7) >= 0).all()
    assert (index_of(surfels, np.eye(4), t_min=8) < 0).all()
    assert (index_of(surfels, np.eye(4), t_max=6) < 0).all()
    assert (index_of(surfels, np.eye(4), max_depth=0.9) < 0).all()
    surfels.normal.numpy()[:] = [0, 0, 1]
    assert (index_of(surfels, np.eye(4)) < 0).all()
    surfels.normal.numpy()[:] = [0, 0, -1]
    surfels.weight.zero_()
    assert (index_of(surfels, np.eye(4)) < 0).all()


def test_a_view_of_another_size():
    camera = make_camera(random_scene.SCENE_INTRINSICS.scaled(32, 20))
    index = index_of(plane(1.0, 1.0 / CAMERA.fx), np.eye(4), camera=camera)
    assert index.shape == (20, 32) and (index >= 0).all()
