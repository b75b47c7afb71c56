"""Rendered sequences: geometry against the written mesh, determinism, one kernel for all scenes."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from sim_toys import compiled_kernel

from dsmap.errors import InputError
from dsmap.sequences import open_sequence
from dsmap.sim_scenes.recording.record import RenderOptions, render_sequence
from dsmap.sim_scenes.render.renderer import default_camera
from dsmap.sim_scenes.render.warp_renderer import WarpRenderer
from dsmap.sim_scenes.rooms.build import build_scene
from dsmap.tools import cli

SMALL = RenderOptions(scene="living_room", seed=1, frames=8, width=96, height=72, fps=3.0)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight frames, a third of a second apart, without noise."""
    return render_sequence(tmp_path_factory.mktemp("sim") / "room", SMALL)


def every_byte(folder: Path) -> dict[str, bytes]:
    """All files of a folder."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def cast(triangles: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> tuple[float, int]:
    """Nearest front-face hit of one ray with triangles (F, 3, 3): distance, face (Moeller & Trumbore 1997)."""
    a, edge1, edge2 = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    p = np.cross(direction, edge2)
    det = np.einsum("ij,ij->i", edge1, p)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = origin - a
        u = np.einsum("ij,ij->i", s, p) / det
        q = np.cross(s, edge1)
        v = q @ direction / det
        t = np.einsum("ij,ij->i", edge2, q) / det
    hit = (det > 1e-12) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-6)
    t = np.where(hit, t, np.inf)
    return float(t.min()), int(t.argmin())


def test_depth_and_labels_agree_with_casting_rays_at_the_mesh(recording: Path) -> None:
    sequence = open_sequence(recording)
    mesh = trimesh.load(recording / "mesh.ply", process=False)
    label = np.asarray(mesh.metadata["_ply_raw"]["face"]["data"]["label"]).ravel()
    triangles = np.asarray(mesh.triangles, np.float64)
    camera, rng = sequence.intrinsics, np.random.default_rng(0)
    errors, same = [], []
    for index in (0, 3, 7):
        frame = sequence.frame(index)
        for y, x in zip(rng.integers(0, 72, 40), rng.integers(0, 96, 40), strict=True):
            ray = np.array([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0])
            pose = frame.T_world_camera
            depth, face = cast(triangles, pose[:3, 3], pose[:3, :3] @ ray)
            errors.append(abs(depth - frame.depth[y, x]))
            same.append(label[face] == frame.label[y, x])
    assert np.median(errors) < 0.0003
    assert np.percentile(errors, 95) < 0.001
    assert np.mean(same) > 0.97


def test_reprojecting_one_frame_into_another_agrees(recording: Path) -> None:
    sequence = open_sequence(recording)
    camera, compared = sequence.intrinsics, 0
    for i in range(7):
        a, b = sequence.frame(i), sequence.frame(i + 1)
        y, x = np.mgrid[0 : camera.height, 0 : camera.width]
        rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], -1)
        points = (rays * a.depth[..., None]).reshape(-1, 3)
        moved = np.linalg.inv(b.T_world_camera) @ a.T_world_camera
        points = points @ moved[:3, :3].T + moved[:3, 3]
        uv = points[:, :2] / points[:, 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
        column, row = np.rint(uv).astype(int).T
        seen = (points[:, 2] > 0) & (column >= 1) & (column < 95) & (row >= 1) & (row < 71)
        column, row, uv, z = column[seen], row[seen], uv[seen], points[seen, 2]
        # Plane through the neighbours: the reprojected point lies between pixel centres.
        gy, gx = np.gradient(b.depth)
        expected = (
            b.depth[row, column] + gx[row, column] * (uv[:, 0] - column) + gy[row, column] * (uv[:, 1] - row)
        )
        assert np.median(np.abs(expected - z)) < 0.002
        compared += len(z)
    assert compared > 10000


def test_written_calibration_and_description(recording: Path) -> None:
    calibration = yaml.safe_load((recording / "calibration.yaml").read_text())
    assert calibration["cx"] == 47.5 and calibration["cy"] == 35.5
    assert calibration["fx"] == pytest.approx(525 * 96 / 640)
    assert json.loads((recording / "scene.json").read_text())["options"]["seed"] == 1
    sequence = open_sequence(recording)
    assert len(sequence) == 8 and sequence.has_labels
    frame = sequence.frame(0)
    assert (frame.depth > 0.2).mean() > 0.999
    assert frame.rgb.std() > 20 and 40 < frame.rgb.mean() < 190
    assert frame.instance is not None and len(np.unique(frame.instance)) > 4


def test_same_seed_same_bytes_whatever_the_number_of_threads(recording: Path, tmp_path: Path) -> None:
    again = render_sequence(tmp_path / "again", RenderOptions(**{**vars(SMALL), "jobs": 2}))
    assert every_byte(recording) == every_byte(again)


def test_kinect_noise_changes_depth_only(recording: Path, tmp_path: Path) -> None:
    options = RenderOptions(**{**vars(SMALL), "noise": "kinect"})
    noisy = render_sequence(tmp_path / "noisy", options, clean_copy=tmp_path / "clean")
    assert every_byte(tmp_path / "clean") == every_byte(recording)
    before, after = every_byte(recording), every_byte(noisy)
    changed = {name for name in before if before[name] != after[name]}
    depths = {name for name in before if name.startswith("depth/")}
    assert changed == depths | {"scene.json", "calibration.yaml"}  # a sensor has its own range


def test_one_compiled_kernel_serves_all_scenes() -> None:
    keys = set()
    for name, seed in (("living_room", 1), ("bedroom", 5)):
        renderer = WarpRenderer(build_scene(name, seed), default_camera(32, 24))
        renderer(np.eye(4))
        keys.add(compiled_kernel(renderer))
    assert len(keys) == 1


def test_an_existing_sequence_is_kept_and_bad_options_are_named(recording: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="overwrite"):
        render_sequence(recording, SMALL)
    with pytest.raises(InputError, match="frames is 0"):
        render_sequence(tmp_path / "none", RenderOptions(frames=0))
    assert not (tmp_path / "none").exists()


def test_command_line_renders_and_names_what_is_wrong(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small = ["--size", "64x48", "--frames", "2", "--jobs", "1", "--path", "views", "--scene", "bedroom"]
    assert cli.run("render-scene", [str(tmp_path / "room"), *small]) == 0
    assert "2 frames of bedroom seed 1, 64x48" in capsys.readouterr().out
    assert len(open_sequence(tmp_path / "room")) == 2
    assert cli.run("render-scene", [str(tmp_path / "room"), *small]) == 2
    assert "found a sequence there already" in capsys.readouterr().err
    assert cli.run("render-scene", [str(tmp_path / "other"), "--size", "64"]) == 2
    assert "expected WIDTHxHEIGHT" in capsys.readouterr().err
    assert cli.run("render-scene", [str(tmp_path / "other"), "--clean-copy", str(tmp_path / "clean")]) == 2
    assert "--noise" in capsys.readouterr().err
