"""Recordings in the formats of others, read back by those formats' own rules."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from dsmap.classes import CLASS_NAMES, CLASS_TO_NYU40, NYU40_NAMES, NYU40_TO_13
from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.fusion.exports.coco import export_coco
from dsmap.fusion.exports.nerfstudio import export_nerfstudio
from dsmap.fusion.exports.nyu40 import export_nyu40
from dsmap.sequences import open_sequence
from dsmap.sequences.writer import SequenceWriter
from dsmap.tools import cli

CAMERA = Intrinsics(48, 40, 50.0, 52.0, 23.5, 19.5)
POSE = np.array([[0, 0, 1, 0.5], [1, 0, 0, -1.0], [0, 1, 0, 2.0], [0, 0, 0, 1.0]])


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Two frames: two chairs (instances 3 and 700) on a floor, with a strip of void."""
    rng = np.random.default_rng(5)
    label = np.full((40, 48), CLASS_NAMES.index("floor"))
    label[5:15, 4:14] = label[20:30, 25:45] = CLASS_NAMES.index("chair")
    label[:, :2] = 0
    instance = np.where(label == CLASS_NAMES.index("chair"), 3, 9)
    instance[20:30, 25:45] = 700
    with SequenceWriter(tmp_path / "room", CAMERA) as writer:
        for time in (0.0, 0.1):
            rgb = rng.integers(0, 255, (40, 48, 3), dtype=np.uint8)
            depth = rng.uniform(1, 3, (40, 48))
            writer.write(time, rgb, depth, T_world_camera=POSE, label=label, instance=instance)
    return tmp_path / "room"


def test_nyu40_ids_map_back_to_the_13_classes(recording: Path, tmp_path: Path) -> None:
    sequence = open_sequence(recording)
    assert export_nyu40(sequence, tmp_path / "out") == 2
    image = cv2.imread(str(tmp_path / "out/label40/0.100000.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(NYU40_TO_13[image], sequence.frame(1).label)
    assert NYU40_NAMES[CLASS_TO_NYU40[CLASS_NAMES.index("chair")]] == "chair"
    assert len((tmp_path / "out/label40.txt").read_text().splitlines()) == 4


def test_coco_segments_are_the_pixels_of_their_ids(recording: Path, tmp_path: Path) -> None:
    sequence = open_sequence(recording)
    assert export_coco(sequence, tmp_path / "out") == 2
    content = json.loads((tmp_path / "out/panoptic.json").read_text())
    names = {c["id"]: c["name"] for c in content["categories"]}
    assert len(names) == 13 and not any(c["isthing"] for c in content["categories"] if c["name"] == "wall")
    annotation = content["annotations"][0]
    image = cv2.imread(str(tmp_path / "out/panoptic" / annotation["file_name"]))[..., ::-1].astype(int)
    ids = image[..., 0] + 256 * image[..., 1] + 65536 * image[..., 2]
    label = sequence.frame(0).label
    assert label is not None
    found = []
    for segment in annotation["segments_info"]:
        mask = ids == segment["id"]
        assert mask.sum() == segment["area"]
        assert set(label[mask]) == {segment["category_id"]}
        found.append((names[segment["category_id"]], segment["area"], segment["bbox"]))
    assert (ids[label == 0] == 0).all() and (ids[label > 0] > 0).all()
    assert ("chair", 100, [4, 5, 10, 10]) in found and ("chair", 200, [25, 20, 20, 10]) in found
    assert sorted(name for name, *_ in found) == ["chair", "chair", "floor"]


def test_nerfstudio_camera_sees_the_same_point(recording: Path, tmp_path: Path) -> None:
    sequence = open_sequence(recording)
    assert export_nerfstudio(sequence, tmp_path / "out") == 2
    content = json.loads((tmp_path / "out/transforms.json").read_text())
    frame = content["frames"][1]
    depth = cv2.imread(str(tmp_path / "out" / frame["depth_file_path"]), cv2.IMREAD_UNCHANGED) / 1e3
    u, v = 30, 11
    z = depth[v, u]
    # OpenGL axes and pixel centres at .5, as nerfstudio's convention has them.
    x = (u + 0.5 - content["cx"]) / content["fl_x"] * z
    y = (v + 0.5 - content["cy"]) / content["fl_y"] * z
    theirs = np.array(frame["transform_matrix"]) @ [x, -y, -z, 1]
    ours = sequence.frame(1)
    d = ours.depth[v, u]
    point = [(u - CAMERA.cx) / CAMERA.fx * d, (v - CAMERA.cy) / CAMERA.fy * d, d, 1]
    np.testing.assert_allclose(theirs, POSE @ point, atol=1e-3)
    assert (tmp_path / "out" / frame["file_path"]).is_file()


def test_what_nerfstudio_is_given_is_read_back(recording: Path, tmp_path: Path) -> None:
    sequence = open_sequence(recording)
    export_nerfstudio(sequence, tmp_path / "out")
    again = open_sequence(tmp_path / "out")
    assert again.layout == "transforms.json"
    np.testing.assert_allclose(again.intrinsics.K, CAMERA.K, rtol=0, atol=1e-12)
    for i in range(2):
        ours, theirs = sequence.frame(i), again.frame(i)
        np.testing.assert_array_equal(theirs.rgb, ours.rgb)
        np.testing.assert_allclose(theirs.depth, ours.depth, atol=6e-4)  # whole millimetres
        np.testing.assert_allclose(theirs.T_world_camera, POSE, atol=1e-12)


def test_a_recording_without_labels_or_poses_is_said_to_be_one(tmp_path: Path) -> None:
    with SequenceWriter(tmp_path / "bare", CAMERA) as writer:
        writer.write(0.0, np.zeros((40, 48, 3), np.uint8), np.ones((40, 48)))
    sequence = open_sequence(tmp_path / "bare")
    for export in (export_nyu40, export_coco, export_nerfstudio):
        with pytest.raises(InputError, match="found no"):
            export(sequence, tmp_path / "out")


def test_the_command_wants_a_new_folder(recording: Path, tmp_path: Path) -> None:
    command = [str(recording), str(tmp_path / "coco"), "--to", "coco"]
    assert cli.run("convert", command) == 0
    assert cli.run("convert", command) == 2
