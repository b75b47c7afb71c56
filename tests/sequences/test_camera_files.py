"""The camera of a file in the spellings of people's programs, and of a folder in which several files lie."""

import io
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from sequence_files import write_redwood, write_seven_scenes, write_tum

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sequences import open_sequence
from dsmap.sequences.camera_files import camera_in

FX, FY, CX, CY = 90.0, 91.25, 47.2, 35.9
SIZE = (96, 72)
K = np.array([[FX, 0, CX], [0, FY, CY], [0, 0, 1]])
ROWS = f"{FX} 0 {CX}\n0 {FY} {CY}\n0 0 1\n"
NAMED = {"fx": FX, "fy": FY, "cx": CX, "cy": CY}


def saved(save, **arrays) -> bytes:
    file = io.BytesIO()
    save(file, *([] if arrays else [K]), **arrays)
    return file.getvalue()


OST = f"""# oST version 5.0 parameters

[image]

width
96

height
72

[narrow_stereo]

camera matrix
{FX} 0.000000 {CX}
0.000000 {FY} {CY}
0.000000 0.000000 1.000000

distortion
0.0 0.0 0.0 0.0 0.0

rectification
1.0 0.0 0.0
"""
OPENCV = f"""%YAML:1.0
---
cameraMatrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ {FX}, 0., {CX}, 0., {FY},
       {CY}, 0., 0., 1. ]
"""
XML = f"""<?xml version="1.0"?>
<opencv_storage><camera_matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>
<data>{FX} 0. {CX} 0. {FY} {CY} 0. 0. 1.</data></camera_matrix></opencv_storage>
"""
ITEMS = "".join(f"- {v}\n" for v in K.ravel())
INFO = f"height: 72\nwidth: 96\nk:\n{ITEMS}---\nheight: 1\n"  # ros2 topic echo
FILES: dict[str, tuple[str, str | bytes]] = {
    "flat": ("a.json", json.dumps(NAMED)),
    "text for numbers": ("a.json", json.dumps({key: str(v) for key, v in NAMED.items()})),
    "nested": ("a.json", json.dumps({"device": "D435", "camera": {"K": K.tolist()}})),
    "colour after depth": (
        "a.json", json.dumps({"depth": {**NAMED, "fx": 70}, "color": NAMED, "depth_scale": 0.001}),
    ),
    "bare matrix": ("a.json", json.dumps(K.tolist())),
    "by columns": ("a.json", json.dumps({"intrinsic_matrix": K.T.ravel().tolist()})),
    "points": ("a.json", json.dumps({"focal_length": [FX, FY], "principal_point": [CX, CY]})),
    "realsense": ("a.json", json.dumps({"fx": FX, "fy": FY, "ppx": CX, "ppy": CY, "coeffs": [0] * 5})),
    "heading": ("a.txt", f"fx fy cx cy\n{FX} {FY} {CX} {CY}\n"),
    "windows lines": ("a.txt", f"# fx fy cx cy\r\n{FX} {FY} {CX} {CY}\r\n\r\n\r\n"),
    "one line": ("a.txt", f"fx={FX} fy={FY} cx={CX} cy={CY}\n"),
    "colons and commas": ("a.txt", f"fx: {FX}, fy: {FY}, cx: {CX}, cy: {CY}\n"),
    "no sign": ("a.txt", f"fx {FX}\nfy {FY}\ncx {CX}\ncy {CY}\n"),
    "sections": ("a.ini", f"[camera]\nwidth = 96\nfx = {FX}\nfy = {FY}\ncx = {CX}\ncy = {CY}\n"),
    "printed": ("a.txt", f"[[{FX} 0. {CX}]\n [0. {FY} {CY}]\n [0. 0. 1.]]\n"),
    "repr": ("a.txt", f"array([[{FX}, 0., {CX}],\n [0., {FY}, {CY}],\n [0., 0., 1.]])\n"),
    "savetxt": ("a.csv", "\n".join(",".join(f"{v:.18e}" for v in row) for row in K)),
    "semicolons": ("a.csv", "\n".join(";".join(f"{v:.6f}" for v in row) for row in K)),
    "decimal commas": ("a.txt", ROWS.replace(".", ",").replace(" ", "\t")),
    "label": ("a.txt", f"K: {FX} 0 {CX} 0 {FY} {CY} 0 0 1\n"),
    "kitti": ("a.txt", f"P0: {FX} 0 {CX} 0 0 {FY} {CY} 0 0 0 1 0\nTr: 1 0 0 0 0 1 0 0 0 0 1 0\n"),
    "utf-16": ("a.txt", ("\ufeff" + ROWS).encode("utf-16")),
    "four columns": ("a.txt", f"{FX} 0 {CX} 0\n0 {FY} {CY} 0\n0 0 1 0\n0 0 0 1\n"),
    "size first": ("a.txt", f"96 72\n{FX} {FY} {CX} {CY}\n"),
    "size last": ("a.txt", f"{FX} {FY} {CX} {CY} 96 72\n"),
    "colmap": ("cameras.txt", f"# Camera list\n1 PINHOLE 96 72 {FX} {FY} {CX + 0.5} {CY + 0.5}\n"),
    "ost": ("ost.txt", OST),
    "orb-slam 3": ("a.yaml", f"%YAML:1.0\nCamera1.fx: {FX}\nCamera1.fy:\t{FY}\nCamera1.cx: {CX}\nCamera1.cy: {CY}\n"),
    "opencv": ("a.yml", OPENCV),
    "xml": ("a.xml", XML),
    "several messages": ("a.yaml", INFO),
    "npy": ("a.npy", saved(np.save)),
    "npz": ("a.npz", saved(np.savez, dist=np.zeros(5), mtx=K)),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_the_spellings_of_peoples_programs(name: str, tmp_path: Path):
    file, content = FILES[name]
    (tmp_path / file).write_bytes(content if isinstance(content, bytes) else content.encode())
    found = camera_in(tmp_path / file, SIZE)
    assert found is not None and found.values == pytest.approx((FX, FY, CX, CY)) and not found.distortion
    assert found.size in (None, SIZE)
    assert found.depth_scale == (1000.0 if name == "colour after depth" else None)


@pytest.mark.parametrize(
    "text",
    [
        '"k1": 0.1, "k2": -0.2, "p1": 0.003, "p2": 0.004', '"coeffs": [0.1, -0.2, 0.003, 0.004, 0]',
        '"distortion": {"model": "radtan", "k1": 0.1, "k2": -0.2, "p1": 0.003, "p2": 0.004}',
        '"D": {"data": [0.1, -0.2, 0.003, 0.004]}',
    ],
)  # fmt: skip
def test_distortion(text: str, tmp_path: Path):
    (tmp_path / "a.json").write_text(json.dumps(NAMED)[:-1] + ", " + text + "}")
    found = camera_in(tmp_path / "a.json", SIZE)
    assert found is not None and found.distortion[:4] == (0.1, -0.2, 0.003, 0.004)


@pytest.mark.parametrize(
    ("file", "content"),
    [
        ("a.json", "{not json"), ("a.json", "[" * 5000), ("a.json", ""), ("a.txt", "0.94 1.25 0.49 0.5"),
        ("a.txt", "see the web page"), ("a.txt", "1 2 3"), ("a.yaml", "a: [1, 2"), ("a.xml", "<a><b></a>"),
        ("a.xml", '<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>'), ("a.npy", "\x93NUMPY"), ("a.npz", "PK\x03\x04"),
        ("a.json", '{"fx": NaN, "fy": 1, "cx": 1, "cy": 1}'), ("a.yaml", "[LEFT]\nfx=1"),
        ("a.conf", "[L_HD]\nfx=700\nfy=700\ncx=640\ncy=360\n[L_VGA]\nfx=350\nfy=350\ncx=320\ncy=180\n"),
    ],
)  # fmt: skip
def test_what_states_no_camera_is_none(file: str, content: str, tmp_path: Path):
    (tmp_path / file).write_text(content, encoding="latin-1")
    assert camera_in(tmp_path / file, SIZE) is None


CAMERA = {"width": 64, "height": 48, "fx": 61.5, "fy": 62.5, "cx": 30.25, "cy": 24.5}
FOUND = Intrinsics(64, 48, 61.5, 62.5, 30.25, 24.5)


@pytest.mark.parametrize(
    "place",
    [
        "Camera_Intrinsics.JSON", "realsense_intrinsics.json", "session.json", "intrinsics/00000.json", "cam/0.json",
        "image/camera_info.json",
    ],
)  # fmt: skip
def test_places_of_a_camera(place: str, tmp_path: Path):
    folder = write_redwood(tmp_path / "s")
    (folder / place).parent.mkdir(exist_ok=True)
    (folder / place).write_text(json.dumps(CAMERA))
    sequence = open_sequence(folder)
    assert (sequence.intrinsics, sequence.intrinsics_source) == (FOUND, place)


def test_extrinsics_beside_intrinsics_are_no_camera(tmp_path: Path):
    folder = write_redwood(tmp_path / "s")
    (folder / "intrinsic").mkdir()
    (folder / "intrinsic/extrinsic_color.txt").write_text("600 0 0 0 0 600 0 0 0 0 1 0 0 0 0 1")
    (folder / "intrinsic/intrinsic_color.txt").write_text("61.5 0 30.25 0 0 62.5 24.5 0 0 0 1 0 0 0 0 1")
    assert open_sequence(folder).intrinsics == FOUND


def test_a_camera_above_several_recordings(tmp_path: Path):
    (tmp_path / "camera-intrinsics.txt").write_text("61.5 0 30.25\n0 62.5 24.5\n0 0 1\n")
    sequence = open_sequence(write_seven_scenes(tmp_path / "seq-01"))
    assert (sequence.intrinsics, sequence.intrinsics_source) == (FOUND, "../camera-intrinsics.txt")
    assert sequence.calibration.color_camera is None


def test_files_that_contradict_each_other_are_named(tmp_path: Path):
    folder = write_redwood(tmp_path / "s")
    (folder / "camera_intrinsic.json").write_text(json.dumps(CAMERA))
    (folder / "intrinsics.txt").write_text("70 0 31 0 70 24 0 0 1")
    sequence = open_sequence(folder)
    assert sequence.intrinsics == FOUND
    assert any(note.startswith("intrinsics.txt states another camera (fx 70)") for note in sequence.notes)


def test_a_file_that_should_state_a_camera_and_does_not_is_named(tmp_path: Path):
    folder = write_redwood(tmp_path / "s")
    (folder / "intrinsics.txt").write_text("unknown\n")
    assert any(
        note.startswith("intrinsics.txt: found no camera in it") for note in open_sequence(folder).notes
    )


@pytest.mark.parametrize("values", ["9000 9000 31 23", "60 30.25 62.5 24.5"])
def test_what_no_camera_has_is_refused(values: str, tmp_path: Path):
    folder = write_redwood(tmp_path / "s")
    (folder / "intrinsics.txt").write_text(values)
    with pytest.raises(InputError, match="intrinsics.txt: found"):
        open_sequence(folder)


def test_a_folder_called_like_tums_with_images_of_another_shape_is_refused(tmp_path: Path):
    folder = write_tum(tmp_path / "freiburg1_mine")
    (folder / "calibration.yaml").unlink()
    assert open_sequence(folder).intrinsics.fx == pytest.approx(51.73)
    for file in (*(folder / "rgb").iterdir(), *(folder / "depth").iterdir()):
        cv2.imwrite(str(file), cv2.imread(str(file), cv2.IMREAD_UNCHANGED)[:36])
    with pytest.raises(InputError, match="which is not the camera of TUM's"):
        open_sequence(folder)


def test_depth_of_another_size_is_said_or_refused_once(tmp_path: Path):
    folder = write_redwood(tmp_path / "s")
    depth = sorted((folder / "depth").iterdir())
    for file in depth:
        cv2.imwrite(str(file), cv2.imread(str(file), cv2.IMREAD_UNCHANGED)[::2, ::2])
    sequence = open_sequence(folder)
    assert len(list(sequence)) == 4 and sequence.intrinsics.width == 32
    assert any(
        note.startswith("assumed: depth of 32x24 sees what colour of 64x48 sees") for note in sequence.notes
    )
    for file in depth:
        cv2.imwrite(str(file), cv2.imread(str(file), cv2.IMREAD_UNCHANGED).T)
    with pytest.raises(InputError, match="found depth images of 24x32, expected 64x48"):
        open_sequence(folder)
