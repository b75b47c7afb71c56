"""ScanNet scenes exported to folders: `color/`, `depth/`, `pose/`, `intrinsic/`, `label/` (or `label-filt/`)."""

from functools import partial
from pathlib import Path

import numpy as np

from dsmap.frame import Intrinsics
from dsmap.sequences.base import Recording
from dsmap.sequences.calibration import Calibration
from dsmap.sequences.formats.parts import numbered, read_matrix, recording_by_number, seen_from, two_cameras
from dsmap.sequences.formats.protocol import Options, Reader
from dsmap.sequences.images import Packed, Source, image_size, read_ids

_IMAGE = r"(\d+)\.(?:png|jpg|jpeg)"
_LABELS = ("label-filt", "label", "labels")
_INSTANCES = ("instance-filt", "instance", "instances")
_DEPTH_SCALE = 1000.0


def _detect(path: Path) -> bool:
    return (
        all((path / name).is_dir() for name in ("color", "depth", "pose"))
        and _matrix_of(path, "depth") is not None
    )


def _read(path: Path, _: Options) -> Recording:
    colour, depth = numbered(path / "color", _IMAGE), numbered(path / "depth", _IMAGE)
    poses = {n: read_matrix(file) for n, file in numbered(path / "pose", r"(\d+)\.txt").items()}
    calibration = _calibration(path, colour, depth)
    return recording_by_number(
        "scannet", path, colour, depth, calibration, expected="color/0.jpg beside depth/0.png", poses=poses,
        labels=_ids(path, _LABELS, calibration), instances=_ids(path, _INSTANCES, calibration),
    )  # fmt: skip


READER = Reader("scannet", _detect, _read)


def _matrix_of(path: Path, name: str) -> np.ndarray | None:
    """K of a camera, (4, 4); the 25k frames have the file in the scene's folder."""
    files = (path / "intrinsic" / f"intrinsic_{name}.txt", path / f"intrinsics_{name}.txt")
    return next((K for file in files if (K := read_matrix(file)) is not None), None)


def _calibration(path: Path, colour: dict[int, Path], depth: dict[int, Path]) -> Calibration | None:
    cameras = []
    for name, images in (("color", colour), ("depth", depth)):
        K = _matrix_of(path, name)
        size = image_size(next(iter(images.values()))) if images else None
        if K is None or size is None:
            return None
        cameras.append(Intrinsics(*size, K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
    extrinsics = [read_matrix(path / "intrinsic" / f"extrinsic_{name}.txt") for name in ("color", "depth")]
    T_color, T_depth = (np.eye(4) if T is None or not np.linalg.det(T) else T for T in extrinsics)
    if (cameras[0].width, cameras[0].height) == (cameras[1].width, cameras[1].height):
        return Calibration(
            cameras[1], _DEPTH_SCALE, "intrinsic/"
        )  # colour was exported at the depth camera's size
    return two_cameras(cameras[0], cameras[1], np.linalg.inv(T_color) @ T_depth, _DEPTH_SCALE, "intrinsic/")


def _ids(path: Path, folders: tuple[str, ...], calibration: Calibration | None) -> dict[int, Source]:
    """Images of ids by number; those of the colour camera are looked up from the depth camera."""
    folder = next((path / name for name in folders if (path / name).is_dir()), None)
    files = numbered(folder, r"(\d+)\.png") if folder else {}
    if calibration is None or calibration.color_camera is None:
        return dict(files)
    return {
        n: Packed(path, f"{file.parent.name}/{file.name}", partial(_seen, file, calibration))
        for n, file in files.items()
    }


def _seen(file: Path, calibration: Calibration) -> np.ndarray:
    ids, camera = read_ids(file), calibration.color_camera
    if camera is None or ids.shape != (camera.height, camera.width):
        return ids
    return seen_from(ids, camera, calibration.intrinsics)
