"""Finding a camera in a mapped room without a guess, and refusing look-alikes."""

from dataclasses import replace

import numpy as np
import pytest

from dsmap.frame import Frame
from dsmap.fusion.config import FernConfig, MapConfig, RelocaliseConfig
from dsmap.fusion.lie import exp_se3, inverse, rotation_angle
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.places.ferns import FernDatabase, small_size, small_view
from dsmap.fusion.places.relocalise import Relocaliser, Relocation
from dsmap.fusion.places.rotation_search import best_shift, search_rotation
from dsmap.fusion.places.sightings import Sightings
from dsmap.fusion.surfels.model import LEVELS
from dsmap.fusion.surfels.model_view import ModelView
from dsmap.fusion.tracking.agreement import agreement, correlation, reason_to_reject_pose, texture_match
from dsmap.fusion.tracking.pose_check import PoseCheck
from dsmap.fusion.tracking.tracker import Health
from dsmap.fusion.trajectory import TrajectoryPoint, extrapolated
from dsmap.kernels.predict import predict_model
from dsmap.kernels.preprocess import depth_in_range, intensity_map, preprocess
from dsmap.kernels.types import ModelMaps
from dsmap.tools.twins.corner import INTRINSICS, room


@pytest.fixture(scope="module")
def mapped():
    """A mapped room, its ferns, a relocaliser and the function that renders the map."""
    mapper = Mapper(MapConfig(depth_max=6.0, poses="given"), INTRINSICS)
    size = small_size(INTRINSICS, 48)
    ferns = FernDatabase(FernConfig(novelty=0.2), size, (0.3, 6.0))
    for i in range(16):
        T = exp_se3(np.array([0.012 * i, 0.004 * i, 0, 0, -0.01 * i, 0]))
        rgb, depth = room(T)
        mapper.step(Frame(i, i / 30, rgb, depth, T))
        maps = preprocess(rgb, depth_in_range(depth, 0.3, 6.0), mapper.model.cameras, mapper.model.device)
        view = small_view(maps[0].colour.numpy(), maps[0].vertex.numpy()[..., 2], size)
        ferns.add_if_novel(ferns.encode(view), view, T, i)

    def predict_at(T: np.ndarray) -> ModelView:
        maps = ModelMaps.empty(INTRINSICS.height, INTRINSICS.width, mapper.model.device)
        predict_model(mapper.surfels, mapper.model.cameras[0], T, max_depth=6.0, maps=maps)
        return ModelView(maps.vertex, maps.normal, intensity_map(maps.colour), LEVELS, T)

    relocaliser = Relocaliser(
        mapper.config.relocalise, mapper.config.track, mapper.model.cameras, INTRINSICS, size
    )
    return mapper, ferns, relocaliser, predict_at


def locate(mapped, rgb: np.ndarray, depth: np.ndarray):
    mapper, ferns, relocaliser, predict_at = mapped
    maps = preprocess(rgb, depth_in_range(depth, 0.3, 6.0), mapper.model.cameras, mapper.model.device)
    view = small_view(maps[0].colour.numpy(), maps[0].vertex.numpy()[..., 2], ferns.size)
    candidates = ferns.candidates(ferns.encode(view), 1000, 0)
    return relocaliser.relocalise(maps, view, candidates, predict_at)


@pytest.mark.parametrize("xi", [[0.05, 0.02, 0.04, 0.02, -0.04, 0.03], [0.15, 0, -0.06, -0.05, -0.15, 0.04]])
def test_a_camera_is_found_without_a_guess(mapped, xi):
    truth = exp_se3(np.array(xi))
    found = locate(mapped, *room(truth))
    assert found is not None, mapped[2].rejected
    error = inverse(truth) @ found.T_world_camera
    assert np.linalg.norm(error[:3, 3]) < 0.01 and np.rad2deg(rotation_angle(error)) < 0.5
    again = locate(mapped, *room(truth))
    assert again is not None
    np.testing.assert_array_equal(found.T_world_camera, again.T_world_camera)


def test_a_look_alike_is_refused(mapped):
    """The same shape in other colours, and the same walls without the thing before them."""
    truth = exp_se3(np.array([0.05, 0.02, 0.0, 0.0, -0.04, 0.0]))
    rgb, depth = room(truth)
    assert locate(mapped, rgb, depth) is not None
    assert locate(mapped, 255 - rgb, depth) is None
    v, u = np.mgrid[:72, :96]
    ball = np.hypot(u - 52, v - 40) < 17
    gone = np.where(ball, depth.max(), depth)
    assert locate(mapped, rgb, gone) is None
    assert locate(mapped, rgb, np.zeros_like(depth)) is None
    assert mapped[2].rejected == [], "without depth there are no candidates at all"


