"""Evaluation of a run on a scene whose every number is known: a wall and a floor, poses given."""

import json
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
import warp as wp

from dsmap.classes import CLASS_NAMES
from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.fusion.evaluate.run import evaluate_run
from dsmap.fusion.evaluate.semantics import evaluate_network, off_edges
from dsmap.fusion.evaluate.trajectory import back_project, point_to_plane
from dsmap.fusion.labels.semantics import GroundTruthSegmenter
from dsmap.fusion.runs.read_run import load_run
from dsmap.kernels.mesh_distance import closest_on_mesh
from dsmap.metrics import align_se3
from dsmap.sequences import SequenceWriter, open_sequence
from dsmap.sequences.mesh import LabelledMesh, write_mesh
from dsmap.tools.cli import run as command
from dsmap.tools.commands.evaluate import labelled_images

CAMERA = Intrinsics(128, 96, 120.0, 120.0, 63.5, 47.5)
FRAMES = 16
WALL, FLOOR = CLASS_NAMES.index("wall"), CLASS_NAMES.index("floor")
WALL_Z, FLOOR_Y = 2.0, 0.6
START = align_se3(np.eye(3), np.array([[0.3, 0.1, 2], [0.3, 1.1, 2], [-0.7, 0.1, 2]]))  # any pose at all


