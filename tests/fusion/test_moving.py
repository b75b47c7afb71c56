"""Moving things: the kernel against its twin, what counts as moving, and what is left of it in the map."""

import moving_scene
import numpy as np
import pytest
import warp as wp

from dsmap.fusion.config import MapConfig, MovingConfig
from dsmap.fusion.lie import exp_se3
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.tracking.moving_things import MovingThings, grow_to_objects, mask_depth
from dsmap.fusion.trajectory import TrajectoryPoint
from dsmap.kernels.moving import carried_over, was_free_space
from dsmap.kernels.preprocess import preprocess
from dsmap.metrics import ate_rmse
from dsmap.tools.twins import scene as random_scene
from dsmap.tools.twins import views

CAMERA = random_scene.CAMERA


@pytest.mark.parametrize("seed", range(3))
def test_free_space_equals_its_twin(seed):
    rng = np.random.default_rng(seed)
    vertex = random_scene.frame_arrays(seed)["vertex"]
    poses = [exp_se3(rng.normal(0, 0.05, 6)) for _ in range(3)]
    past = [random_scene.frame_arrays(seed + k)["depth"] + np.float32(0.03 * k) for k in range(1, 4)]
    past[0][:10] = 0
    options = {"margin": 0.04, "margin_z2": 0.03}
    out = {name: wp.empty(vertex.shape[:2], dtype=wp.uint8, device="cpu") for name in ("free", "known")}
    was_free_space(CAMERA, wp.array(vertex, dtype=wp.vec3, device="cpu"), poses, past, **out, **options)
    twins = views.was_free_space(CAMERA, vertex.astype(np.float64), poses, past, **options)
    for found, expected in zip(out.values(), twins, strict=True):
        assert 0.02 < expected.mean() < 0.98
        assert (found.numpy() != expected).sum() <= 2


@pytest.mark.parametrize("seed", range(3))
def test_what_a_thing_was_equals_its_twin(seed):
    rng = np.random.default_rng(seed)
    vertex = random_scene.frame_arrays(seed)["vertex"]
    T, things = exp_se3(rng.normal(0, 0.02, 6)), rng.integers(0, 2, vertex.shape[:2], dtype=np.uint8)
    depth = (vertex[..., 2] + rng.normal(0, 0.1, things.shape)).astype(np.float32)
    found = carried_over(CAMERA, wp.array(vertex, dtype=wp.vec3, device="cpu"), T, depth, things, 0.1)
    expected = views.carried_over(CAMERA, vertex.astype(np.float64), T, depth, things, 0.1)
    assert 0.05 < expected.mean() < 0.6
    assert (found != expected).sum() <= 2


def test_specks_are_noise_and_a_thing_moves_as_a_whole():
    depth = np.full((60, 80), 3.0, np.float32)
    depth[20:40, 30:50] = 1.5
    free = np.zeros((60, 80), np.uint8)
    free[5, 5] = free[50, 60:62] = 1  # specks
    assert not grow_to_objects(free, depth, 0.002).any()
    free[20:40, 38:50] = 1  # 60 % of the box
    things = grow_to_objects(free, depth, 0.002).astype(bool)
    assert things[22:38, 32:48].all() and not things[:17].any() and not things[:, 54:].any()
    free[20:40, 30:45] = 0  # a quarter of it: only that
    things = grow_to_objects(free, depth, 0.002).astype(bool)
    assert things[22:38, 46:48].all() and not things[22:38, 32:40].any()


def run(mode: str, frames: list, memory: int = 60) -> tuple[Mapper, np.ndarray, list[float]]:
    """Map the frames; the mapper, the poses and the moving share of every frame."""
    config = MapConfig(depth_max=5.0, moving=MovingConfig(mode=mode, memory=memory))
    config.loops.mode = "off"
    mapper = Mapper(config, moving_scene.INTRINSICS)
    results = [mapper.step(frame) for frame in frames]
    return mapper, np.array([r.T_world_camera for r in results]), [r.moving for r in results]