def test_agreement_says_what_is_wrong(mapped):
    mapper, _, _, predict_at = mapped
    config = mapper.config.relocalise
    T = exp_se3(np.array([0.05, 0.02, 0.0, 0.0, -0.04, 0.0]))
    rgb, depth = room(T)

    def compare(rgb, depth):
        maps = preprocess(rgb, depth_in_range(depth, 0.3, 6.0), mapper.model.cameras, mapper.model.device)
        seen = predict_at(T).level(0)
        return agreement(maps[0], seen.vertex, seen.intensity, config)

    good = compare(rgb, depth)
    assert (
        not reason_to_reject_pose(good, config)
        and good.same > 0.95
        and good.seen_through < 0.02
        and good.ncc > 0.9
    )
    assert "seen through" in reason_to_reject_pose(
        compare(rgb, depth + np.float32(0.3) * (np.arange(96) > 60)), config
    )
    assert "agree" in reason_to_reject_pose(
        compare(rgb, depth - np.float32(0.3) * (np.arange(96) > 60)), config
    )
    assert "correlate" in reason_to_reject_pose(compare(255 - rgb, depth), config)
    covered = np.where(np.arange(96) > 20, 0, depth).astype(np.float32)
    assert compare(rgb, covered).same > 0.95, "what the frame does not see is not held against it"


def path(poses: list[np.ndarray], tracked: list[bool]) -> list[TrajectoryPoint]:
    return [TrajectoryPoint(i / 30, T, ok) for i, (T, ok) in enumerate(zip(poses, tracked, strict=True))]


def test_after_a_gap_the_camera_is_sought_where_its_motion_led():
    step = exp_se3(np.array([0, 0, 0, 0, 0.02, 0.0]))
    poses = [np.eye(4)]
    for _ in range(29):
        poses.append(poses[-1] @ step)
        poses[-1][0, 3] += 0.01
    seen = [i < 20 for i in range(30)]
    carried = [poses[min(i, 19)] for i in range(30)]
    ahead, half, last = extrapolated(path(carried, seen))
    truth = poses[29] @ step
    truth[0, 3] += 0.01
    np.testing.assert_allclose(ahead, truth, atol=1e-9)
    np.testing.assert_array_equal(last, poses[19])
    assert last[0, 3] < half[0, 3] < ahead[0, 3]
    assert extrapolated(path(carried[:1], [False])) == [] == extrapolated([])
    long_ago = path([np.eye(4)] * 80, [i < 10 for i in range(80)])
    assert extrapolated(long_ago) == []


def test_a_guess_needs_no_keyframe(mapped):
    mapper, ferns, relocaliser, predict_at = mapped
    truth = exp_se3(np.array([0.15, 0.05, -0.05, 0.0, -0.12, 0.02]))
    rgb, depth = room(truth)
    maps = preprocess(rgb, depth_in_range(depth, 0.3, 6.0), mapper.model.cameras, mapper.model.device)
    view = small_view(maps[0].colour.numpy(), maps[0].vertex.numpy()[..., 2], ferns.size)
    assert relocaliser.relocalise(maps, view, [], predict_at) is None
    found = relocaliser.relocalise(maps, view, [], predict_at, guesses=[np.eye(4)])
    assert found is not None, relocaliser.rejected
    assert np.linalg.norm((inverse(truth) @ found.T_world_camera)[:3, 3]) < 0.01


def test_only_poses_that_surprise_are_looked_at_twice(mapped):
    mapper = mapped[0]
    check = PoseCheck(mapper.config, mapper.model.views)
    steady = [exp_se3(np.array([0.01 * i, 0, 0, 0, 0, 0])) for i in range(4)]
    good = Health(True, "", 0.8, 0.003, 0.02, np.eye(6), 0.5, 9e4, np.zeros(6))
    known = path(steady[:3], [True] * 3)
    assert not check.surprising(steady[3], good, known)
    sideways = steady[3] @ exp_se3(np.array([0.05, 0, 0, 0, 0, 0]))
    turned = steady[3] @ exp_se3(np.array([0, 0, 0, 0, 0.1, 0]))
    assert check.surprising(sideways, good, known) and check.surprising(turned, good, known)
    assert check.surprising(steady[3], good, path(steady[:3], [True, True, False]))
    assert check.surprising(steady[3], replace(good, inlier_fraction=0.2), known)
    assert not check.surprising(sideways, good, known[:1]), "the first motion cannot surprise"

    truth = exp_se3(np.array([0.05, 0.02, 0.0, 0.0, -0.04, 0.0]))
    maps = preprocess(*room(truth), mapper.model.cameras, mapper.model.device)
    lost = path([truth] * 3, [True, False, False])
    assert check.reason_to_reject(maps, truth, good, lost, t_min=0) == ""
    wrong = truth @ exp_se3(np.array([0.15, 0, 0.1, 0, 0, 0]))
    assert check.reason_to_reject(maps, wrong, good, lost, t_min=0) != ""
    assert (
        check.reason_to_reject(maps, wrong, replace(good, tracked=False, reason="no"), lost, t_min=0) == "no"
    )


