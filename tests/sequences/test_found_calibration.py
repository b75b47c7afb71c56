"""The camera in files that recorders leave beside the images, and what is said where there is none."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from sequence_files import colour, depth, write_redwood, write_seven_scenes, write_tum

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sequences import open_sequence

FX, FY, CX, CY = 61.5, 62.5, 30.25, 24.5
K = np.array([[FX, 0, CX], [0, FY, CY], [0, 0, 1]])
ROWS = "\n".join(" ".join(str(v) for v in row) for row in K)
K4 = np.eye(4)
K4[:3, :3] = K
CAMERA_INFO = f"""image_width: 64
image_height: 48
camera_name: rgb
camera_matrix:
  rows: 3
  cols: 3
  data: [{", ".join(str(v) for v in K.ravel())}]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0, 0, 0, 0, 0]
"""
ORB = f"""%YAML:1.0

# Camera calibration and distortion parameters (OpenCV)
Camera.fx: {FX}
Camera.fy: {FY}
Camera.cx: {CX}
Camera.cy: {CY}
Camera.width: 64
Camera.height: 48
DepthMapFactor: 2000.0
"""
FILES = {
    "camera_intrinsic.json": json.dumps(
        {"width": 64, "height": 48, "intrinsic_matrix": K.T.ravel().tolist()}
    ),
    "intrinsics.json": json.dumps({"width": 64, "height": 48, "fx": FX, "fy": FY, "ppx": CX, "ppy": CY}),
    "transforms.json": json.dumps(
        {"w": 64, "h": 48, "fl_x": FX, "fl_y": FY, "cx": CX + 0.5, "cy": CY + 0.5, "frames": []}
    ),
    "calibration.txt": f"{FX} {FY} {CX} {CY}\n",
    "intrinsics.txt": ROWS + "\n",
    "camera-intrinsics.txt": ROWS.replace(" ", "\t") + "\n",
    "camera.txt": f"fx = {FX}\nfy = {FY}\ncx = {CX}\ncy = {CY}\n",
    "intrinsic/intrinsic_color.txt": "\n".join(" ".join(str(v) for v in row) for row in K4),
    "room.yaml": ORB,
    "room_Color_metadata_15543.csv": f"Frame Info: \nType,Color\nFx,{FX}\nFy,{FY}\nPPx,{CX}\nPPy,{CY}\n",
    "camera_info.yaml": CAMERA_INFO,
}
WRITERS: dict[str, Callable[[Path], Path]] = {"redwood": write_redwood, "7-scenes": write_seven_scenes}


def write(folder: Path, name: str) -> None:
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).write_text(FILES[name])


@pytest.mark.parametrize("layout", WRITERS)
@pytest.mark.parametrize("name", FILES)
def test_a_file_beside_the_images_states_the_camera(name: str, layout: str, tmp_path: Path):
    folder = WRITERS[layout](tmp_path / "s")
    write(folder, name)
    sequence = open_sequence(folder)
    assert sequence.intrinsics == Intrinsics(64, 48, FX, FY, CX, CY)
    assert sequence.calibration.color_camera is None and sequence.readout_s == 0
    assert sequence.intrinsics_source == name
    assert sequence.depth_scale == (2000.0 if name == "room.yaml" else 1000.0)
    assert not any("Sense" in note or "Kinect" in note for note in sequence.notes)


def test_tum_lists_with_eth3ds_file_are_in_units_of_tum(tmp_path: Path):
    folder = write_tum(tmp_path / "s")
    (folder / "calibration.yaml").unlink()
    write(folder, "calibration.txt")
    sequence = open_sequence(folder)
    assert (sequence.intrinsics.fx, sequence.depth_scale) == (FX, 5000.0)
    assert any(note.startswith("assumed: 5000") for note in sequence.notes)


def test_calibration_yaml_and_flags_go_first(tmp_path: Path):
    folder = write_redwood(tmp_path / "s")
    write(folder, "camera_intrinsic.json")
    assert open_sequence(folder, intrinsics=(50, 50, 32, 24)).intrinsics.fx == 50
    (folder / "calibration.yaml").write_text(
        "{width: 64, height: 48, fx: 40, fy: 40, cx: 32, cy: 24, depth_scale: 1000}"
    )
    assert open_sequence(folder).intrinsics.fx == 40


def test_distortion_is_kept(tmp_path: Path):
    folder = write_redwood(tmp_path / "s")
    (folder / "calibration.txt").write_text(f"{FX} {FY} {CX} {CY} 0.1 -0.2 0.003 0.004\n")
    assert open_sequence(folder).intrinsics.distortion == (0.1, -0.2, 0.003, 0.004, 0.0)


def test_a_camera_of_a_larger_image_is_scaled_and_said(tmp_path: Path):
    folder = write_redwood(tmp_path / "s")
    content = {"width": 128, "height": 96, "fx": 120, "fy": 120, "cx": 63.5, "cy": 47.5}
    (folder / "camera.json").write_text(json.dumps(content))
    sequence = open_sequence(folder)
    assert sequence.intrinsics == Intrinsics(128, 96, 120, 120, 63.5, 47.5).scaled(64, 48)
    assert any("scaled" in note for note in sequence.notes)


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [
        (
            "camera.json",
            '{"width": 1280, "height": 720, "fx": 900, "fy": 900, "cx": 640, "cy": 360}',
            "1280x720",
        ),
        ("intrinsics.txt", "900 0 640 0 900 360 0 0 1", "near the middle"),
    ],
)
def test_a_camera_of_other_images_is_refused(name: str, text: str, match: str, tmp_path: Path):
    folder = write_redwood(tmp_path / "s")
    (folder / name).write_text(text)
    with pytest.raises(InputError, match=match):
        open_sequence(folder)
    assert open_sequence(folder, intrinsics=(60, 60, 31.5, 23.5)).intrinsics.fx == 60


def test_files_of_something_else_are_no_camera(tmp_path: Path):
    folder = write_redwood(tmp_path / "s")
    (folder / "config.json").write_text('{"lr": 0.1, "list": [1, 2]}')
    (folder / "intrinsics.txt").write_text("see the web page\n")
    (folder / "other.yaml").write_text("a: [1, 2\n")
    (folder / "list.yaml").write_text("- 1\n")
    assert open_sequence(folder).intrinsics.fx == pytest.approx(52.5)


@pytest.mark.parametrize(("layout", "word"), [("redwood", "PrimeSense"), ("7-scenes", "Kinect")])
def test_what_is_assumed_is_said(layout: str, word: str, tmp_path: Path):
    notes = open_sequence(WRITERS[layout](tmp_path / "s")).notes
    assert any(note.startswith("assumed:") and word in note for note in notes)


def test_another_shape_is_another_camera(tmp_path: Path):
    folder = write_redwood(tmp_path / "s")
    for name in ("image", "depth"):
        for file in (folder / name).iterdir():
            cv2.imwrite(str(file), cv2.resize(cv2.imread(str(file), cv2.IMREAD_UNCHANGED), (85, 48)))
    with pytest.raises(InputError, match=r"85x48 and no file that states their camera.*--intrinsics"):
        open_sequence(folder)
    assert open_sequence(folder, intrinsics=(60, 60, 42, 24)).intrinsics.width == 85


def test_smaller_depth_sees_what_colour_sees(tmp_path: Path):
    folder = write_redwood(tmp_path / "s")
    write(folder, "camera_intrinsic.json")
    for k, file in enumerate(sorted((folder / "depth").iterdir())):
        cv2.imwrite(str(file), cv2.resize((depth(k) * 1000).astype(np.uint16), (32, 24)))
    sequence = open_sequence(folder)
    assert sequence.intrinsics == Intrinsics(64, 48, FX, FY, CX, CY).scaled(32, 24)
    assert sequence.frame(0).rgb.shape == (24, 32, 3)
    assert colour(0).shape == (48, 64, 3)
