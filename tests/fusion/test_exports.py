"""Frames, labels and poses of a run: the program each export is for opens it and finds there what the map says."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from corner_frames import FLOOR, FRAMES, WALL, config, record

from dsmap.errors import InputError
from dsmap.fusion.exports import colmap, trajectory
from dsmap.fusion.exports.formats import FORMATS, ExportJob, write
from dsmap.fusion.exports.level import level_transform
from dsmap.fusion.exports.run_frames import RunFrames
from dsmap.fusion.labels.semantics import GroundTruthSegmenter
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.runs.read_run import SavedRun, load_run
from dsmap.fusion.runs.run_folder import save_run
from dsmap.sequences import Sequence, open_sequence
from dsmap.tools import cli
from dsmap.tools.twins.corner import INTRINSICS


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    return record(tmp_path_factory.mktemp("recording") / "corner")


@pytest.fixture(scope="module")
def run(recording, tmp_path_factory) -> SavedRun:
    """The corner, mapped with its own labels."""
    mapper = Mapper(config(device="cpu", poses="given"), INTRINSICS, GroundTruthSegmenter())
    for frame in FRAMES:
        mapper.step(frame)
    folder = tmp_path_factory.mktemp("run")
    save_run(mapper, folder)
    (folder / "config.yaml").write_text(yaml.safe_dump({"sequence": {"path": str(recording)}}))
    return load_run(folder)


@pytest.fixture(scope="module")
def frames(run, recording) -> Sequence:
    return RunFrames(run, open_sequence(recording))


def _seen(frames: RunFrames, run: SavedRun, i: int) -> tuple[np.ndarray, np.ndarray]:
    """Where a frame sees surfels [px, integer centres] (N, 2), and where these lie in the world (N, 3)."""
    index = frames.index(i)
    v, u = np.nonzero(index >= 0)
    _, first, count = np.unique(index[v, u], return_index=True, return_counts=True)
    first = first[count == 1]  # a surfel that covers several pixels lies in none of their centres
    return np.stack([u, v], axis=1)[first], run.surfels.numpy()["position"][index[v[first], u[first]]]


def _alive(run: SavedRun) -> int:
    return int((run.surfels.numpy()["weight"] > 0).sum())


def _hit(found: np.ndarray, pixels: np.ndarray) -> None:
    """Points lie within 1 px of the pixels that see them, and not to one side; but for large discs at the border."""
    off = found - (pixels + 0.5)
    assert (np.abs(off).max(axis=1) <= 1).mean() > 0.97 and np.abs(np.median(off, axis=0)).max() < 0.15


def test_nerfstudio_projects_the_map_into_its_pixels(tmp_path, run, frames):
    job = ExportJob(run, lambda: open_sequence(frames.path))
    assert "14 images" in write("nerfstudio", job, tmp_path / "out")
    content = json.loads((tmp_path / "out" / "transforms.json").read_text())
    assert content["camera_model"] == "OPENCV" and len(content["frames"]) == len(FRAMES)
    for frame in content["frames"]:
        assert (tmp_path / "out" / frame["file_path"]).exists() and (
            tmp_path / "out" / frame["depth_file_path"]
        ).exists()
    pixels, world = _seen(frames, run, 5)
    T = np.array(content["frames"][5]["transform_matrix"])
    local = np.linalg.inv(T) @ np.c_[world, np.ones(len(world))].T
    x = content["fl_x"] * local[0] / -local[2] + content["cx"]
    y = content["fl_y"] * -local[1] / -local[2] + content["cy"]
    _hit(np.stack([x, y], axis=1), pixels)
    trimesh = pytest.importorskip("trimesh")
    assert len(trimesh.load(tmp_path / "out" / content["ply_file_path"]).vertices) == _alive(run)


def test_colmap_projects_the_map_into_its_pixels(tmp_path, run, frames):
    pycolmap = pytest.importorskip("pycolmap")
    write("colmap", ExportJob(run, lambda: open_sequence(frames.path)), tmp_path / "out")
    model = pycolmap.Reconstruction(str(tmp_path / "out" / "sparse" / "0"))
    assert model.num_images() == len(FRAMES)
    assert model.num_points3D() == _alive(run)
    assert model.compute_mean_track_length() > 2 and model.compute_mean_reprojection_error() < 0.01
    image = next(image for image in model.images.values() if image.name == "000005.png")
    assert (tmp_path / "out" / "images" / image.name).exists()
    pixels, world = _seen(frames, run, 5)
    found = np.array([image.project_point(point) for point in world.astype(np.float64)])
    _hit(found, pixels)


LENSES = {
    "radtan": (0.1, -0.05, 0.001, 0.002, 0.01),
    "rational": (0.1, -0.05, 0.0, 0.0, 0.01, 0.2, 0.1, 0.02),
    "fisheye": (0.02, -0.01, 0.004, -0.001),
}


@pytest.mark.parametrize("distortion", LENSES.values(), ids=LENSES)
def test_a_distorted_camera_is_colmaps_camera(tmp_path, distortion):
    pycolmap, rays = pytest.importorskip("pycolmap"), np.array([[0.2, -0.3, 1.0], [-0.4, 0.1, 1.0]])
    text = colmap._camera(replace(INTRINSICS, distortion=distortion))
    (tmp_path / "cameras.txt").write_text(text + "\n")
    for name in ("images.txt", "points3D.txt"):
        (tmp_path / name).write_text("")
    found = pycolmap.Reconstruction(str(tmp_path)).cameras[1].img_from_cam(rays)
    project = cv2.fisheye.projectPoints if len(distortion) == 4 else cv2.projectPoints
    points = rays[:, None] if len(distortion) == 4 else rays
    expected = project(points, np.zeros(3), np.zeros(3), INTRINSICS.K, np.array(distortion))[0].reshape(-1, 2)
    assert np.allclose(found, expected + 0.5, atol=1e-6)


def test_labels_2d_is_the_map_in_every_frame(tmp_path, run, frames, recording):
    write("labels-2d", ExportJob(run, lambda: open_sequence(recording)), tmp_path / "out")
    written = open_sequence(tmp_path / "out")
    assert len(written.labelled()) == len(FRAMES) and written.has_poses
    for i in (0, 9):
        label = written.label(i)
        assert label is not None and np.array_equal(label, frames.label(i))
        truth = FRAMES[i].label
        assert set(np.unique(label)) <= {0, WALL, FLOOR} and (label == truth)[label > 0].mean() > 0.97
    assert cli.run("convert", [str(tmp_path / "out"), str(tmp_path / "coco"), "--to", "coco"]) == 0
    assert (tmp_path / "coco" / "panoptic.json").exists()


def test_labels_2d_scores_as_the_map_does(tmp_path, run, recording):
    write("labels-2d", ExportJob(run, lambda: open_sequence(recording)), tmp_path / "out")
    for most in ([], ["--max-frames", "5"]):
        assert cli.run("evaluate", [str(run.path), "--out", str(tmp_path / "map.json"), *most]) == 0
        argv = ["--data", str(recording), "--labels", str(tmp_path / "out"), *most]
        assert cli.run("evaluate", [*argv, "--out", str(tmp_path / "labels.json")]) == 0
        of_map = json.loads((tmp_path / "map.json").read_text())["semantics"]
        of_labels = json.loads((tmp_path / "labels.json").read_text())
        assert of_labels["frames"] == of_map["frames"] == (5 if most else len(FRAMES))
        assert of_labels["coverage"] == of_map["coverage"] > 0.9
        for name in ("class_avg", "pixel_acc", "miou", "per_class"):
            assert of_labels["labels"][name] == of_map["map_only"][name], name
        assert of_labels["labels"]["pixel_acc"] < 1, "a map is not the truth"


def test_trajectories_are_read_by_evo(tmp_path, run):
    program = shutil.which("evo_traj", path=str(Path(sys.executable).parent))
    if program is None:
        pytest.skip("evo is not installed")
    for kind in trajectory.TRAJECTORY_WRITERS:
        out = tmp_path / f"{kind}.txt"
        write("trajectory", ExportJob(run, lambda: None, type=kind), out)
        env = {"HOME": str(tmp_path), "MPLBACKEND": "agg"}
        done = subprocess.run([program, kind, str(out), "-v"], capture_output=True, text=True, env=env)
        assert done.returncode == 0 and f"{len(FRAMES)} poses" in done.stdout.replace(
            "nr. of poses\t14", "14 poses"
        ), done


def test_trajectories_hold_the_same_poses(tmp_path, run):
    for kind in trajectory.TRAJECTORY_WRITERS:
        write("trajectory", ExportJob(run, lambda: None, type=kind), tmp_path / kind)
    tum, kitti = np.loadtxt(tmp_path / "tum"), np.loadtxt(tmp_path / "kitti").reshape(-1, 3, 4)
    euroc = np.loadtxt(tmp_path / "euroc", delimiter=",")
    assert np.allclose(kitti, run.poses[:, :3], atol=1e-6)
    assert np.allclose(tum[:, 1:4], kitti[:, :, 3], atol=1e-6) and np.allclose(euroc[:, 1:4], tum[:, 1:4])
    assert np.allclose(euroc[:, [5, 6, 7, 4]], tum[:, 4:], atol=1e-6)
    assert np.allclose(euroc[:, 0] / 1e9, tum[:, 0], atol=1e-6)


def test_rerun_reads_its_recording(tmp_path, run, recording):
    rerun = pytest.importorskip("rerun")
    write("rerun", ExportJob(run, lambda: open_sequence(recording), type="rrd"), tmp_path / "run.rrd")
    program = [sys.executable, "-m", "rerun"]
    done = subprocess.run(
        [*program, "rrd", "verify", str(tmp_path / "run.rrd")], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    done = subprocess.run(
        [*program, "rrd", "print", str(tmp_path / "run.rrd")], capture_output=True, text=True
    )
    for entity in ("/world/map", "/world/labels", "/world/camera", "/world/camera/image", "/world/path"):
        assert entity in done.stdout, (
            f"{entity} is not in the recording that rerun {rerun.__version__} prints"
        )


def test_the_level_frame_has_its_floor_at_zero(run):
    T = level_transform(run)
    assert np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3)) and np.linalg.det(T[:3, :3]) == pytest.approx(1)


def test_the_command_writes_every_format_without_a_further_package(run, tmp_path, capsys):
    for name, form in FORMATS.items():
        if name == "rerun":
            continue
        out = tmp_path / (name if not form.types else f"{name}.{form.suffix or form.types[0]}")
        argv = [str(run.path), "--to", name, "--out", str(out), "--stride", "5", "--cell", "0.04"]
        assert cli.run("export", argv) == 0, name
        assert out.exists() and str(out) in capsys.readouterr().out
    assert not list(tmp_path.rglob("*.tmp*"))


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--to", "mesh", "--type", "stl"], "expected one of: ply, obj, glb"),
        (["--to", "mesh", "--out", "mesh.stl"], "--out ends in .stl"),
        (["--to", "colmap", "--type", "ply"], "writes a folder"),
        (["--to", "mesh", "--cell", "-1"], "--cell is -1"),
        (["--to", "colmap", "--stride", "0"], "--stride is 0"),
        (["--to", "colmap", "--recording", "nowhere"], "nowhere"),
    ],
)
def test_wrong_flags_are_one_sentence(run, capsys, flags, message):
    assert cli.run("export", [str(run.path), *flags]) == 2
    said = capsys.readouterr().err
    assert message in said and said.count("\n") == 1


def test_a_recording_alone_has_no_mesh(recording, tmp_path):
    job = ExportJob(None, lambda: open_sequence(recording), type="ply")
    with pytest.raises(InputError, match="needs a map"):
        write("mesh", job, tmp_path / "mesh.ply")
    write("trajectory", replace(job, type="kitti"), tmp_path / "poses.txt")
    assert len((tmp_path / "poses.txt").read_text().splitlines()) == len(FRAMES)
