"""`dsmap info` and `dsmap cut`."""

import cv2
import numpy as np
import pytest
from conftest import shared_data
from sequence_files import CAMERA, colour, depth, pose, write_redwood, write_seven_scenes, write_tum

from dsmap.classes import NYU40_TO_13
from dsmap.sequences import SequenceWriter, open_sequence
from dsmap.sequences.bodies import write_bodies
from dsmap.sequences.mesh import LabelledMesh, write_mesh
from dsmap.tools.cli import run


def test_info_says_what_was_understood(tmp_path, capsys):
    assert run("info", [str(write_tum(tmp_path / "s", labels=True))]) == 0
    printed = capsys.readouterr().out
    for words in (
        "tum",
        "64x48",
        "fx 60",
        "calibration.yaml",
        "1000 units",
        "6 over 0.17 s",
        "labels",
        "6 frames",
    ):
        assert words in printed
    assert "warning" not in printed


def test_info_warns_of_a_wrong_scale_and_names_gaps(tmp_path, capsys):
    folder = tmp_path / "s"
    with SequenceWriter(folder, CAMERA, 1000.0) as writer:
        for i, t in enumerate((0.0, 0.1, 0.2, 0.3, 1.3, 1.4)):
            writer.write(t, colour(i), depth(i))
    assert run("info", [str(folder), "--depth-scale", "10"]) == 0
    printed = capsys.readouterr().out
    assert "the depth scale is probably wrong" in printed and "--depth-scale" in printed
    assert "1 longer than 3 median intervals: 1.00 s after 0.300" in printed


def test_info_names_what_moves(tmp_path, capsys):
    folder = write_tum(tmp_path / "s")
    poses = np.tile(np.eye(4), (6, 1, 1, 1))
    write_bodies(folder, np.arange(6) / 30, ["chair"], [3], poses)
    assert run("info", [str(folder)]) == 0
    assert "chair (instance 3, 6 poses)" in capsys.readouterr().out
    (folder / "bodies.txt").write_text("0.0 chair three\n")
    assert run("info", [str(folder)]) == 0
    assert "warning: " in (printed := capsys.readouterr().out) and "bodies.txt:1" in printed


def test_info_of_a_bad_folder_exits_with_2(tmp_path, capsys):
    assert run("info", [str(tmp_path)]) == 2
    assert "looked for rgb.txt" in capsys.readouterr().err


def test_a_cut_holds_the_stretch_and_the_bytes(tmp_path, capsys):
    source = write_tum(tmp_path / "s", frames=30, labels=True)
    one = np.zeros((1, 3))
    write_mesh(
        source / "mesh.ply", LabelledMesh(one.astype(np.float32), one.astype(np.int32), np.ones(1, np.uint8))
    )
    assert run("cut", [str(source), str(tmp_path / "c"), "--start", "0.2", "--seconds", "0.5"]) == 0
    assert "15 rgb" in capsys.readouterr().out
    whole, cut = open_sequence(source), open_sequence(tmp_path / "c")
    assert len(cut) == 15 and cut.intrinsics == whole.intrinsics and (tmp_path / "c" / "mesh.ply").exists()
    for i in range(15):
        a, b = whole.frame(6 + i), cut.frame(i)
        assert a.time == b.time and (a.label == b.label).all() and (a.instance == b.instance).all()
        np.testing.assert_allclose(a.T_world_camera, b.T_world_camera, atol=1e-6)
    assert cut.entries[3].rgb.read_bytes() == whole.entries[9].rgb.read_bytes()


@pytest.mark.parametrize("write", [write_seven_scenes, write_redwood])
def test_other_layouts_are_cut_into_tum_sequences(tmp_path, write):
    source = write(tmp_path / "s", frames=8)
    assert run("cut", [str(source), str(tmp_path / "c"), "--seconds", "0.15"]) == 0
    cut = open_sequence(tmp_path / "c")
    assert (cut.layout, len(cut)) == ("tum", 5)
    assert cut.calibration.intrinsics == open_sequence(source).calibration.intrinsics
    np.testing.assert_array_equal(cut.frame(4).depth, open_sequence(source).frame(4).depth)
    np.testing.assert_allclose(cut.T_world_camera(4), pose(4), atol=1e-6)


def test_a_cut_of_labels_of_another_set_holds_the_13_classes_or_none(tmp_path, capsys):
    source = write_tum(tmp_path / "s", labels=True)
    for k, file in enumerate(sorted((source / "label").iterdir())):
        cv2.imwrite(str(file), np.full((48, 64), 20 + k, np.uint8))
    assert run("cut", [str(source), str(tmp_path / "a"), "--label-map", "nyu40"]) == 0
    cut = open_sequence(tmp_path / "a")
    assert [int(frame.label[0, 0]) for frame in cut] == [int(NYU40_TO_13[20 + k]) for k in range(6)]
    assert run("cut", [str(source), str(tmp_path / "b")]) == 0
    assert "note: labels are not used: found the ids 20" in capsys.readouterr().out
    assert not (tmp_path / "b" / "label").exists() and not (tmp_path / "b" / "classes.json").exists()


def test_a_cut_of_images_of_one_stamp_keeps_them_apart(tmp_path):
    source = write_tum(tmp_path / "s")
    for name in ("rgb", "depth"):
        lines = (source / f"{name}.txt").read_text().splitlines()
        rows = [f"0.000000 {line.split()[1]}" for line in lines if not line.startswith("#")]
        (source / f"{name}.txt").write_text("\n".join(rows))
    whole = open_sequence(source)
    assert any("5 of 6 stamps are that of the image before" in note for note in whole.notes)
    assert run("cut", [str(source), str(tmp_path / "c")]) == 0
    for a, b in zip(whole, open_sequence(tmp_path / "c"), strict=True):
        assert np.array_equal(a.rgb, b.rgb) and np.array_equal(a.depth, b.depth)


def test_cuts_that_cannot_be_made(tmp_path, capsys):
    source = write_tum(tmp_path / "s")
    for options, words in (
        ([str(source)], "already"),
        ([str(tmp_path / "c"), "--start", "100"], "no colour image"),
        ([str(tmp_path / "c"), "--seconds", "-1"], "expected above 0"),
    ):
        assert run("cut", [str(source), *options]) == 2
        assert words in capsys.readouterr().err


def test_cutting_the_real_recording_keeps_its_pairs(tmp_path):
    source = shared_data("tum_fr1_xyz_10s")
    assert run("cut", [str(source), str(tmp_path / "c"), "--seconds", "10"]) == 0
    assert len(open_sequence(tmp_path / "c")) == 300
