"""Scores of robustness trials, the command that runs them, and revisits of rendered rooms."""

import json

import numpy as np
import pytest

from dsmap.frame import Frame
from dsmap.fusion.config import FernConfig, MapConfig
from dsmap.fusion.evaluate.robustness import score_trial, share_in_view
from dsmap.fusion.lie import exp_se3, exp_so3, inverse, rotation_angle
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.places.ferns import FernDatabase, small_size, small_view
from dsmap.fusion.places.relocalise import Relocaliser
from dsmap.fusion.surfels.model import LEVELS
from dsmap.fusion.surfels.model_view import ModelView
from dsmap.kernels.predict import predict_model
from dsmap.kernels.preprocess import depth_in_range, intensity_map, preprocess
from dsmap.kernels.types import ModelMaps
from dsmap.tools.cli import run
from dsmap.tools.twins.corner import INTRINSICS, room


def walk(frames: int = 90) -> np.ndarray:
    return np.array([exp_se3(np.array([0.01 * i, 0, 0, 0, 0.01 * i, 0])) for i in range(frames)])


def score(true, estimated, lost=(), found=(), blind=()):
    frames = range(len(true))
    return score_trial(
        true, estimated, [i not in lost for i in frames], [i in found for i in frames],
        np.array([i in blind for i in frames]), fps=30.0,
    )  # fmt: skip


def test_a_trial_is_scored_in_the_world_of_its_first_frame():
    true = walk()
    moved = exp_se3(np.array([3.0, 1, 0, 0.4, 0, 0])) @ true
    fine = score(true, moved)
    assert fine.passed and fine.worst_m < 1e-9 and fine.lost == fine.wrong == fine.leaps == 0
    moved[50, :3, 3] += 0.06
    assert score(true, moved).wrong == 1 and not score(true, moved).passed
    assert score(true, moved, found=[50]).wrong_relocalised == 1
    assert score(true, moved, lost=[50]).passed, "a lost frame is not believed"
    turned = true.copy()
    turned[20, :3, :3] = turned[20, :3, :3] @ exp_so3(np.deg2rad([0, 0, 4.0]))
    assert score(true, turned).wrong == 1


def test_time_to_recover_counts_from_when_the_camera_can_see():
    true = walk(120)
    covered = range(30, 60)
    seen_again = score(true, true, lost=range(30, 75), blind=covered)
    assert seen_again.blind == 30 and seen_again.lost == 15
    assert seen_again.longest_lost_s == pytest.approx(0.5) and seen_again.passed
    assert not score(true, true, lost=range(30, 100), blind=covered).passed
    assert score(true, true, lost=range(20, 40)).longest_lost_s == pytest.approx(20 / 30)


def test_a_trial_in_which_nothing_mapped_came_into_view_is_told_apart():
    true, seen = walk(120), np.ones(120)
    frames = range(120)
    tracked, blind = [i < 30 for i in frames], np.array([30 <= i < 60 for i in frames])
    seen[60:] = np.linspace(0.2, 0.0, 60)
    seen[95] = 0.9  # later than a second after it could see

    def scored():
        return score_trial(true, true, tracked, [False] * 120, blind, 30.0, seen)

    assert scored().in_view == pytest.approx(0.2) and scored().hopeless and not scored().passed
    seen[70] = 0.3
    assert not scored().hopeless and not scored().passed
    assert score(true, true).in_view == 1 and not score(true, true).hopeless


def test_share_of_a_frame_that_the_map_shows():
    mapper = Mapper(MapConfig(depth_max=6.0, poses="given"), INTRINSICS)
    for i in range(3):
        mapper.step(Frame(i, i / 30, *room(np.eye(4)), np.eye(4)))
    here = Frame(3, 0.1, *room(np.eye(4)))
    assert share_in_view(mapper, here, np.eye(4)) > 0.9
    aside = exp_se3(np.array([0, 0, 0, 0, -0.5, 0]))
    assert 0.05 < share_in_view(mapper, Frame(3, 0.1, *room(aside)), aside) < 0.7
    before = Frame(3, 0.1, here.rgb, here.depth - np.float32(0.3))
    assert share_in_view(mapper, before, np.eye(4)) < 0.1, "something stands before it"


def test_fast_turns_and_leaps_are_recognised():
    true = walk()
    for i in range(30, 90):
        true[i] = true[i] @ exp_se3(np.array([0, 0, 0, 0, np.deg2rad(5) * min(i - 30, 15), 0]))
    fast = score(true, true)
    assert fast.leaps == 0 and fast.fast_s == pytest.approx(0.5)
    true[60:, 0, 3] += 1
    assert score(true, true).leaps == 1


def test_command_runs_a_trial_once(tmp_path, capsys):
    out = tmp_path / "trials.json"
    flags = ["--out", str(out), "--paths", "jump", "--trials", "1", "--frames", "24", "--size", "64x48"]
    assert run("bench-robustness", flags) == 0
    rows = json.loads(out.read_text())
    assert list(rows) == ["jump living_room 101"] and rows["jump living_room 101"]["frames"] == 24
    rows["jump living_room 101"] |= {"worst_m": 0.777}
    out.write_text(json.dumps(rows))
    assert run("bench-robustness", flags) == 0
    printed = capsys.readouterr().out
    assert "77.7 cm" in printed and "jump: 1 of 1" in printed, "taken from the file, not run again"
    out.write_text("{")
    assert run("bench-robustness", flags) == 2 and run("bench-robustness", ["--paths", "hop"]) == 2
    assert "hop" in capsys.readouterr().err


