"""A map with a finest resolution: against the twins, and what it must and must not leave out."""

import numpy as np
import pytest
import warp as wp

from dsmap.frame import Intrinsics
from dsmap.kernels.associate import associate_surfels
from dsmap.kernels.camera import make_camera
from dsmap.kernels.coverage import MapView, find_uncovered, thin_out
from dsmap.kernels.fuse import fuse_frame
from dsmap.kernels.predict import predict_model
from dsmap.kernels.types import ModelMaps, SurfelMap
from dsmap.tools.twins import scene as random_scene
from dsmap.tools.twins import surfels as reference_map

CAMERA, SHAPE = random_scene.CAMERA, (48, 64)
NEAR = make_camera(Intrinsics(160, 120, 130.0, 130.0, 79.5, 59.5))
"""A pixel of it is 3.8 mm wide at half a metre."""


def match_of(surfels, T, maps, camera=CAMERA) -> wp.array:
    match = wp.empty(maps.edge.shape, dtype=wp.int32, device="cpu")
    associate_surfels(surfels, camera, T, maps, match=match)
    return match


@pytest.mark.parametrize("has_view", [False, True])
def test_new_surfels_equal_their_twin(has_view):
    T, arrays = random_scene.pose(1), random_scene.frame_arrays(1)
    maps, surfels = random_scene.frame_maps(arrays), random_scene.surfel_map(T, count=800, seed=1)
    match, is_new = match_of(surfels, T, maps), wp.empty(SHAPE, dtype=wp.int32, device="cpu")
    seen, view = ModelMaps.empty(*SHAPE, "cpu"), None
    T_view = T.copy()
    T_view[:3, 3] += [0.02, -0.01, 0.03]
    predict_model(surfels, CAMERA, T_view, max_depth=3.0, maps=seen, resolution=0.07)
    if has_view:
        view = MapView(CAMERA, T_view, seen.vertex, seen.normal)
    find_uncovered(CAMERA, T, maps, match, 0.07, view, is_new)
    told = (CAMERA, T_view, seen.vertex.numpy(), seen.normal.numpy()) if has_view else None
    expected = reference_map.find_uncovered(CAMERA, T, arrays, match.numpy(), 0.07, told)
    assert 20 < expected.sum() < 1000
    assert (is_new.numpy() != expected).sum() <= 2, "borderline decisions in single precision"


def test_thinning_out_equals_its_twin():
    T, arrays = random_scene.pose(2), random_scene.frame_arrays(2)
    maps, surfels = random_scene.frame_maps(arrays), random_scene.surfel_map(T, seed=2)
    match = match_of(surfels, T, maps)
    expected = reference_map.thin_out(
        reference_map.arrays(surfels), CAMERA, arrays["vertex"], match.numpy(), 0.08
    )
    before = surfels.weight.numpy().copy()
    thin_out(surfels, CAMERA, maps, match, 0.08)
    np.testing.assert_array_equal(surfels.weight.numpy(), expected)
    assert 20 < (before != expected).sum() < 0.5 * (before > 0).sum()


@pytest.mark.parametrize("seed", range(2))
def test_views_of_coarse_maps_equal_their_twin(seed):
    T = random_scene.pose(seed)
    surfels = random_scene.surfel_map(T, count=600, seed=seed)
    maps = ModelMaps.empty(*SHAPE, "cpu")
    predict_model(surfels, CAMERA, T, max_depth=3.0, maps=maps, stable_weight=10.0, resolution=0.06)
    expected = reference_map.render_index(
        reference_map.arrays(surfels), CAMERA, T, max_depth=3.0, stable_weight=10.0, resolution=0.06
    )
    assert (maps.index.numpy() != expected).sum() <= 5


def near_frame(handle: bool):
    """A wall at 0.8 m; before it, at 0.5 m, a bar 5 mm wide."""
    depth = np.full((NEAR.height, NEAR.width), 0.8, np.float32)
    if handle:
        depth[20:100, 80:82] = 0.5
    view = reference_map.rays(NEAR)
    n = np.tile(np.float32([0, 0, -1]), (*depth.shape, 1))
    arrays = {"depth": depth, "vertex": (view * depth[..., None]).astype(np.float32), "normal": n}
    arrays |= {"intensity": np.zeros_like(depth), "radius": (1.4142 * depth / NEAR.fx).astype(np.float32)}
    arrays |= {"colour": n * 0 + 0.5, "edge": np.zeros(depth.shape, np.uint8)}
    return random_scene.frame_maps(arrays)


def mapped(resolution: float, handle: bool = False, frames: int = 6):
    """Surfels of frames from a camera that moves sideways, and the view from its last place."""
    surfels, maps, seen = SurfelMap.empty("cpu"), near_frame(handle), ModelMaps.empty(120, 160, "cpu")
    view = None
    for k in range(frames):
        T = np.eye(4)
        match = match_of(surfels, T, maps, NEAR)
        fuse_frame(surfels, NEAR, T, maps, match, time=k, resolution=resolution, view=view)
        predict_model(surfels, NEAR, T, max_depth=3.0, maps=seen, resolution=resolution)
        view = MapView(NEAR, T, seen.vertex, seen.normal)
    return surfels, seen


def test_a_wall_gets_as_many_surfels_as_its_resolution_asks_and_no_holes():
    surfels, seen = mapped(0.02)
    area = (160 * 0.8 / 130) * (120 * 0.8 / 130)
    assert 0.5 * area / 0.02**2 < surfels.count < 1.3 * area / 0.02**2
    assert (seen.index.numpy() >= 0).all()
    assert surfels.radius.numpy()[: surfels.count].min() >= 0.0199
    np.testing.assert_allclose(seen.vertex.numpy()[..., 2], 0.8, atol=1e-4)


def test_a_view_from_nearer_and_from_the_side_has_no_holes_either():
    surfels, seen = mapped(0.02)
    T = np.eye(4)
    T[:3, :3] = [[0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, 0.8]]
    T[:3, 3] = [-0.35, 0.0, 0.4]  # 0.4 m and more from the wall
    predict_model(surfels, NEAR, T, max_depth=3.0, maps=seen, resolution=0.02)
    x = (T[:3, :3] @ (reference_map.rays(NEAR)[..., None])).squeeze(-1)
    hit = T[:3, 3] + x * ((0.8 - T[2, 3]) / x[..., 2:])
    inside = (np.abs(hit[..., 0]) < 0.45) & (np.abs(hit[..., 1]) < 0.33) & (x[..., 2] > 0)
    assert inside.sum() > 3000
    assert (seen.index.numpy()[inside] >= 0).mean() > 0.999


def test_a_bar_of_five_millimetres_stays_in_a_map_of_eight():
    surfels, seen = mapped(0.008, handle=True)
    assert (np.abs(seen.vertex.numpy()[20:100, 80:82, 2] - 0.5) < 0.01).mean() > 0.95


def test_two_surfels_at_one_place_become_one():
    surfels, _ = mapped(0.02)
    count, maps = surfels.count, near_frame(False)
    one = {name: value.copy() for name, value in surfels.numpy().items()}
    surfels.reserve(2 * count)
    surfels.count = 2 * count
    for name, value in surfels.numpy().items():
        value[count:] = one[name]
    surfels.numpy()["position"][count:, 0] += 0.007
    surfels.numpy()["weight"][count:] *= 0.5
    for _ in range(2):
        thin_out(surfels, NEAR, maps, match_of(surfels, np.eye(4), maps, NEAR), 0.02)
    assert (surfels.numpy()["weight"] > 0).sum() < 1.1 * count
