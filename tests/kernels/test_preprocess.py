"""Preprocessing kernels against their NumPy twins."""

import numpy as np
import pytest
import warp as wp

from dsmap.frame import Intrinsics
from dsmap.kernels import filters, odometry, preprocess
from dsmap.kernels.camera import make_camera
from dsmap.tools.twins import images as reference

INTRINSICS = Intrinsics(48, 36, 40.0, 41.0, 23.2, 17.9)
CAMERA = make_camera(INTRINSICS)
CPU = wp.get_device("cpu")


def scene(seed: int = 0) -> np.ndarray:
    """Depth of a wavy wall with a box before it, with holes."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:36, :48]
    depth = 2.0 + 0.02 * x + 0.1 * np.sin(y / 5)
    depth[10:22, 14:30] = 1.2
    depth[rng.random(depth.shape) < 0.05] = 0
    return depth.astype(np.float32)


def on_cpu(array: np.ndarray, dtype) -> wp.array:
    return wp.array(array.astype(np.float32), dtype=dtype, device="cpu")


def test_bilateral_bodies_agree_with_the_twin():
    depth = scene() + np.random.default_rng(1).normal(0, 0.01, (36, 48)).astype(np.float32) * (scene() > 0)
    expected = reference.bilateral(depth, preprocess.SIGMA_SPACE, preprocess.SIGMA_RANGE)
    by_cv2 = preprocess.smooth_depth(depth, CPU).numpy()
    by_warp = wp.zeros((36, 48), dtype=float, device="cpu")
    filters.bilateral(on_cpu(depth, float), preprocess.SIGMA_SPACE, preprocess.SIGMA_RANGE, by_warp)
    np.testing.assert_allclose(by_warp.numpy(), expected, atol=2e-6)
    np.testing.assert_allclose(by_cv2, expected, atol=1e-3)  # cv2 tabulates the range weight
    assert ((by_cv2 == 0) == (depth == 0)).all()


def test_surface_maps():
    depth = scene()
    smooth = preprocess.smooth_depth(depth, CPU).numpy()
    rgb = np.zeros((36, 48, 3), np.uint8)
    maps = preprocess.preprocess(rgb, depth, [CAMERA], CPU)[0]
    vertex, normal, radius, edge = reference.surface(CAMERA, smooth)
    np.testing.assert_allclose(maps.vertex.numpy(), vertex, atol=1e-5)
    np.testing.assert_allclose(maps.normal.numpy(), normal, atol=1e-4)
    np.testing.assert_allclose(maps.radius.numpy(), radius, atol=1e-5)
    assert (maps.edge.numpy() == edge).all()
    assert edge[9:12, 20].any() and not edge[3:7, 5:10].any()
    assert (normal[..., 2] <= 0).all(), "normals point towards the camera"


@pytest.mark.parametrize("focal", [40.0, 525.0])
def test_normals_reach_further_where_depth_is_noisier(focal):
    """The reach grows with depth and focal length, and stops at steps."""
    camera = make_camera(Intrinsics(48, 36, focal, focal, 23.2, 17.9))
    depth = scene(1) * (1.6 if focal > 100 else 1.0)
    maps = preprocess.preprocess(np.zeros((36, 48, 3), np.uint8), depth, [camera], CPU)[0]
    smooth = preprocess.smooth_depth(depth, CPU).numpy()
    np.testing.assert_allclose(maps.normal.numpy(), reference.surface(camera, smooth)[1], atol=3e-4)


def test_a_slanted_plane_has_no_edges():
    y, x = np.mgrid[:36, :48]
    ray = reference.rays(CAMERA)
    depth = (1.0 / (0.9 - 0.7 * ray[..., 1])).astype(np.float32)  # a floor seen at a low angle
    maps = preprocess.preprocess(np.zeros((36, 48, 3), np.uint8), depth, [CAMERA], CPU)[0]
    assert maps.edge.numpy().mean() < 0.02


def test_half_surface_and_gradient():
    rng = np.random.default_rng(3)
    vertex, normal, _, _ = reference.surface(CAMERA, scene())
    light = rng.random((36, 48))
    got = preprocess.half_surface(on_cpu(vertex, wp.vec3), on_cpu(normal, wp.vec3), on_cpu(light, float))
    for ours, expected in zip(got, reference.half_surface(vertex, normal, light), strict=True):
        np.testing.assert_allclose(ours.numpy(), expected, atol=1e-5)
    for mask in (None, vertex):
        ours = odometry.gradient(on_cpu(light, float), None if mask is None else on_cpu(mask, wp.vec3))
        np.testing.assert_allclose(ours.numpy(), reference.gradient(light, mask), atol=1e-6)


def test_pyramid_pixels_stay_on_their_rays():
    """A level's vertex lies on the ray of its own pixel: the half-pixel convention is right."""
    intrinsics = Intrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
    cameras = [make_camera(intrinsics.scaled(64 >> level, 48 >> level)) for level in range(3)]
    y, x = np.mgrid[:48, :64]
    depth = (2 + 0.002 * x + 0.003 * y).astype(np.float32)
    rgb = np.repeat((x * 4)[..., None], 3, axis=2).astype(np.uint8)
    for camera, maps in zip(cameras, preprocess.preprocess(rgb, depth, cameras, CPU), strict=True):
        v = maps.vertex.numpy()
        yy, xx = np.mgrid[: camera.height, : camera.width]
        u = camera.fx * v[..., 0] / v[..., 2] + camera.cx
        np.testing.assert_allclose(u, xx, atol=0.01)
        # Intensity follows the same convention: it is linear in x, so the level's value tells its position.
        scale = 64 / camera.width
        expected = ((xx + 0.5) * scale - 0.5) * 4 / 255
        np.testing.assert_allclose(maps.intensity.numpy(), expected, atol=0.01)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0, 9.0, 0.01])
def test_clean_depth_drops_what_is_out_of_range(bad):
    depth = scene()
    depth[5, 5] = bad
    clean = preprocess.depth_in_range(depth, 0.3, 3.5)
    assert clean[5, 5] == 0 and np.isfinite(clean).all() and clean.dtype == np.float32


def test_cuda_bodies_of_colour_and_intensity_match_opencv():
    rgb = np.random.default_rng(0).integers(0, 256, (36, 48, 3), dtype=np.uint8)
    colour, light, half = (wp.zeros(shape, dtype=t, device="cpu") for shape, t in
                           (((36, 48), wp.vec3), ((36, 48), float), ((18, 24), float)))  # fmt: skip
    filters.colour(wp.array(rgb, dtype=wp.uint8, device="cpu"), colour)
    filters.intensity(colour, light)
    filters.half(light, half)
    expected = preprocess.intensity_map(preprocess.colour_map(rgb, CPU))
    np.testing.assert_allclose(colour.numpy(), rgb / 255, atol=1e-6)
    np.testing.assert_allclose(light.numpy(), expected.numpy(), atol=1e-5)
    np.testing.assert_allclose(half.numpy(), preprocess.half_image(expected).numpy(), atol=1e-5)
