"""Depth, label and pose agree: frames projected into one another, over many scenes."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from consistency import Agreement, agreement

from dsmap.sim_scenes.camera_paths.paths import camera_path
from dsmap.sim_scenes.recording.options import RenderOptions, plan_take
from dsmap.sim_scenes.recording.record import iter_frames
from dsmap.sim_scenes.rooms.build import build_scene
from dsmap.sim_scenes.space.free_space import FreeSpace

KINDS = ("living_room", "bedroom", "office", "kitchen", "bathroom", "corridor", "flat")


def random_pairs(options: RenderOptions, pairs: int) -> Iterator[Agreement]:
    """Agreement of random pairs of a walk, 0.5 to 2 s apart, that overlap."""
    scene = build_scene(options.scene, options.seed)
    take, rng, found = plan_take(scene, options), np.random.default_rng(options.seed), 0
    for _ in range(4 * pairs):
        first = int(rng.integers(0, len(take.poses) - 60))
        both = np.array([first, first + int(rng.integers(15, 61))])
        frames = list(
            iter_frames(scene, options, replace(take, poses=take.poses[both], covered=take.covered[both]))
        )
        result = agreement(*frames, take.camera)
        if result.compared > 0.1 * options.width * options.height:
            yield result
            found += 1
        if found == pairs:
            return


@pytest.mark.parametrize(
    ("kind", "extra"), [("office", {}), ("flat", {"intrinsics": (90.0, 110.0, 50.0, 70.0)})]
)
def test_frames_agree_with_one_another(kind: str, extra: dict) -> None:
    options = RenderOptions(scene=kind, seed=4, frames=240, width=160, height=120, **extra)
    results = list(random_pairs(options, 3))
    assert len(results) == 3
    for result in results:
        assert result.depth_error < 0.002 and result.label > 0.98 and result.outliers < 0.02


def test_a_wrong_pose_or_label_is_noticed() -> None:
    options = RenderOptions(scene="office", seed=4, frames=2, fps=3.0, width=160, height=120)
    scene = build_scene("office", 4)
    a, b = iter_frames(scene, options)
    camera = plan_take(scene, options).camera
    off = b.T_world_camera.copy()
    off[:3, 3] += 0.01
    assert agreement(a, b, camera).depth_error < 0.001
    assert agreement(a, replace(b, T_world_camera=off), camera).depth_error > 0.003
    swapped = replace(b, label=np.where(b.label == 12, 3, b.label).astype(np.uint8))
    assert agreement(a, swapped, camera).label < 0.9


@pytest.mark.slow
def test_fifty_random_pairs_in_ten_scenes() -> None:
    scenes = [(kind, seed) for seed in (11, 12) for kind in KINDS][:10]
    results = []
    for kind, seed in scenes:
        results += random_pairs(RenderOptions(scene=kind, seed=seed, frames=300, width=320, height=240), 5)
    assert len(results) >= 48
    print("median depth error [mm]", 1000 * np.median([r.depth_error for r in results]))
    assert max(r.depth_error for r in results) < 0.002
    assert np.mean([r.label for r in results]) > 0.99 and min(r.label for r in results) > 0.98


@pytest.mark.slow
def test_the_camera_is_never_inside_things_over_a_hundred_seeds() -> None:
    for seed in range(100):
        scene = build_scene(KINDS[seed % len(KINDS)], 200 + seed)
        space = FreeSpace(scene)
        for path, frames, least in (("walk", 300, 0.2), ("views", 40, 0.2), ("loop", 0, 0.2)):
            eyes = camera_path(scene, path, frames, 10.0, seed)[:, :3, 3]
            assert space.clearance(eyes).min() > least, (scene.name, scene.seed, path)
