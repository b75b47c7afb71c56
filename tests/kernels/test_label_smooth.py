"""Probabilities averaged over a surface: against the twin, and not across depth or bends."""

import numpy as np
import pytest
import warp as wp

from dsmap.frame import Intrinsics
from dsmap.kernels.camera import make_camera
from dsmap.kernels.label import update_labels
from dsmap.kernels.label_smooth import smooth_probabilities
from dsmap.tools.twins import images as reference
from dsmap.tools.twins import scene as random_scene
from dsmap.tools.twins import surfels as reference_map

CAMERA = random_scene.CAMERA
SMALL = make_camera(Intrinsics(48, 36, 40.0, 41.0, 23.2, 17.9))


def smoothed(p: np.ndarray, camera, depth: np.ndarray, radius: float = 0.15) -> np.ndarray:
    vertex, normal = surface(camera, depth)
    arrays = [wp.array(a.astype(np.float32), dtype=wp.vec3, device="cpu") for a in (vertex, normal)]
    return smooth_probabilities(p, camera, *arrays, radius=radius).numpy()


def surface(camera, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return reference.surface(camera, depth)[:2]


@pytest.mark.parametrize("size", [(36, 48), (18, 24), (20, 50)])
def test_smoothing_equals_its_twin(size):
    rng = np.random.default_rng(5)
    y, x = np.mgrid[:36, :48]
    depth = 1.5 + 0.01 * x + 0.05 * np.sin(y / 4)
    depth[10:22, 14:30] = 1.1
    depth[rng.random(depth.shape) < 0.1] = 0
    p = random_scene.softmax_image(2, *size)
    expected = reference_map.smooth_probabilities(p, SMALL, *surface(SMALL, depth), 0.15)
    found = smoothed(p, SMALL, depth)
    # A tap may round to the neighbour where float32 and float64 differ: next to nothing of the image.
    close = np.isclose(found, expected, atol=2e-4, equal_nan=True).all(axis=-1)
    assert close.mean() > 0.99
    assert np.nanmax(np.abs(found - p)) > 0.1


def test_speckles_go_and_depth_steps_stay():
    depth = np.full((36, 48), 2.0)
    depth[:, 24:] = 1.5
    truth = np.where(np.arange(48) < 24, 12, 9) * np.ones((36, 1), np.int64)
    rng = np.random.default_rng(0)
    shown = np.where(rng.random(truth.shape) < 0.25, 4, truth)
    p = 0.95 * np.eye(14, dtype=np.float32)[shown] + np.float32(0.05 / 14)
    found = smoothed(p, SMALL, depth, radius=0.2).argmax(axis=-1)
    inner = (slice(4, -4), [*range(4, 22), *range(26, 44)])
    assert (shown == truth)[inner].mean() < 0.8
    assert (found == truth)[inner].mean() > 0.98, "also next to the step: nothing is averaged across it"


def test_rows_still_sum_to_1_and_no_depth_changes_nothing():
    p = np.random.default_rng(1).dirichlet(np.ones(14), (36, 48)).astype(np.float32)
    np.testing.assert_allclose(smoothed(p, SMALL, np.full((36, 48), 2.0)).sum(-1), 1, atol=1e-5)
    np.testing.assert_array_equal(smoothed(p, SMALL, np.zeros((36, 48))), p)


def test_the_result_is_what_label_fusion_takes():
    T, frame = random_scene.pose(1), random_scene.frame_arrays(1)
    maps, p = random_scene.frame_maps(frame), random_scene.softmax_image(0, 48, 64)
    smooth = smooth_probabilities(p, CAMERA, maps.vertex, maps.normal, radius=0.1)
    by_kernel, by_hand = (random_scene.surfel_map(T, count=800, seed=1) for _ in range(2))
    update_labels(by_kernel, CAMERA, T, maps, smooth)
    update_labels(by_hand, CAMERA, T, maps, smooth.numpy())
    np.testing.assert_array_equal(by_kernel.numpy()["evidence"], by_hand.numpy()["evidence"])