def ghosts(mapper: Mapper, box: np.ndarray | None) -> int:
    """Stable surfels more than 3 cm from every surface there is now."""
    s = mapper.surfels.numpy()
    p = s["position"][s["weight"] >= 10]
    off = moving_scene.distance_to_room(p) > 0.03
    if box is not None:
        off &= np.abs(moving_scene.distance_to_box(p, box)) > 0.03
    return int(off.sum())


def test_a_still_room_moves_nowhere():
    rng = np.random.default_rng(0)
    box = moving_scene.slide(0)
    _, _, moving = run("mask", [moving_scene.frame(i, box, rng) for i in range(40)])
    assert max(moving) == 0.0


def test_a_box_pushed_through_the_view_leaves_no_ghost_and_is_mapped_where_it_rests():
    """Pushed for 30 frames, seen with a Kinect's noise; then it rests and, after the memory's length, is static."""
    rng = np.random.default_rng(0)
    centres = [moving_scene.slide(i, 20, 50) for i in range(95)]
    frames = [moving_scene.frame(i, centre, rng) for i, centre in enumerate(centres)]
    given = np.array([frame.T_world_camera for frame in frames])
    mapper, poses, moving = run("mask", frames, memory=24)
    assert max(moving[:20]) == 0.0 and min(moving[30:50]) > 0.02 and max(moving[-15:]) == 0.0
    assert ate_rmse(poses, given) < 0.006
    assert ghosts(mapper, centres[-1]) == 0
    s = mapper.surfels.numpy()
    at_rest = np.abs(moving_scene.distance_to_box(s["position"].astype(float), centres[-1])) < 0.02
    assert (at_rest & (s["weight"] >= 10)).sum() > 500, "what came to rest is in the map"


def test_a_thing_that_left_is_cleared_within_a_second_even_if_it_was_seen_for_long():
    rng = np.random.default_rng(1)
    box = moving_scene.slide(0, -30, 30)  # in the middle of the view
    frames = [moving_scene.frame(i, box if i < 30 else None, rng) for i in range(62)]
    mapper, _, _ = run("mask", frames[:30])
    weight = mapper.surfels.numpy()["weight"]
    weight[weight >= 10] += 300
    before = ghosts(mapper, None)
    for frame in frames[30:]:
        mapper.step(frame)
    assert before > 500 and ghosts(mapper, None) <= 0.02 * before


def test_people_who_walk_through_do_not_pull_the_camera():
    rng = np.random.default_rng(2)
    frames = [
        moving_scene.frame(i, np.array([-3 + (i % 60) * 0.1, 0.6, 1.8]), rng) for i in range(75)
    ]  # enters on the left, out on the right, twice
    given = np.array([frame.T_world_camera for frame in frames])
    error = {mode: ate_rmse(run(mode, frames)[1], given) for mode in ("off", "mask")}
    assert error["mask"] < 0.004 and error["mask"] < 0.8 * error["off"]


