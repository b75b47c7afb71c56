"""ScanNet scenes exported to folders: `color/`, `depth/`, `pose/`, `intrinsic/`, `label/` (or `label-filt/`)."""

from functools import partial
from pathlib import Path

import numpy as np

from dsmap.classes import NYU40_TO_13
from dsmap.frame import Intrinsics
from dsmap.sequences.base import Recording
from dsmap.sequences.calibration import Calibration
from dsmap.sequences.formats.parts import (
    numbered,
    read_matrix_of,
    recording_by_number,
    seen_from,
    two_cameras,
)
from dsmap.sequences.formats.protocol import Options, Reader
from dsmap.sequences.images import Packed, Source, image_size, read_ids
from dsmap.sequences.label_sets import SCANNET_LABEL_MAP, classes_of, scannet_table

_IMAGE = r"(\d+)\.(?:png|jpg|jpeg)"
_DEPTH_SCALE = 1000.0


def _detect(path: Path) -> bool:
    return (
        all((path / name).is_dir() for name in ("color", "depth", "pose"))
        and _matrix_of(path, "depth") is not None
    )


def _read(path: Path, _options: Options) -> Recording:
    colour, depth = numbered(path / "color", _IMAGE), numbered(path / "depth", _IMAGE)
    poses = {n: read_matrix_of(file) for n, file in numbered(path / "pose", r"(\d+)\.txt").items()}
    calibration = _calibration(path, colour, depth)
    notes: list[str] = []
    return recording_by_number(
        "scannet", path, colour, depth, calibration, expected="color/0.jpg beside depth/0.png", poses=poses,
        labels=_labels(path, calibration, notes), instances=_ids(path, "instance-filt", None, calibration), notes=notes,
    )  # fmt: skip


READER = Reader("scannet", _detect, _read)


def _matrix_of(path: Path, name: str) -> np.ndarray | None:
    """K of a camera, (4, 4); the 25k frames have the file in the scene's folder."""
    files = (path / "intrinsic" / f"intrinsic_{name}.txt", path / f"intrinsics_{name}.txt")
    return next((K for file in files if (K := read_matrix_of(file)) is not None), None)


def _calibration(path: Path, colour: dict[int, Path], depth: dict[int, Path]) -> Calibration | None:
    cameras = []
    for name, images in (("color", colour), ("depth", depth)):
        K = _matrix_of(path, name)
        size = image_size(next(iter(images.values()))) if images else None
        if K is None or size is None:
            return None
        cameras.append(Intrinsics(*size, K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
    extrinsics = [read_matrix_of(path / "intrinsic" / f"extrinsic_{name}.txt") for name in ("color", "depth")]
    T_color, T_depth = (np.eye(4) if T is None or not np.linalg.det(T) else T for T in extrinsics)
    if (cameras[0].width, cameras[0].height) == (cameras[1].width, cameras[1].height):
        return Calibration(
            cameras[1], _DEPTH_SCALE, "intrinsic/"
        )  # colour was exported at the depth camera's size
    return two_cameras(cameras[0], cameras[1], np.linalg.inv(T_color) @ T_depth, _DEPTH_SCALE, "intrinsic/")


def _labels(path: Path, calibration: Calibration | None, notes: list[str]) -> dict[int, Source]:
    """`label-filt/` holds ids of ScanNet's label map, which must lie near; `label/` NYU40's, as in the 25k frames."""
    if not (path / "label-filt").is_dir():
        return _ids(path, "label", NYU40_TO_13, calibration)
    places = (path, path.parent, path.parent.parent)
    file = next((p / SCANNET_LABEL_MAP for p in places if (p / SCANNET_LABEL_MAP).is_file()), None)
    if file is None:
        notes.append(f"labels are not used: label-filt/ needs {SCANNET_LABEL_MAP} beside the scene")
        return {}
    return _ids(path, "label-filt", scannet_table(file), calibration)


def _ids(
    path: Path, name: str, table: np.ndarray | None, calibration: Calibration | None
) -> dict[int, Source]:
    """Images of ids by number; those of the colour camera are looked up from the depth camera."""
    files = numbered(path / name, r"(\d+)\.png")
    return {
        n: Packed(path, f"{name}/{f.name}", partial(_seen, f, table, calibration)) for n, f in files.items()
    }


def _seen(file: Path, table: np.ndarray | None, calibration: Calibration | None) -> np.ndarray:
    ids, camera = read_ids(file), calibration.color_camera if calibration else None
    if table is not None:
        ids = classes_of(ids, table)
    if camera is None or calibration is None or ids.shape != (camera.height, camera.width):
        return ids
    return seen_from(ids, camera, calibration.intrinsics)
