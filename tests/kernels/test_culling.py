"""Culling and compaction: the same map, bit for bit, as walking every surfel; and what they leave out."""

import numpy as np
import pytest
import warp as wp
from corner_frames import config, frames

from dsmap.frame import Frame
from dsmap.fusion.labels.semantics import GroundTruthSegmenter
from dsmap.fusion.lie import exp_se3
from dsmap.fusion.mapper import Mapper
from dsmap.kernels.camera import make_camera
from dsmap.kernels.compact import DEAD_SHARE, MIN_DEAD, Compaction, compact, sweep_from
from dsmap.kernels.culling import Blocks, frustum
from dsmap.kernels.index_map import render_index
from dsmap.kernels.launch import BLOCK, all_blocks
from dsmap.kernels.types import SurfelMap
from dsmap.tools.twins import scene as random_scene
from dsmap.tools.twins.corner import INTRINSICS, room

STABLE = 10.0


def box_map(rng, count: int) -> SurfelMap:
    """Clusters of surfels in memory order: as the frames of a walk insert them."""
    surfels = SurfelMap.empty("cpu", capacity=count)
    surfels.count = count
    s = surfels.numpy()
    steps = rng.normal(0, 0.5, (-(-count // 150), 3))
    centre = np.repeat(np.cumsum(steps, axis=0), 150, axis=0)[:count]
    s["position"][:] = centre + rng.normal(0, 0.3, (count, 3))
    s["normal"][:] = rng.normal(size=(count, 3))
    s["normal"][:] /= np.linalg.norm(s["normal"], axis=1, keepdims=True)
    s["radius"][:] = rng.uniform(0.005, 0.05, count)
    s["weight"][:] = np.where(rng.random(count) < 0.2, 0, rng.uniform(0.3, 20, count))
    s["t_updated"][:] = rng.integers(0, 40, count)
    return surfels


def living(surfels: SurfelMap) -> dict[str, np.ndarray]:
    """The arrays of living surfels: what a map is, however far it has been compacted."""
    s = surfels.numpy()
    return {name: array[s["weight"] > 0] for name, array in s.items()}


def assert_same(one: dict, other: dict) -> None:
    for name in one:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


def in_view(surfels: SurfelMap, camera, T, max_depth: float) -> np.ndarray:
    """Twin of the frustum test a surfel: alive, in front, near enough, inside the image and 3 px around it."""
    s = surfels.numpy()
    p = (s["position"].astype(np.float64) - T[:3, 3]) @ T[:3, :3]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = camera.fx * p[:, 0] / p[:, 2] + camera.cx
        v = camera.fy * p[:, 1] / p[:, 2] + camera.cy
    inside = (u >= -3) & (u <= camera.width + 3) & (v >= -3) & (v <= camera.height + 3)
    return (s["weight"] > 0) & (p[:, 2] > 0) & (p[:, 2] <= max_depth) & inside


@pytest.mark.parametrize("seed", range(5))
def test_no_surfel_in_view_is_left_out_and_most_others_are(seed):
    surfels = box_map(np.random.default_rng(seed), 30_000)
    blocks, camera, T = Blocks(surfels, STABLE), random_scene.CAMERA, random_scene.pose(seed)
    visible = blocks.visible(camera, T, 3.0).numpy()
    assert (np.diff(visible) > 0).all()
    seen = np.flatnonzero(in_view(surfels, camera, T, 3.0))
    assert set(seen // BLOCK) <= set(visible)
    assert len(visible) < 0.5 * len(all_blocks(surfels.count, "cpu"))
    planes = frustum(camera, T, 3.0)
    p = surfels.numpy()["position"][seen]
    assert (p @ planes[:, :3].T + planes[:, 3] >= 0).all()


@pytest.mark.parametrize("seed", range(3))
def test_the_index_map_of_the_visible_blocks_is_that_of_the_whole_map(seed):
    surfels = box_map(np.random.default_rng(seed), 30_000)
    camera, T = random_scene.CAMERA, random_scene.pose(seed)
    index = [wp.empty((camera.height, camera.width), dtype=wp.int32, device="cpu") for _ in range(2)]
    for image, visible in zip(index, (None, Blocks(surfels, STABLE).visible(camera, T, 3.0)), strict=True):
        render_index(surfels, camera, T, max_depth=3.0, index=image, visible=visible)
    assert (index[0].numpy() >= 0).any()
    np.testing.assert_array_equal(index[0].numpy(), index[1].numpy())


def test_blocks_follow_growth_moves_and_forgetting():
    rng = np.random.default_rng(0)
    surfels = box_map(rng, 5_000)
    blocks, camera, T = Blocks(surfels, STABLE), random_scene.CAMERA, np.eye(4)
    blocks.visible(camera, T, 3.0)
    surfels.count = 4_000  # cut short, then grown with other surfels
    assert (
        len(blocks.dead) == -(-4_000 // BLOCK) and blocks.dead.sum() == (surfels.numpy()["weight"] == 0).sum()
    )
    surfels.count = 5_000
    surfels.numpy()["position"][4_000:] = [0, 0, 1]
    surfels.numpy()["weight"][4_000:] = 1
    assert set(range(4_000 // BLOCK, 5_000 // BLOCK + 1)) <= set(blocks.visible(camera, T, 3.0).numpy())
    surfels.numpy()["position"][:] = [0, 0, 1]
    blocks.measure(wp.array(np.array([0], np.int32), device="cpu"))
    before = len(blocks.visible(camera, T, 3.0))
    blocks.forget()
    assert before < len(blocks.visible(camera, T, 3.0)) == -(-5_000 // BLOCK)
    assert len(Blocks(SurfelMap.empty("cpu"), STABLE).visible(camera, T, 3.0)) == 0


def test_blocks_with_overdue_surfels_are_cleaned_wherever_they_are():
    surfels = box_map(np.random.default_rng(1), 10_000)
    surfels.numpy()["position"][:] = [0, 0, -5]
    surfels.numpy()["t_updated"][:] = 30
    surfels.numpy()["t_updated"][[300, 301]], surfels.numpy()["weight"][[300, 301]] = 9, (2.0, 15.0)
    blocks = Blocks(surfels, STABLE)
    nothing = blocks.visible(random_scene.CAMERA, np.eye(4), 3.0)
    assert len(nothing) == 0
    assert len(blocks.to_clean(nothing, 29, 20)) == 0
    assert blocks.to_clean(nothing, 30, 20).numpy().tolist() == [300 // BLOCK]
    assert len(blocks.to_clean(nothing, 51, 20)) == -(-10_000 // BLOCK)


def test_a_sweep_removes_the_dead_in_bounded_steps_and_keeps_the_order():
    surfels = box_map(np.random.default_rng(2), 40_000)
    surfels.weight.numpy()[:20_000] += 1  # the older half has no dead
    expected, blocks = living(surfels), Blocks(surfels, STABLE)
    sweep, steps, capacity = Compaction(surfels, blocks, rows=3_000), 0, surfels.capacity
    while sweep.step():
        steps += 1
        assert_same(living(surfels), expected)
        assert blocks.dead.sum() == (surfels.numpy()["weight"] == 0).sum()
        if steps == 3:  # the map grows meanwhile
            m = surfels
            m.reserve(m.count + 500)
            m.weight.numpy()[m.count : m.count + 500] = np.where(np.arange(500) % 3, 5, 0)
            m.count += 500
            expected = living(m)
    assert 7 <= steps <= 9 and surfels.count == len(expected["weight"]) < capacity
    assert sweep_from(blocks.dead) is None


def test_where_a_sweep_starts():
    dead = np.zeros(200, int)
    assert sweep_from(dead) is None
    dead[190:] = 200
    assert sweep_from(dead) == 190
    dead[150] = 1  # the longest end that still pays, from its first dead surfel
    rows = 50 * BLOCK
    assert sweep_from(dead) == (150 if dead.sum() >= DEAD_SHARE * rows else 190)
    assert sweep_from(np.full(3, MIN_DEAD // 3 - 1)) is None


@pytest.mark.parametrize("every", [1, 3])
def test_a_run_is_the_same_with_and_without_culling(every, monkeypatch):
    """A camera that turns away and comes back, with labels, clean-up, ageing out of view and compaction."""
    monkeypatch.setattr("dsmap.kernels.compact.MIN_DEAD", 50)
    turns = [exp_se3(np.array([0, 0, 0, 0, -0.1 * min(i, 34 - i), 0])) for i in range(35)]
    sequence = [Frame(i, i / 30, *room(T), T, np.full((72, 96), 5, np.uint8)) for i, T in enumerate(turns)]
    results = []
    for culled in (True, False):
        options = config(poses="given")
        options.surfels.clean_every, options.surfels.unstable_frames = every, 6
        mapper = Mapper(options, INTRINSICS, GroundTruthSegmenter())
        if not culled:
            mapper.model.views.visible = lambda T, m=mapper.surfels: all_blocks(m.count, "cpu")
        sizes, shares = [], []
        for frame in sequence:
            mapper.step(frame)
            sizes.append((mapper.surfels.numpy()["weight"] > 0).sum())
            shares.append(len(mapper.model.integrator.visible) * BLOCK / mapper.surfels.count)
        compact(mapper.surfels)
        assert (min(shares) < 0.7) == culled, "the sequence leaves something out of view"
        results.append((living(mapper.surfels), sizes, mapper.model.maps.vertex.numpy().copy()))
    assert results[0][1] == results[1][1], "surfels die in the same frame"
    assert_same(results[0][0], results[1][0])
    np.testing.assert_array_equal(results[0][2], results[1][2])


def test_a_frame_walks_what_it_sees():
    mapper = Mapper(config(poses="given"), INTRINSICS)
    first = frames(1)[0]
    mapper.step(first)
    seen = mapper.surfels.count
    rooms = 40
    m = mapper.surfels
    m.reserve(seen * rooms)
    arrays = {name: array.copy() for name, array in m.numpy().items()}
    m.count = seen * rooms
    for name, array in m.numpy().items():
        array[:] = np.concatenate([arrays[name]] * rooms)
    shift = np.repeat(np.arange(rooms), seen)[:, None] * np.float32([0, 0, 20.0])
    m.numpy()["position"][:] += shift.astype(np.float32)
    mapper.model.blocks.forget()
    assert len(mapper.model.views.visible(first.T_world_camera)) <= seen // BLOCK + 2
    camera = make_camera(INTRINSICS)
    assert in_view(m, camera, first.T_world_camera, 6.0).sum() >= 0.9 * seen


@pytest.mark.parametrize("addresses", [1 << 25, 1])
def test_growing_keeps_the_rows_and_new_rows_are_zero(addresses, monkeypatch):
    monkeypatch.setattr("dsmap.kernels.types.ADDRESSES", addresses)
    surfels = box_map(np.random.default_rng(3), 1_000)
    surfels.evidence.numpy()[:] = np.arange(13)
    expected = {name: array.copy() for name, array in surfels.numpy().items()}
    for capacity in (1_001, 1_400, 5_000):
        surfels.reserve(capacity)
        assert capacity <= surfels.capacity <= max(capacity, 1.25 * 1_400)
        assert_same(surfels.numpy(), expected)
        assert not surfels.evidence.numpy()[1_000:].any() and not surfels.weight.numpy()[1_000:].any()
        assert surfels.nbytes == surfels.capacity * 113
    kept = surfels.position.ptr
    surfels.reserve(3 * surfels.capacity)
    assert (surfels.position.ptr == kept) == (addresses > 1), "no copy within the reserved addresses"


def test_only_blocks_with_something_old_are_listed_for_an_old_view():
    camera, T = random_scene.CAMERA, random_scene.pose(0)
    surfels = random_scene.surfel_map(T, seed=0)
    surfels.weight.fill_(1.0)
    blocks = Blocks(surfels, STABLE)
    surfels.t_updated.fill_(9)
    surfels.t_updated.numpy()[0] = 4
    blocks.forget()
    assert len(blocks.visible(camera, T, 3.0)) > 1
    assert len(blocks.visible(camera, T, 3.0, t_max=3)) == 0
    assert list(blocks.visible(camera, T, 3.0, t_max=4).numpy()) in ([0], [])
    assert list(blocks.visible(camera, T, 3.0, t_max=9).numpy()) == list(
        blocks.visible(camera, T, 3.0).numpy()
    )
