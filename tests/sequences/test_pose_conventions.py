"""Poses in the conventions of other programs: recognised by the depth of a rendered room, named, and read."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dsmap.errors import InputError, InputWarning
from dsmap.frame import Intrinsics
from dsmap.fusion.config import MapConfig
from dsmap.sequences import SequenceWriter, open_sequence
from dsmap.sequences.pose_conventions import conventions, fit_poses, parse_convention, with_convention
from dsmap.tools.cli import run
from dsmap.tools.mapping.checks import check_recording

CAMERA = Intrinsics(96, 72, 80.0, 80.0, 47.5, 35.5)
_AXES = {
    "opengl": np.diag([1.0, -1, -1, 1]),
    "ros": np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]]),
}
"""T_camera_file."""
_PER_METRE = {"millimetres": 1000.0, "centimetres": 100.0}


def true_pose(i: int) -> np.ndarray:
    """A camera that walks into the room and turns about all axes."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0.1 + 0.012 * i, 0.03 * i, 0.3 - 0.02 * i]).as_matrix()
    T[:3, 3] = 0.03 * i, 0.2 - 0.01 * i, 0.04 * i
    return T


def room_depth(T: np.ndarray) -> np.ndarray:
    """Depth [m] of a box-shaped room with a block in it, from a camera inside, float32, shape (H, W)."""
    y, x = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays = np.stack([(x - CAMERA.cx) / CAMERA.fx, (y - CAMERA.cy) / CAMERA.fy, np.ones(x.shape)], axis=-1)
    d, o = rays @ T[:3, :3].T, T[:3, 3]
    walls = np.where(d > 0, np.array([1.6, 1.2, 2.6]) - o, np.array([-1.9, -1.3, -2.0]) - o) / d
    depth = walls.min(axis=-1)
    near, far = (np.array([-0.2, 0.1, 1.6]) - o) / d, (np.array([0.5, 1.2, 2.0]) - o) / d
    enter, leave = np.minimum(near, far).max(axis=-1), np.maximum(near, far).min(axis=-1)
    return np.where((enter > 0) & (enter < leave), np.minimum(depth, enter), depth).astype(np.float32)


def as_file(T: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """A true pose as a program of these conventions writes it, and as a reader of x y z qx qy qz qw takes it."""
    for name in names:
        T = T @ _AXES.get(name, np.eye(4))
    if "world-to-camera" in names:
        T = np.linalg.inv(T)
    T = T.copy()
    for name in names:
        T[:3, 3] *= _PER_METRE.get(name, 1.0)
    if "wxyz" in names:
        x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat()
        T[:3, :3] = Rotation.from_quat([w, x, y, z]).as_matrix()
    return T


def write_room(folder, names=(), frames=12):
    light = np.random.default_rng(0).integers(0, 255, (72, 96, 3), dtype=np.uint8)
    with SequenceWriter(folder, CAMERA, 1000.0) as writer:
        for i in range(frames):
            writer.write(i / 30, light, room_depth(true_pose(i)), T_world_camera=as_file(true_pose(i), names))
    return folder


@pytest.mark.parametrize("names", conventions(), ids=lambda names: ",".join(names) or "standard")
def test_every_convention_is_recognised_and_read(tmp_path, names):
    folder = write_room(tmp_path / "s", names)
    fit = fit_poses(open_sequence(folder))
    assert fit is not None and fit.best > 0.8 and not fit.is_bad
    assert fit.is_other == bool(names) and (set(fit.name.split(",")) == set(names) or not names)
    read = with_convention(open_sequence(folder), fit.name)
    for i in range(len(read)):
        np.testing.assert_allclose(read.T_world_camera(i), true_pose(i), atol=1e-4)


def test_poses_of_a_camera_that_stands_are_left_alone(tmp_path):
    light = np.zeros((72, 96, 3), np.uint8)
    with SequenceWriter(tmp_path / "s", CAMERA, 1000.0) as writer:
        for i in range(6):
            writer.write(i / 30, light, room_depth(true_pose(0)), T_world_camera=true_pose(0))
    fit = fit_poses(open_sequence(tmp_path / "s"))
    assert fit is not None and not fit.is_other and not fit.is_bad


def test_poses_of_another_scene_fit_no_convention(tmp_path):
    with SequenceWriter(tmp_path / "s", CAMERA, 1000.0) as writer:
        for i in range(6):
            depth = np.random.default_rng(i).uniform(1, 3, (72, 96)).astype(np.float32)
            writer.write(i / 30, np.zeros((72, 96, 3), np.uint8), depth, T_world_camera=true_pose(i))
    fit = fit_poses(open_sequence(tmp_path / "s"))
    assert fit is not None and fit.is_bad and not fit.is_other


@pytest.mark.parametrize(
    "text", ["opengl,ros", "openGl,vr", "millimetres,centimetres", "camera-to-world,world-to-camera"]
)
def test_a_convention_that_is_none_is_refused(text):
    with pytest.raises(InputError, match="--pose-convention"):
        parse_convention(text)


def test_map_names_the_convention_and_reads_it(tmp_path, capsys):
    folder = write_room(tmp_path / "s", ("world-to-camera",))
    call = [
        str(folder),
        "--out",
        str(tmp_path / "r"),
        "--poses",
        "given",
        "--segmenter",
        "none",
        "--no-pictures",
    ]
    assert run("map", call) == 2
    assert "expected --pose-convention world-to-camera" in capsys.readouterr().err
    assert not (tmp_path / "r").exists()
    assert run("map", [*call, "--pose-convention", "world-to-camera"]) == 0
    rows = np.loadtxt(tmp_path / "r" / "trajectory.txt")
    np.testing.assert_allclose(rows[:, 1:4], [true_pose(i)[:3, 3] for i in range(12)], atol=1e-3)
    assert run("info", [str(folder)]) == 0
    assert "warning: " in (said := capsys.readouterr().out) and "--pose-convention world-to-camera" in said


def test_a_wrong_convention_is_said_where_poses_are_only_to_compare_with(tmp_path):
    folder = write_room(tmp_path / "s", ("world-to-camera",))
    args = SimpleNamespace(
        path=folder,
        map=SimpleNamespace(poses="track"),
        pose_convention=None,
        spec=SimpleNamespace(kind="none"),
    )
    with pytest.warns(InputWarning, match="expected --pose-convention world-to-camera"):
        check_recording(args, open_sequence(folder), MapConfig())