def test_a_shaken_camera_with_a_rolling_shutter_is_a_trial(tmp_path, capsys):
    out = tmp_path / "trials.json"
    flags = ["--out", str(out), "--paths", "shake", "--readout-s", "0.026", "--trials", "1", "--frames", "12"]
    run("bench-robustness", [*flags, "--size", "64x48"])
    row = json.loads(out.read_text())["shake living_room 101"]
    assert row["frames"] == 12 and 0 <= row["ate_m"] < 0.05
    assert "frames lost" in capsys.readouterr().out


def _disturbed(T: np.ndarray, metres: float, degrees: float, rng: np.random.Generator) -> np.ndarray:
    offset, axis = rng.normal(size=3) * [1, 1, 0.3], rng.normal(size=3) * [0.2, 1, 0.1]
    out = T.copy()
    out[:3, 3] += metres * offset / np.linalg.norm(offset)
    out[:3, :3] = out[:3, :3] @ exp_so3(np.deg2rad(degrees) * axis / np.linalg.norm(axis))
    return out


def _mapped(scene, take, images):
    """A mapper that mapped the walk from given poses, its ferns, and a function that finds a frame in it."""
    config = MapConfig(depth_max=8.0, poses="given")
    mapper = Mapper(config, take.camera)
    size = small_size(take.camera, config.ferns.width)
    ferns = FernDatabase(FernConfig(min_age=0), size, config.depth_range)
    for i, image in enumerate(images):
        mapper.step(Frame(i, image.time, image.rgb, image.depth, image.T_world_camera))
        view = small_view(mapper.model.maps.colour.numpy(), mapper.model.maps.vertex.numpy()[..., 2], size)
        ferns.add_if_novel(ferns.encode(view), view, image.T_world_camera, i)
    relocaliser = Relocaliser(config.relocalise, config.track, mapper.model.cameras, take.camera, size)

    def predict_at(T: np.ndarray) -> ModelView:
        maps = ModelMaps.empty(take.camera.height, take.camera.width, mapper.model.device)
        predict_model(
            mapper.surfels, mapper.model.cameras[0], T, max_depth=8.0, maps=maps, stable_weight=10.0
        )
        return ModelView(maps.vertex, maps.normal, intensity_map(maps.colour), LEVELS, T)

    def find(rgb: np.ndarray, depth: np.ndarray):
        maps = preprocess(rgb, depth_in_range(depth, 0.3, 8.0), mapper.model.cameras, mapper.model.device)
        view = small_view(maps[0].colour.numpy(), maps[0].vertex.numpy()[..., 2], size)
        return relocaliser.relocalise(maps, view, ferns.candidates(ferns.encode(view), 10**6), predict_at)

    return find


@pytest.mark.slow
def test_revisits_of_rendered_rooms_are_found_and_other_rooms_are_not():
    """Recall and precision: 10 cm and 5 degrees off the path, 25 cm and 12 degrees, and in the other room."""
    pytest.importorskip("mujoco_warp")
    from dsmap.sim_scenes.recording.open_scene import open_scene
    from dsmap.sim_scenes.recording.options import RenderOptions, plan_take
    from dsmap.sim_scenes.recording.record import iter_frames
    from dsmap.sim_scenes.render.open_renderer import open_renderer
    from dsmap.sim_scenes.sensors.kinect import kinect_depth

    rooms = []
    for kind, seed in (("living_room", 41), ("office", 42)):
        options = RenderOptions(
            scene=kind, seed=seed, frames=40, width=320, height=240, fps=4.0, noise="kinect"
        )
        scene = open_scene(options)
        take, rng = plan_take(scene, options), np.random.default_rng(seed)
        images = list(iter_frames(scene, options, take))
        renderer = open_renderer("warp", take.scene, take.camera)
        queries = []
        for near in range(1, 40, 4):
            for metres, degrees in ((0.10, 5.0), (0.25, 12.0)):
                T = _disturbed(take.poses[near], metres, degrees, rng)
                image = renderer(T)
                if np.percentile(image.depth, 5) > 0.35:
                    no_glass = np.zeros(image.depth.shape, bool)
                    depth = kinect_depth(image.depth, take.camera, no_glass, seed=seed, frame=len(queries))
                    queries.append((metres, T, image.rgb, depth))
        renderer.close()
        rooms.append((_mapped(scene, take, images), queries))
    found = {0.10: [], 0.25: []}
    for own, (find, _) in enumerate(rooms):
        for other, (_, queries) in enumerate(rooms):
            for metres, T, rgb, depth in queries:
                answer = find(rgb, depth)
                if own != other:
                    assert answer is None, "another room is not this one"
                    continue
                found[metres].append(answer is not None)
                if answer is not None:
                    error = inverse(T) @ answer.T_world_camera
                    assert np.linalg.norm(error[:3, 3]) < 0.05 and np.rad2deg(rotation_angle(error)) < 3
    print({metres: f"{sum(hits)} of {len(hits)}" for metres, hits in found.items()})
    assert np.mean(found[0.10]) >= 0.8 and np.mean(found[0.25]) >= 0.7