def test_once_something_moves_every_remembered_frame_is_asked():
    """The few that are asked first looked past a fifth of the box; the others past all of it."""
    things = MovingThings(MapConfig(), [CAMERA])
    height, width = CAMERA.height, CAMERA.width
    depth = np.full((height, width), 3.0, np.float32)
    box = np.s_[height // 4 : 3 * height // 4, width // 4 : 3 * width // 4]
    before = depth.copy()
    before[box] = 1.5
    before[box[0], width // 4 : width // 4 + width // 10] = 3.0
    frame = depth.copy()
    frame[box] = 1.5
    things.memory.extend((row, before) for row in range(15))
    maps = preprocess(np.full((height, width, 3), 90, np.uint8), frame, [CAMERA], wp.get_device("cpu"))
    trajectory = [TrajectoryPoint(row / 30, np.eye(4), True) for row in range(15)]

    def share() -> float:
        things.last = None
        found = things.find(maps, trajectory, np.eye(4))
        return 0.0 if found is None else float(found[box].mean())

    assert 0.1 < share() < 0.4
    things.memory[13] = (13, depth)  # of the ten that are not asked at first
    assert share() > 0.9
    things.memory.extend((row, frame) for row in range(15))
    things.memory[13] = (13, depth)
    assert share() == 0.0, "the few see nothing move: nobody else is asked"


@pytest.mark.parametrize("looked_there", [False, True])
def test_what_moved_still_moves_where_the_camera_has_not_looked_before(looked_there):
    things = MovingThings(MapConfig(), [CAMERA])
    depth = np.full((CAMERA.height, CAMERA.width), 3.0, np.float32)
    box = np.s_[CAMERA.height // 4 : CAMERA.height // 2, CAMERA.width // 4 : CAMERA.width // 2]
    depth[box] = 1.5
    moved = np.zeros(depth.shape, np.uint8)
    moved[box] = 1
    elsewhere = exp_se3(np.array([0, 0, 0, 0, 2.0, 0]))
    trajectory = [TrajectoryPoint(0.0, np.eye(4) if looked_there else elsewhere, True)]
    trajectory += [TrajectoryPoint(row / 30, np.eye(4), True) for row in (1, 2)]
    things.memory.append((0, depth))
    things.last = (2, depth, moved)
    frame = depth.copy()
    frame[box] = 1.45
    maps = preprocess(np.full((*depth.shape, 3), 90, np.uint8), frame, [CAMERA], wp.get_device("cpu"))
    found = things.find(maps, trajectory, np.eye(4))
    if looked_there:
        assert found is None and things.last is None, "the oldest frame saw it rest there"
    else:
        assert found is not None and found[box].all()
        assert found.sum() <= 14 * 18, "the box of 12x16 pixels and one around it"
        assert things.last is not None and things.last[0] == 3


def test_a_frame_without_what_moves_has_holes_on_every_level():
    still = moving_scene.frame(0, None)
    mapper = Mapper(MapConfig(), moving_scene.INTRINSICS)
    maps = mapper.prepare(still)
    moving = np.zeros((120, 160), bool)
    moving[40:61, 50:90] = True
    for level, (a, b) in enumerate(zip(maps, mask_depth(maps, moving), strict=True)):
        hole = b.vertex.numpy()[..., 2] == 0
        assert hole[40 >> level : 61 >> level, 50 >> level : 90 >> level].all()
        assert hole.sum() <= (21 / 2**level + 1) * (40 / 2**level + 1) + (a.vertex.numpy()[..., 2] == 0).sum()
        assert b.intensity is a.intensity and (a.vertex.numpy()[..., 2] > 0).mean() > 0.9, (
            "the frame keeps its own"
        )


def test_what_moves_does_not_steer_the_camera(monkeypatch):
    """A box that fills much of the view creeps away: with its pixels in the registration it takes the camera along."""

    def errors() -> float:
        rng = np.random.default_rng(3)
        frames = [
            moving_scene.frame(i, np.array([-0.1 + 0.015 * max(i - 20, 0), 0.6, 1.0]), rng) for i in range(70)
        ]
        given = np.array([frame.T_world_camera for frame in frames])
        _, poses, moving = run("mask", frames)
        assert max(moving) > 0.1
        return float(np.linalg.norm((poses - given)[30:, :3, 3], axis=1).mean())

    pose_difference = errors()
    monkeypatch.setattr("dsmap.fusion.locator.mask_depth", lambda maps, moving: maps)
    together = errors()
    assert pose_difference < 0.8 * together, (pose_difference, together)


def test_the_memory_can_be_saved_and_restored():
    frames = [moving_scene.frame(i, moving_scene.slide(i, 0, 30)) for i in range(14)]
    mapper, _, _ = run("mask", frames)
    copy = MovingThings(mapper.config, mapper.model.cameras)
    copy.load_state(mapper.locator.moving.state())
    assert (
        [row for row, _ in copy.memory] == [row for row, _ in mapper.locator.moving.memory] == [0, 4, 8, 12]
    )
    assert all(
        (a == b).all() for (_, a), (_, b) in zip(copy.memory, mapper.locator.moving.memory, strict=True)
    )
    assert mapper.locator.moving.last is not None and copy.last is not None
    for a, b in zip(copy.last, mapper.locator.moving.last, strict=True):
        np.testing.assert_array_equal(a, b)
    copy.load_state({})
    assert copy.state() == {} and copy.last is None