def test_a_repeated_pattern_one_repetition_off_is_noticed():
    """A door: outlines that allow any shift upwards, and faint grain that allows only one."""
    rng = np.random.default_rng(0)
    grain = np.repeat(rng.normal(0, 0.02, (240, 1)), 320, axis=1).astype(np.float32)
    frame = np.full((240, 320), 0.4, np.float32)
    frame[:, 100:120] = 0.9
    frame[:, 200:215] = 0.7
    mask = np.ones(frame.shape, bool)
    off = np.roll(grain, 40, axis=0)
    assert correlation(frame + grain, frame + off, mask) > 0.7, "the outlines drown the grain"
    right, wrong = (
        texture_match(frame + grain, frame + grain, mask),
        texture_match(frame + grain, frame + off, mask),
    )
    assert right[0] > 0.99 and right[1] == 0
    assert wrong[0] < 0.55 and wrong[1] > 0.1
    assert texture_match(frame * 0 + 0.5, frame * 0 + 0.5, mask)[1] == 0, "a blank wall has no rival"


def test_the_shift_between_two_pictures_is_found_with_holes_and_another_exposure():
    rng = np.random.default_rng(1)
    wall = np.kron(rng.random((20, 30)), np.ones((6, 6))).astype(np.float32)
    a, b = wall[20:80, 40:120], 0.5 * wall[12:72, 60:140] + 0.2
    hole = np.ones(a.shape, bool)
    hole[20:40, 30:50] = False
    score, dy, dx = best_shift(a, hole, b, np.ones(b.shape, bool))
    assert (dy, dx) == (8, -20) and 0.6 < score < 1
    assert best_shift(a, hole, b, np.zeros(b.shape, bool))[0] == 0, "nothing is known there"
    assert best_shift(a, hole, wall[::-1][:60, 100:180], np.ones(b.shape, bool))[0] < 0.4 * score


def test_a_guess_is_turned_to_where_the_frame_fits(mapped):
    """20 degrees beside the likeliest guess, and beside the view from it turned aside; nothing without guesses."""
    mapper = mapped[0]
    truth = exp_se3(np.array([0.05, 0.0, 0.0, 0.05, -0.3, 0.0]))
    maps = preprocess(*room(truth), mapper.model.cameras, mapper.model.device)

    def render(T):
        rgb, depth = room(T)
        return preprocess(rgb, depth, mapper.model.cameras, mapper.model.device)[
            0
        ].intensity.numpy(), depth > 0

    off = truth @ exp_se3(np.array([0.02, 0, 0, 0.0, np.deg2rad(20), 0]))
    for guess in (off, truth @ exp_se3(np.array([0, 0, 0, 0, np.deg2rad(-30), 0]))):
        best = search_rotation(maps[0], mapper.model.cameras[0], [guess], render)[0]
        assert np.rad2deg(rotation_angle(inverse(truth) @ best)) < 5
        np.testing.assert_array_equal(best[:3, 3], guess[:3, 3])
    assert search_rotation(maps[0], mapper.model.cameras[0], [], render) == []


def test_a_pose_that_looks_through_part_of_the_model_is_not_certain(mapped):
    """A kitchen seen from one cabinet too far to the side looked through 4 % of it, and fitted."""
    truth = exp_se3(np.array([0.05, 0.02, 0.0, 0.0, -0.04, 0.0]))
    rgb, depth = room(truth)
    found = locate(mapped, rgb, depth)
    assert found is not None and found.certain
    found = locate(mapped, rgb, depth + np.float32(0.3) * (np.mgrid[:72, :96][0] > 67))
    assert found is not None and not found.certain and found.agreement.seen_through > 0.02
    assert locate(mapped, rgb, depth + np.float32(0.3) * (np.mgrid[:72, :96][0] > 55)) is None


def test_rims_of_things_do_not_count_as_seen_through(mapped):
    truth = exp_se3(np.array([0.05, 0.02, 0.0, 0.0, -0.04, 0.0]))
    rgb, depth = room(truth)
    torn = depth + np.float32(0.3) * (np.mgrid[:72, :96][1] % 24 // 2 == 5)
    found = locate(mapped, rgb, torn)
    assert found is not None and found.agreement.seen_through < 0.01


def sighting(certain: bool, x: float = 0.0) -> Relocation:
    T = exp_se3(np.array([x, 0, 0, 0, 0, 0]))
    return Relocation(T, None, 1.0, None, None, certain)  # type: ignore[arg-type]


def test_uncertain_poses_count_if_several_frames_in_a_row_find_them():
    sightings = Sightings(RelocaliseConfig(sightings=3))
    assert sightings.pose(1, sighting(True)) is not None, "a certain one counts at once"
    answers = [sightings.pose(t, sighting(False, 0.02 * t)) for t in (2, 3, 4)]
    assert answers[:2] == [None, None] and answers[2][0, 3] == pytest.approx(0.08)
    assert sightings.seen == [], "it starts anew"
    for times, places in (((2, 3, 5), (0, 0, 0)), ((2, 3, 4), (0, 0, 0.3)), ((2, 3, 4), (0, None, 0))):
        sightings = Sightings(RelocaliseConfig(sightings=3))
        found = [None if x is None else sighting(False, x) for x in places]
        assert all(sightings.pose(t, f) is None for t, f in zip(times, found, strict=True))
