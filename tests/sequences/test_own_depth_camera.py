"""Folders that state both cameras of a sensor: whether depth is aligned to colour is told by its edges."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from dsmap.frame import Intrinsics
from dsmap.sequences import open_sequence

COLOUR = Intrinsics(160, 120, 130.0, 130.0, 79.5, 59.5)
DEPTH = Intrinsics(160, 120, 100.0, 100.0, 75.0, 62.0)


def boxes(camera: Intrinsics, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Grey boxes before a dark wall, as a camera at the same place sees them: colour and depth in millimetres."""
    rgb = np.full((camera.height, camera.width, 3), 30, np.uint8)
    depth = np.full((camera.height, camera.width), 3000, np.uint16)
    rng = np.random.default_rng(seed)
    for k in range(5):
        x, y, z = rng.uniform(-0.5, 0.3), rng.uniform(-0.35, 0.15), 2.4 - 0.3 * k
        near, far = (
            np.round([camera.fx * (x + s) + camera.cx, camera.fy * (y + s) + camera.cy]).astype(int)
            for s in (0, 0.18)
        )
        place = slice(max(near[1], 0), max(far[1], 0)), slice(max(near[0], 0), max(far[0], 0))
        rgb[place], depth[place] = 90 + 30 * k, int(1000 * z)
    return rgb, depth


def write(folder: Path, depth_camera: Intrinsics) -> Path:
    for name in ("color", "depth"):
        (folder / name).mkdir(parents=True)
    for k in range(4):
        cv2.imwrite(str(folder / "color" / f"{k:04d}.png"), boxes(COLOUR, k)[0])
        cv2.imwrite(str(folder / "depth" / f"{k:04d}.png"), boxes(depth_camera, k)[1])
    return folder


def stated(camera: Intrinsics) -> dict[str, float]:
    return {"width": camera.width, "height": camera.height, "fx": camera.fx, "fy": camera.fy,
            "ppx": camera.cx, "ppy": camera.cy}  # fmt: skip


@pytest.mark.parametrize("together", [False, True])
@pytest.mark.parametrize("camera", [DEPTH, COLOUR])
def test_edges_tell_whether_depth_is_aligned(tmp_path: Path, camera: Intrinsics, together: bool):
    folder = write(tmp_path / "s", camera)
    if together:
        content = {"color": stated(COLOUR), "depth": stated(DEPTH)}
        (folder / "intrinsics.json").write_text(json.dumps(content))
    else:
        (folder / "color_intrinsics.json").write_text(json.dumps(stated(COLOUR)))
        (folder / "depth_intrinsics.json").write_text(json.dumps(stated(DEPTH)))
    sequence = open_sequence(folder)
    said = " ".join(sequence.notes)
    assert sequence.intrinsics == camera
    if camera == DEPTH:
        assert sequence.calibration.color_camera == COLOUR and "colours are looked up" in said
    else:
        assert sequence.calibration.color_camera is None and "taken as aligned" in said


def test_the_place_of_the_depth_camera_is_read_in_either_direction(tmp_path: Path):
    folder = write(tmp_path / "s", DEPTH)
    (folder / "color_intrinsics.json").write_text(json.dumps(stated(COLOUR)))
    (folder / "depth_intrinsics.json").write_text(json.dumps(stated(DEPTH)))
    turned = cv2.Rodrigues(np.array([0.0, 0.01, 0.0]))[0]
    by_columns = {"rotation": turned.T.ravel().tolist(), "translation": [0.002, 0, 0]}
    (folder / "depth_to_color_extrinsics.json").write_text(json.dumps(by_columns))
    there = open_sequence(folder).calibration.T_color_depth
    assert there is not None
    np.testing.assert_allclose(there[:3, :3], turned, atol=1e-12)
    np.testing.assert_allclose(there[:3, 3], [0.002, 0, 0])
    (folder / "depth_to_color_extrinsics.json").rename(folder / "color_to_depth_extrinsics.json")
    back = open_sequence(folder).calibration.T_color_depth
    assert back is not None
    np.testing.assert_allclose(back, np.linalg.inv(there), atol=1e-9)
