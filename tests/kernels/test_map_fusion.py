"""Association, fusion and clean-up: against their NumPy twins, and over a moving camera."""

import dataclasses

import numpy as np
import pytest
import warp as wp

from dsmap.kernels import launch
from dsmap.kernels.associate import associate_surfels
from dsmap.kernels.compact import compact
from dsmap.kernels.fuse import fuse_frame
from dsmap.kernels.index_map import render_index
from dsmap.kernels.label import update_labels
from dsmap.kernels.pixel_min import TAKEN
from dsmap.kernels.prune import prune
from dsmap.kernels.reactivate import reactivate
from dsmap.kernels.types import SurfelMap
from dsmap.tools.twins import scene as random_scene
from dsmap.tools.twins import surfels as reference_map

CAMERA, TIME = random_scene.CAMERA, random_scene.TIME
SHAPE = (CAMERA.height, CAMERA.width)


def new_match() -> wp.array:
    return wp.full(SHAPE, -7, dtype=wp.int32, device="cpu")


def scene(seed: int):
    """Pose, surfels, frame in NumPy, frame in Warp."""
    T, frame = random_scene.pose(seed), random_scene.frame_arrays(seed)
    return T, random_scene.surfel_map(T, seed=seed), frame, random_scene.frame_maps(frame)


def matched(surfels, T, maps, **options) -> wp.array:
    match = new_match()
    associate_surfels(surfels, CAMERA, T, maps, match=match, **options)
    return match


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("options", [{}, {"max_ray_distance": 0.02, "max_angle": 0.3, "t_min": 20}])
def test_association_equals_its_twin(seed, options):
    T, surfels, frame, maps = scene(seed)
    match = matched(surfels, T, maps, **options).numpy()
    expected = reference_map.associate_surfels(reference_map.arrays(surfels), CAMERA, T, frame, **options)
    assert (expected >= 0).sum() > 200 and (expected == TAKEN).sum() > 20
    assert (match != expected).sum() <= 2
    chosen = match[match >= 0]
    assert len(np.unique(chosen)) == len(chosen), "a surfel serves two pixels"


def test_the_depth_gate_widens_with_depth_squared():
    T, surfels, frame, maps = scene(1)
    narrow = matched(surfels, T, maps, max_ray_distance=0.005).numpy()
    wide = matched(surfels, T, maps, max_ray_distance=0.005, max_ray_distance_z2=0.02).numpy()
    s = reference_map.arrays(surfels)
    expected = reference_map.associate_surfels(
        s, CAMERA, T, frame, max_ray_distance=0.005, max_ray_distance_z2=0.02
    )
    assert (wide >= 0).sum() > 1.5 * (narrow >= 0).sum()
    assert (wide != expected).sum() <= 2


@pytest.mark.parametrize(("seed", "max_weight"), [(0, np.inf), (1, 12.0)])
def test_fusion_equals_its_twin(seed, max_weight):
    T, surfels, frame, maps = scene(seed)
    before = reference_map.arrays(surfels)
    match = matched(surfels, T, maps)
    inserted = fuse_frame(surfels, CAMERA, T, maps, match, time=TIME, max_weight=max_weight)
    expected = reference_map.fuse_frame(
        before, CAMERA, T, frame, match.numpy(), time=TIME, max_weight=max_weight
    )
    assert surfels.count == len(expected["weight"]) == len(before["weight"]) + inserted
    assert 300 < inserted < 0.9 * np.prod(SHAPE)
    for name, value in surfels.numpy().items():
        np.testing.assert_allclose(value, expected[name], atol=3e-6, rtol=1e-5, err_msg=name)


def test_a_coarse_sample_confirms_but_does_not_move_a_surfel():
    T, surfels, frame, _ = scene(2)
    maps = random_scene.frame_maps(frame | {"radius": np.full(SHAPE, 1.0, np.float32)})
    before = reference_map.arrays(surfels)
    match = matched(surfels, T, maps)
    fuse_frame(surfels, CAMERA, T, maps, match, time=TIME)
    after, i = surfels.numpy(), match.numpy()[match.numpy() >= 0]
    np.testing.assert_allclose(after["position"][i], before["position"][i], atol=1e-6)
    assert (after["weight"][i] > before["weight"][i]).all() and (after["t_updated"][i] == TIME).all()


def test_a_noisy_normal_neither_moves_the_surfel_nor_adds_a_second_one():
    T, maps = flat_frame(np.random.default_rng(0))
    surfels = SurfelMap.empty("cpu")
    fuse_frame(surfels, CAMERA, T, maps, matched(surfels, T, maps), time=0)
    count, before = surfels.count, reference_map.arrays(surfels)
    maps.normal.numpy()[:] = np.float32([np.sin(0.9), 0, -np.cos(0.9)])
    match = matched(surfels, T, maps)
    assert (match.numpy() == TAKEN).all()
    assert fuse_frame(surfels, CAMERA, T, maps, match, time=1) == 0
    np.testing.assert_allclose(surfels.numpy()["weight"], before["weight"])
    maps.normal.numpy()[:] = np.float32([0, 0, 1])  # another surface: the back of a thin wall
    assert fuse_frame(surfels, CAMERA, T, maps, matched(surfels, T, maps), time=1) == count


