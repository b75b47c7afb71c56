"""Moving things: physics that stays in its bounds, cameras that keep away, poses that agree with the images."""

from pathlib import Path

import numpy as np
import pytest

from dsmap.errors import InputError
from dsmap.sequences import open_sequence
from dsmap.sequences.bodies import read_bodies
from dsmap.sequences.mesh import read_mesh
from dsmap.sim_scenes.physics.bodies import FIRST_S, STEP_S
from dsmap.sim_scenes.physics.kinds import set_in_motion
from dsmap.sim_scenes.recording.options import RenderOptions, plan_take
from dsmap.sim_scenes.recording.record import render_sequence
from dsmap.sim_scenes.rooms.build import build_scene
from dsmap.sim_scenes.space.free_space import FreeSpace

SCENES = {"chair": "office", "ball": "kitchen", "person": "living_room", "door": "flat"}


@pytest.mark.parametrize("kind", ["chair", "ball", "person", "door"])
def test_things_rest_at_first_then_move_and_the_camera_keeps_away(kind: str) -> None:
    scene = build_scene(SCENES[kind], 1)
    motion = set_in_motion(scene, kind, 20.0, 1)
    first = motion.T_world_body[:, 0]
    still = first[: int(FIRST_S / STEP_S)]
    assert np.abs(still - still[0]).max() < 0.01
    points = first[:, :3, :3] @ [0.5, 0.0, 0.5] + first[:, :3, 3]
    assert np.linalg.norm(points - points[0], axis=1).max() > 0.4
    assert np.abs(first[:, 2, 3] - first[0, 2, 3]).max() < 0.02  # nothing flies or sinks
    if kind in ("chair", "person", "door"):
        assert first[:, 2, 2].min() > np.cos(np.radians(10))
    assert not scene.bodies and all(p.body == 0 for p in scene.parts)
    take = plan_take(scene, RenderOptions(scene=SCENES[kind], frames=150, fps=10.0, moving=kind, seed=1))
    clear = FreeSpace(take.scene, motion.swept()).clearance(take.poses[:, :3, 3])
    assert clear.min() > 0.15
    assert take.T_world_body is not None and take.T_world_body.shape[0] == 150


def test_motion_between_steps_is_interpolated_and_ends_at_rest() -> None:
    motion = set_in_motion(build_scene("office", 1), "chair", 5.0, 1)
    k = 200
    t = np.array([k, k + 0.5, k + 1.0]) * STEP_S
    a, middle, b = motion.at(t)[:, 0]
    assert np.allclose(a, motion.T_world_body[k, 0]) and np.allclose(b, motion.T_world_body[k + 1, 0])
    assert np.allclose(middle[:3, 3], (a[:3, 3] + b[:3, 3]) / 2)
    assert np.allclose(middle[:3, :3] @ middle[:3, :3].T, np.eye(3))
    assert np.allclose(motion.at(np.array([1e4]))[0], motion.T_world_body[-1])


def test_a_longer_recording_moves_like_a_shorter_one() -> None:
    scene = build_scene("office", 1)
    short, long = (
        plan_take(scene, RenderOptions(scene="office", frames=n, fps=10.0, moving="chair")) for n in (40, 120)
    )
    assert np.array_equal(short.T_world_body, long.T_world_body[:40])
    assert np.allclose(short.poses, long.poses[:40])


def test_images_show_the_moving_thing_where_bodies_txt_says(tmp_path: Path) -> None:
    options = RenderOptions(scene="office", frames=8, width=96, height=72, fps=1.0, moving="chair")
    folder = render_sequence(tmp_path / "pushed", options)
    bodies, sequence = read_bodies(folder), open_sequence(folder)
    (name, (instance, times, poses)), camera = next(iter(bodies.items())), sequence.intrinsics
    assert name == "chair" and len(times) == 8 and poses.shape == (8, 4, 4)
    take = plan_take(build_scene("office", 1), options)
    points = np.concatenate([p.shape.vertices for p in take.scene.parts if p.body == 1])
    at_rest = points @ take.scene.bodies[0].T_world_rest[:3, :3] - (
        take.scene.bodies[0].T_world_rest[:3, 3] @ take.scene.bodies[0].T_world_rest[:3, :3]
    )
    low, high, seen = at_rest.min(0) - 0.02, at_rest.max(0) + 0.02, 0
    for k in range(8):
        frame = sequence.frame(k)
        y, x = np.nonzero(frame.instance == instance)
        z = frame.depth[y, x]
        rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones(len(x))], 1)
        world = (rays * z[:, None]) @ frame.T_world_camera[:3, :3].T + frame.T_world_camera[:3, 3]
        own = (world - poses[k][:3, 3]) @ poses[k][:3, :3]
        assert ((own > low) & (own < high)).all()
        seen += len(x)
    assert seen > 200
    assert instance not in np.unique(read_mesh(folder / "mesh.ply").instance)


def test_what_cannot_move_is_said() -> None:
    with pytest.raises(InputError, match="expected a scene of several rooms"):
        set_in_motion(build_scene("office", 1), "door", 5.0, 1)
    with pytest.raises(InputError, match="expected one of: none, chair"):
        set_in_motion(build_scene("office", 1), "dog", 5.0, 1)


def test_bad_lines_of_bodies_txt_are_named(tmp_path: Path) -> None:
    assert read_bodies(tmp_path) == {}
    (tmp_path / "bodies.txt").write_text("# stamp\n0.0 chair 3 1 2 3 0 0 0\n")
    with pytest.raises(InputError, match="bodies.txt:2: found '0.0 chair 3 1 2 3 0 0 0'"):
        read_bodies(tmp_path)