def view(i: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Colour, depth, label and pose (in the scene's frame: wall at z = 2 m, floor at y = 0.6 m) of frame i."""
    centre = np.array([0.015 * i, -0.01 * np.sin(i), 0.01 * i])
    x = (np.arange(128) - CAMERA.cx) / CAMERA.fx
    y = (np.arange(96) - CAMERA.cy)[:, None] / CAMERA.fy + 0 * x
    to_wall = np.full((96, 128), WALL_Z - centre[2])
    to_floor = np.where(y > 0, (FLOOR_Y - centre[1]) / np.maximum(y, 1e-9), np.inf)
    depth = np.minimum(to_wall, to_floor)
    label = np.where(to_floor < to_wall, FLOOR, WALL).astype(np.uint8)
    stripes = 40 * np.sin(20 * (x * depth + centre[0])) + 40 * np.sin(20 * (y * depth + centre[1]))
    rgb = np.clip(np.stack([stripes + 100 + 10 * label] * 3, axis=-1), 0, 255).astype(np.uint8)
    T = np.eye(4)
    T[:3, 3] = centre
    return rgb, depth, label, T


def write_scene(folder) -> None:
    corners = np.array([[-4, -4, 2], [4, -4, 2], [4, 0.6, 2], [-4, 0.6, 2], [-4, 0.6, -1], [4, 0.6, -1]])
    corners = corners @ START[:3, :3].T + START[:3, 3]
    faces = np.array([[0, 1, 2], [0, 2, 3], [3, 2, 5], [3, 5, 4]], dtype=np.int32)
    with SequenceWriter(folder, CAMERA, 5000.0, depth_max=5.0) as writer:
        for i in range(FRAMES):
            rgb, depth, label, T = view(i)
            writer.write(i / 10, rgb, depth, T_world_camera=START @ T, label=label)
    mesh = LabelledMesh(corners.astype(np.float32), faces, np.array([WALL, WALL, FLOOR, FLOOR], np.uint8))
    write_mesh(folder / "mesh.ply", mesh)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A recording, and a run of it with given poses and 40 % wrong labels."""
    folder = tmp_path_factory.mktemp("evaluate")
    write_scene(folder / "scene")
    options = ["--poses", "given", "--segmenter", "labels", "--label-noise", "0.4", "--no-pictures"]
    options += ["--segment-every", "1"]  # noise of its own in every frame: each one counts
    assert command("map", [str(folder / "scene"), "--out", str(folder / "run"), *options]) == 0
    return folder


@pytest.fixture
def run(scene):
    return load_run(scene / "run")


@pytest.fixture
def reference(scene):
    return open_sequence(scene / "scene")


def test_the_command_prints_and_writes_every_key(scene, capsys):
    assert command("evaluate", [str(scene / "run"), "--reference", str(scene / "scene")]) == 0
    printed = capsys.readouterr().out
    assert "ATE RMSE" in printed and "network alone" in printed and "floor" in printed
    metrics = json.loads((scene / "run" / "metrics.json").read_text())
    trajectory, surface, semantics = metrics["trajectory"], metrics["surface"], metrics["semantics"]
    assert trajectory["tracked_fraction"] == 1.0
    assert trajectory["ate_rmse_m"] < 1e-6 and trajectory["ate_rmse_unaligned_m"] < 1e-6
    assert trajectory["rpe_trans_rmse_m"] < 1e-6
    assert surface["accuracy_mean_m"] < 0.002 and surface["completeness_5cm"] > 0.97
    assert surface["accuracy_mean_unaligned_m"] == pytest.approx(surface["accuracy_mean_m"], abs=1e-4)
    assert surface["fscore_5cm"] > 0.98
    assert 0.55 < semantics["single_frame"]["class_avg"] < 0.65, "40 % of the labels are wrong"
    assert semantics["map"]["class_avg"] > 0.95 and semantics["map_only_off_edges"]["class_avg"] > 0.97
    assert semantics["surfels"]["class_avg"] > 0.98
    assert semantics["coverage"] > 0.95 and semantics["frames"] == FRAMES
    lost = 1 - semantics["coverage"]
    assert semantics["map_only"]["pixel_acc"] <= semantics["map"]["pixel_acc"] <= 1 - lost * 0.3
    for key in ("single_frame", "map", "map_only"):
        assert {"class_avg", "pixel_acc", "miou", "per_class", "ece"} <= semantics[key].keys()
        assert 0 <= semantics[key]["ece"] <= 1
    assert semantics["single_frame"]["ece"] < 0.05, "these probabilities are honest"
    assert {"frames", "surfels", "graph_nodes", "local_loops", "global_loops"} <= metrics["map"].keys()
    assert {"fps", "stages_ms", "peak_rss_bytes"} <= metrics["speed"].keys()
    assert metrics["map"]["frames"] == FRAMES


def test_scores_do_not_depend_on_the_world_frame(run, reference):
    """A run in its own world, as tracking makes them, scores the same after alignment."""
    before = evaluate_run(run, reference)
    T = np.linalg.inv(START)
    position = run.surfels.numpy()["position"] @ T[:3, :3].T + T[:3, 3]
    normal = run.surfels.numpy()["normal"] @ T[:3, :3].T
    count = run.surfels.count
    run.surfels.position[:count].assign(wp.array(position.astype(np.float32), dtype=wp.vec3))
    run.surfels.normal[:count].assign(wp.array(normal.astype(np.float32), dtype=wp.vec3))
    after = evaluate_run(replace(run, poses=T @ run.poses), reference)
    assert after["trajectory"]["ate_rmse_m"] < 1e-6
    for path in (("surface", "accuracy_mean_m"), ("surface", "completeness_5cm")):
        assert after[path[0]][path[1]] == pytest.approx(before[path[0]][path[1]], abs=2e-4)
    old, new = (m["semantics"]["map_only"]["class_avg"] for m in (before, after))
    assert new == pytest.approx(old, abs=5e-3)


def test_a_displaced_map_and_trajectory_are_noticed(run, reference):
    before = evaluate_run(run, reference)
    count = run.surfels.count
    shift = START[:3, 2] * 0.03  # 3 cm behind the wall, along the floor
    position = run.surfels.numpy()["position"] + shift.astype(np.float32)
    run.surfels.position[:count].assign(wp.array(position, dtype=wp.vec3))
    poses = run.poses.copy()
    poses[:, :3, 3] += np.random.default_rng(0).normal(size=(FRAMES, 3)) * 0.05
    after = evaluate_run(replace(run, poses=poses, tracked=run.tracked & (np.arange(FRAMES) != 3)), reference)
    assert after["trajectory"]["tracked_fraction"] == pytest.approx(15 / 16)
    assert 0.04 < after["trajectory"]["ate_rmse_m"] < 0.1
    assert after["surface"]["accuracy_mean_m"] > before["surface"]["accuracy_mean_m"] + 0.005
    assert after["semantics"]["map"]["reason"].startswith("no network")


def test_what_has_no_ground_truth_is_null_with_a_reason(scene, run, tmp_path):
    bare = tmp_path / "bare"
    shutil.copytree(scene / "scene", bare)
    for name in ("groundtruth.txt", "label.txt", "mesh.ply"):
        (bare / name).unlink()
    metrics = evaluate_run(replace(run, stats={}), open_sequence(bare))
    assert metrics["trajectory"]["tracked_fraction"] == 1.0
    for group, key in (
        ("trajectory", "ate_rmse_m"),
        ("surface", "accuracy_mean_m"),
        ("surface", "completeness_5cm"),
        ("map", "frames"),
        ("speed", "fps"),
        ("semantics", "coverage"),
    ):
        assert metrics[group][key] is None and metrics[group]["reason"], (group, key)
    for key in ("single_frame", "map", "map_only", "surfels"):
        assert metrics["semantics"][key]["class_avg"] is None and metrics["semantics"][key]["reason"]


def test_labels_of_two_frames_suffice(scene, run, tmp_path):
    few = tmp_path / "few"
    shutil.copytree(scene / "scene", few)
    lines = (few / "label.txt").read_text().splitlines()
    (few / "label.txt").write_text("\n".join([*lines[:2], lines[5], lines[11]]) + "\n")
    semantics = evaluate_run(run, open_sequence(few), GroundTruthSegmenter(0.4))["semantics"]
    assert semantics["frames"] == 2 and semantics["map"]["class_avg"] > 0.95


def test_max_frames_are_spread_over_the_labels(run, reference):
    assert evaluate_run(run, reference, max_frames=5)["semantics"]["frames"] == 5


def test_another_recording_is_refused(scene, run, tmp_path):
    other = tmp_path / "other"
    with SequenceWriter(other, CAMERA, 5000.0) as writer:
        rgb, depth, _, T = view(0)
        writer.write(999.0, rgb, depth, T_world_camera=T)
    with pytest.raises(InputError, match="expected the recording that was mapped"):
        evaluate_run(run, open_sequence(other))


def test_bad_runs_and_options_exit_with_2(scene, tmp_path, capsys):
    foreign = tmp_path / "foreign"
    foreign.mkdir()
    (foreign / "checkpoint.safetensors").write_bytes(b"something else")
    for argv, words in (
        ([str(tmp_path / "none")], "no such folder"),
        ([str(foreign)], "checkpoint"),
        ([], "RUN folder, or --data"),
        ([str(scene / "run"), "--data", str(tmp_path)], "either"),
    ):
        assert command("evaluate", argv) == 2
        assert words in capsys.readouterr().err


def test_a_network_alone_on_a_folder_of_images(scene, tmp_path):
    for name in ("rgb", "label"):
        (tmp_path / name).mkdir()
    for i in (0, 5):
        rgb, _, label, _ = view(i)
        cv2.imwrite(str(tmp_path / "rgb" / f"{i:04d}.jpg"), rgb)
        cv2.imwrite(str(tmp_path / "label" / f"{i:04d}.png"), label)

    # A coarse answer is enlarged to the labels' size.
    everything_is_wall = np.zeros((6, 8, 14), dtype=np.float32)
    everything_is_wall[..., WALL] = 1
    answers = ((everything_is_wall, example.label) for _, example in labelled_images(tmp_path))
    tree, frames = evaluate_network(answers)
    wall = np.mean([(view(i)[2] == WALL).mean() for i in (0, 5)])
    assert frames == 2 and tree["pixel_acc"] == pytest.approx(wall) and tree["class_avg"] == 0.5
    assert tree["ece"] == pytest.approx(1 - wall) and tree["per_class"]["wall"]["iou"] == pytest.approx(wall)
    with pytest.raises(InputError, match="no labelled image; expected rgb/ and label/"):
        (tmp_path / "empty" / "label").mkdir(parents=True)
        list(labelled_images(tmp_path / "empty"))
    assert len(list(labelled_images(scene / "scene"))) == FRAMES


def test_point_to_plane_measures_the_offset_along_the_normal():
    depth = np.full((96, 128), 2.0, dtype=np.float32)
    T = np.eye(4)
    T[:3, 3] = (0.05, 0.0, 0.02)  # along the wall, and 2 cm towards it
    assert point_to_plane(depth, depth, T, CAMERA) == pytest.approx(0.02, abs=1e-6)
    T[:3, 3] = (5.0, 0.0, 0.0)
    assert point_to_plane(depth, depth, T, CAMERA) is None, "no overlap"
    assert point_to_plane(0 * depth, depth, np.eye(4), CAMERA) is None


def test_back_projection_is_the_inverse_of_projection():
    depth = view(3)[1]
    points = back_project(depth, CAMERA)
    np.testing.assert_allclose(
        CAMERA.fx * points[..., 0] / points[..., 2] + CAMERA.cx, np.arange(128)[None] + 0 * depth, atol=1e-9
    )
    np.testing.assert_allclose(points[..., 2], depth)


def test_the_band_along_edges_is_three_pixels_on_both_sides():
    label = np.zeros((20, 20), np.uint8)
    label[:, 10:] = 1
    inner = off_edges(label)
    assert np.flatnonzero(~inner[5]).tolist() == [7, 8, 9, 10, 11, 12]


def test_closest_points_on_a_mesh_against_brute_force():
    rng = np.random.default_rng(0)
    vertices = rng.random((12, 3)).astype(np.float32)
    faces = rng.permutation(12).reshape(4, 3).astype(np.int32)
    points = rng.random((50, 3)) * 2 - 0.5
    a, b = (axis.reshape(-1) / 99 for axis in np.mgrid[:100, :100])
    weights = np.stack([a, b, 1 - a - b], axis=1)[a + b <= 1]  # a grid over the triangle, edges included
    samples = np.einsum("sk,fkd->fsd", weights, vertices[faces])  # dense points on every triangle
    nearest = np.stack([np.linalg.norm(samples - p, axis=-1).min(axis=1) for p in points])
    distance, face, closest = closest_on_mesh(points, vertices, faces, max_distance=10.0)
    np.testing.assert_allclose(distance, nearest.min(axis=1), atol=2e-3)
    assert (distance <= nearest.min(axis=1) + 1e-6).all()
    np.testing.assert_allclose(np.linalg.norm(closest - points, axis=1), distance, atol=1e-6)
    assert (nearest[np.arange(50), face] <= nearest.min(axis=1) + 2e-3).all()
    far, no_face, _ = closest_on_mesh(points, vertices, faces, max_distance=0.05)
    assert ((no_face == -1) == (distance > 0.05)).all() and (far[no_face == -1] == np.float32(0.05)).all()