def flat_frame(rng, noise: float = 0.0, x_offset: float = 0.0):
    """A wall at z = 1.5 m seen without rotation from (x_offset, 0, 0)."""
    depth = (1.5 + rng.normal(0, noise, SHAPE)).astype(np.float32)
    view = reference_map.rays(CAMERA).astype(np.float32)
    maps = {
        "depth": depth,
        "vertex": view * depth[..., None],
        "normal": np.tile(np.float32([0, 0, -1]), (*SHAPE, 1)),
        "intensity": np.zeros(SHAPE, np.float32),
        "radius": (np.sqrt(2) * depth / CAMERA.fx).astype(np.float32),
        "colour": np.full((*SHAPE, 3), 0.5, np.float32),
        "edge": np.zeros(SHAPE, np.uint8),
    }
    T = np.eye(4)
    T[0, 3] = x_offset
    return T, random_scene.frame_maps(maps)


def test_repeated_noisy_frames_average_out_and_add_no_copies():
    rng = np.random.default_rng(0)
    surfels = SurfelMap.empty("cpu", capacity=16)
    for time in range(25):
        T, maps = flat_frame(rng, noise=0.005)
        fuse_frame(surfels, CAMERA, T, maps, matched(surfels, T, maps), time=time)
    s = surfels.numpy()
    assert surfels.count == np.prod(SHAPE), "one surfel a pixel"
    assert abs(s["position"][:, 2].std() - 0.005 / 5) < 1e-4, "25 samples shrink the noise five times"
    weights = [reference_map.sample_weight(CAMERA, *at) for at in np.ndindex(SHAPE)]
    np.testing.assert_allclose(s["weight"], 25 * np.array(weights), rtol=1e-4)


def test_a_moving_camera_keeps_about_one_surfel_a_pixel():
    rng, surfels = np.random.default_rng(1), SurfelMap.empty("cpu")
    steps = 30
    for time in range(steps):  # 0.37 pixels a frame
        T, maps = flat_frame(rng, x_offset=time * 0.37 * 1.5 / CAMERA.fx)
        fuse_frame(surfels, CAMERA, T, maps, matched(surfels, T, maps), time=time)
    area = CAMERA.height * (CAMERA.width + 0.37 * (steps - 1))
    assert 0.95 * area < surfels.count < 1.3 * area


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "options", [{}, {"t_min": 25, "max_unseen": 100, "margin_z2": 0.05, "max_depth": 1.55}]
)
def test_clean_up_equals_its_twin(seed, options):
    T, surfels, frame, maps = scene(seed)
    match = matched(surfels, T, maps)
    winners = match.numpy()[match.numpy() >= 0]
    surfels.t_updated.numpy()[winners] = TIME  # as fusing does
    arrays = reference_map.arrays(surfels)
    expected = reference_map.prune(
        arrays, CAMERA, T, frame["depth"], frame["edge"], match.numpy(), time=TIME, **options
    )
    alone = np.full(SHAPE, -1)
    without = reference_map.prune(
        arrays, CAMERA, T, frame["depth"], frame["edge"], alone, time=TIME, **options
    )
    assert (expected == 0).sum() > (without == 0).sum(), "the scene holds duplicates"
    alive_before = count_alive(surfels)
    dead = prune(surfels, CAMERA, T, maps, match, time=TIME, **options)
    weight = surfels.weight.numpy()[: surfels.count]
    np.testing.assert_allclose(weight, expected, rtol=1e-6)
    assert dead == alive_before - count_alive(surfels) > 0


def test_one_bad_depth_image_does_not_erase_a_stable_map_but_an_opened_door_does():
    rng, surfels = np.random.default_rng(2), SurfelMap.empty("cpu")
    for time in range(40):
        T, maps = flat_frame(rng)
        fuse_frame(surfels, CAMERA, T, maps, matched(surfels, T, maps), time=time)
    surfels.weight.numpy()[: surfels.count] += 10  # all are stable
    far = dataclasses.replace(maps, depth=wp.full(SHAPE, 3.0, dtype=wp.float32, device="cpu"))
    nothing = matched(surfels, T, maps)
    nothing.fill_(-1)
    assert prune(surfels, CAMERA, T, far, nothing, time=40) == 0
    dead = [prune(surfels, CAMERA, T, far, nothing, time=time) for time in range(41, 61)]
    assert sum(dead) == surfels.count


