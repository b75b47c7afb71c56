"""PLY, trajectory and class files: what was written is what is read, by us and by other programs."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic_map import camera_path, room_arrays

from dsmap.classes import NUM_CLASSES, PALETTE, write_classes
from dsmap.errors import InputError
from dsmap.fusion.exports.ply import read_ply, surfels_of_ply, write_ply
from dsmap.fusion.exports.trajectory import write_trajectory


@pytest.fixture(scope="module")
def room():
    return room_arrays(0.06)


def test_ply_holds_every_surfel(tmp_path, room):
    count = write_ply(tmp_path / "map.ply", room)
    assert count == len(room["weight"])
    back = surfels_of_ply(read_ply(tmp_path / "map.ply"), tmp_path / "map.ply")
    for name in ("position", "normal", "weight", "radius", "label", "t_created", "t_updated"):
        assert np.array_equal(back[name], room[name]), name
    assert np.abs(back["colour"] - room["colour"]).max() <= 0.5 / 255 + 1e-6
    assert [path.name for path in tmp_path.iterdir()] == ["map.ply"], "a temporary file stayed behind"


def test_ply_leaves_out_dead_and_unstable_surfels(tmp_path, room):
    dead = {name: values.copy() for name, values in room.items()}
    dead["weight"][::3] = 0
    assert write_ply(tmp_path / "all.ply", dead) == (dead["weight"] > 0).sum()
    assert write_ply(tmp_path / "stable.ply", dead, min_weight=10) == (dead["weight"] >= 10).sum()
    assert read_ply(tmp_path / "stable.ply")["confidence"].min() >= 10


def test_ply_coloured_by_class_with_probabilities(tmp_path, room):
    probabilities = np.random.default_rng(0).dirichlet(np.ones(NUM_CLASSES - 1), len(room["label"]))
    write_ply(tmp_path / "labels.ply", room, colour="label", probabilities=probabilities.astype(np.float32))
    back = read_ply(tmp_path / "labels.ply")
    rgb = np.stack([back["red"], back["green"], back["blue"]], axis=1)
    assert np.array_equal(rgb, PALETTE[room["label"]])
    assert back["prob_bed"] == pytest.approx(probabilities[:, 0])
    assert back["prob_window"] == pytest.approx(probabilities[:, 12])
    assert sum(name.startswith("prob_") for name in back.dtype.names) == NUM_CLASSES - 1


def test_ply_is_read_by_trimesh(tmp_path, room):
    trimesh = pytest.importorskip("trimesh")
    write_ply(tmp_path / "map.ply", room)
    cloud = trimesh.load(tmp_path / "map.ply", process=False)
    assert np.allclose(cloud.vertices, room["position"])
    assert np.abs(cloud.colors[:, :3] / 255.0 - room["colour"]).max() < 0.01


def test_empty_map_makes_an_empty_ply(tmp_path, room):
    assert write_ply(tmp_path / "map.ply", {name: values[:0] for name, values in room.items()}) == 0
    assert len(read_ply(tmp_path / "map.ply")) == 0


BINARY = b"ply\nformat binary_little_endian 1.0\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"solid cube", "not a PLY file"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0\n", "little-endian"),
        (BINARY + b"element vertex many\nend_header\n", "a count"),
        (BINARY + b"element vertex 9\nproperty float x\nend_header\n1234", "after 1"),
        (BINARY + b"element vertex 1\nproperty list uchar int i\nend_header\n", "plain"),
        (BINARY + b"comment \n" * 300, "end_header"),
    ],
)
def test_foreign_ply_is_a_clear_error(tmp_path, content, message):
    (tmp_path / "x.ply").write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_ply(tmp_path / "x.ply")


def test_ply_of_another_program_is_named(tmp_path):
    header = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nend_header\n"
    (tmp_path / "x.ply").write_bytes(header + b"\0\0\0\0")
    with pytest.raises(InputError, match="not written by dsmap.*radius"):
        surfels_of_ply(read_ply(tmp_path / "x.ply"), "x.ply")
    with pytest.raises(InputError, match="cannot be read"):
        read_ply(tmp_path / "missing.ply")


def test_trajectory_in_the_tum_format(tmp_path):
    rows = camera_path()
    write_trajectory(tmp_path / "trajectory.txt", rows)
    back = np.loadtxt(tmp_path / "trajectory.txt")
    assert back.shape == (len(rows), 8)
    assert back[:, 0] == pytest.approx([row[0] for row in rows], abs=1e-6)
    rotations = Rotation.from_quat(back[:, 4:]).as_matrix()
    for row, line, rotation in zip(rows, back, rotations, strict=True):
        assert line[1:4] == pytest.approx(row[1][:3, 3], abs=1e-6)
        assert np.allclose(rotation, row[1][:3, :3], atol=1e-6)
    write_trajectory(tmp_path / "none.txt", [])
    assert (tmp_path / "none.txt").read_text().startswith("#")


def test_classes_file(tmp_path):
    write_classes(tmp_path / "classes.json")
    records = json.loads((tmp_path / "classes.json").read_text())
    assert len(records) == NUM_CLASSES
    assert records[5] == {"id": 5, "name": "floor", "color": PALETTE[5].tolist()}