def test_the_two_walls_of_a_closed_loop_become_one():
    """A wall mapped long ago, mapped again 8 mm beside it: once the old one is active, one of every pair dies."""
    rng, surfels, now = np.random.default_rng(3), SurfelMap.empty("cpu"), 500
    for first, shift in ((0, 0.0), (now, 0.008)):
        for time in range(first, first + 20):
            T, maps = flat_frame(rng, noise=0.002)
            T[2, 3] = shift
            fuse_frame(surfels, CAMERA, T, maps, matched(surfels, T, maps, t_min=first), time=time)
    count = np.prod(SHAPE)
    assert surfels.count == 2 * count, "inactive surfels get no matches"
    vertex = maps.vertex  # of the inactive view and of the active one: they agree
    woken = reactivate(surfels, CAMERA, np.eye(4), vertex, vertex, time=now + 20, t_min=now, distance=0.05)
    assert woken == count
    for time in range(now + 21, now + 41):
        T, maps = flat_frame(rng, noise=0.002, x_offset=0.3 * (time - now - 21) * 1.5 / CAMERA.fx)
        match = matched(surfels, T, maps, t_min=now)
        fuse_frame(surfels, CAMERA, T, maps, match, time=time)
        prune(surfels, CAMERA, T, maps, match, time=time, t_min=now)
    s = {name: array[surfels.numpy()["weight"] > 0] for name, array in surfels.numpy().items()}
    in_view = (np.abs(s["position"][:, 0]) < 0.5) & (np.abs(s["position"][:, 1]) < 0.5)
    per_pixel = in_view.sum() * (1.5 / CAMERA.fx) * (1.5 / CAMERA.fy)
    assert 0.7 < per_pixel < 1.25, "about one surfel a pixel, on one square metre"
    assert (s["t_created"][in_view] < now).mean() > 0.4, "what was there first is not thrown away"


def test_compaction_keeps_the_living_in_order():
    T, surfels, _, _ = scene(3)
    before = reference_map.arrays(surfels)
    alive = before["weight"] > 0
    assert compact(surfels) == count_of(~alive) and compact(surfels) == 0
    assert surfels.count == count_of(alive) == count_alive(surfels)
    for name, value in surfels.numpy().items():
        np.testing.assert_array_equal(value, before[name][alive], err_msg=name)
    surfels.weight.zero_()
    compact(surfels)
    assert surfels.count == 0 and compact(surfels) == 0


def count_alive(surfels: SurfelMap) -> int:
    return count_of(surfels.numpy()["weight"] > 0)


def count_of(mask: np.ndarray) -> int:
    return int(np.count_nonzero(mask))


def test_insertion_grows_the_map_and_keeps_what_was_there():
    T, _, frame, maps = scene(0)
    surfels = random_scene.surfel_map(T, count=500, capacity=500)
    before = reference_map.arrays(surfels)
    nowhere = wp.full(SHAPE, -1, dtype=wp.int32, device="cpu")
    inserted = fuse_frame(surfels, CAMERA, T, maps, nowhere, time=TIME)
    usable = (frame["depth"] > 0) & (frame["edge"] == 0) & frame["normal"].any(-1)
    assert inserted == count_of(usable) and surfels.count == 500 + inserted <= surfels.capacity
    for name, value in surfels.numpy().items():
        np.testing.assert_allclose(value[:500], before[name], rtol=1e-6, err_msg=name)
    R, t = T[:3, :3], T[:3, 3]
    positions = frame["vertex"][usable] @ R.T + t
    np.testing.assert_allclose(surfels.numpy()["position"][500:], positions, atol=1e-5)
    assert not surfels.numpy()["evidence"][500:].any() and not surfels.numpy()["label"][500:].any()


def test_the_number_of_threads_changes_nothing(monkeypatch):
    """Five frames through every kernel, on one thread and in three slices: bit for bit the same map."""
    monkeypatch.setattr(launch, "_SMALL", 0)
    monkeypatch.setattr(launch, "CPU_BLOCK", 64)
    probabilities = np.random.default_rng(0).dirichlet(np.ones(14), (24, 32)).astype(np.float32)
    results = []
    for threads in ("1", "3"):
        monkeypatch.setenv("DSMAP_THREADS", threads)
        surfels, match, index = SurfelMap.empty("cpu", capacity=100), new_match(), new_match()
        for time in range(5):
            T, frame = random_scene.pose(0), random_scene.frame_arrays(time)
            T[:3, 3] += 0.01 * time
            maps = random_scene.frame_maps(frame)
            associate_surfels(surfels, CAMERA, T, maps, match=match)
            fuse_frame(surfels, CAMERA, T, maps, match, time=time)
            prune(surfels, CAMERA, T, maps, match, time=time)
            compact(surfels)
            update_labels(surfels, CAMERA, T, maps, probabilities)
            render_index(surfels, CAMERA, T, max_depth=3.0, index=index)
        results.append([match.numpy().copy(), index.numpy().copy(), *reference_map.arrays(surfels).values()])
    for one, three in zip(*results, strict=True):
        np.testing.assert_array_equal(one, three)
