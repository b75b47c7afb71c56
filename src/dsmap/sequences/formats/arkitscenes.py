"""ARKitScenes: `lowres_wide/`, `lowres_depth/` (or `highres_depth/`), `lowres_wide_intrinsics/*.pincam`, a `.traj`."""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sequences.associate import pose_vector, poses_at
from dsmap.sequences.base import Recording
from dsmap.sequences.calibration import Calibration
from dsmap.sequences.formats.parts import Stamped, confident, recording_by_stamp, two_cameras
from dsmap.sequences.formats.protocol import Options, Reader
from dsmap.sequences.images import Packed, image_size, read_ids
from dsmap.sequences.text import read_text

_NAME = re.compile(r"(?:.*_)?(\d+(?:\.\d+)?)\.(?:png|pincam)")
_APART_S = 0.1
"""The trajectory has ten poses a second."""


def _detect(path: Path) -> bool:
    return (path / "lowres_wide").is_dir() and (path / "lowres_depth").is_dir()


def _read(path: Path, _options: Options) -> Recording:
    colour, depth = _stamped(path / "lowres_wide"), _stamped(path / "lowres_depth")
    sure = path / "confidence"
    if sure.is_dir():
        depth = [
            Stamped(s.time, Packed(path, f"lowres_depth/{s.image.name}", partial(_depth, path, s.image.name)))
            for s in depth
        ]
    notes: list[str] = []
    recording = recording_by_stamp("arkitscenes", path, colour, depth, _calibration(path, notes), notes)
    trajectory = next(
        (f for f in (path / "lowres_wide.traj", *sorted(path.glob("*.traj"))) if f.is_file()), None
    )
    if trajectory is None:
        return recording
    poses = poses_at(np.array([e.pose_time for e in recording.entries]), *_trajectory(trajectory), _APART_S)
    missing = sum(T is None for T in poses)
    if missing:
        notes.append(f"{trajectory.name}: {missing} of {len(poses)} frames have no pose")
    return replace(
        recording,
        entries=[replace(e, T_world_camera=T) for e, T in zip(recording.entries, poses, strict=True)],
    )


READER = Reader("arkitscenes", _detect, _read)


def _stamped(folder: Path) -> list[Stamped]:
    found = [(float(match[1]), path) for path in folder.iterdir() if (match := _NAME.fullmatch(path.name))]
    return [Stamped(time, path) for time, path in sorted(found)]


def _depth(path: Path, name: str) -> np.ndarray:
    depth, sure = read_ids(path / "lowres_depth" / name), path / "confidence" / name
    return confident(depth, read_ids(sure)) if sure.is_file() else depth


def _calibration(path: Path, notes: list[str]) -> Calibration | None:
    files = sorted((path / "lowres_wide_intrinsics").glob("*.pincam"))
    if not files:
        return None
    try:
        table = np.array([[float(v) for v in read_text(f).split()] for f in files]).reshape(-1, 6)
    except ValueError as error:
        raise InputError(f"{files[0].parent}: {error}, expected lines of width height fx fy cx cy") from error
    width, height, *values = np.median(table, axis=0)
    if np.ptp(table[:, 2]) > 0.002 * values[0]:
        notes.append("the focal length changes from frame to frame: its median is taken")
    fx, fy, cx, cy = (float(v) for v in values)
    camera = Intrinsics(int(width), int(height), fx, fy, cx, cy)
    first = next(iter((path / "lowres_depth").glob("*.png")), None)
    size = image_size(first) if first else None
    if size is None or size == (camera.width, camera.height):
        return Calibration(camera, 1000.0, "lowres_wide_intrinsics/")
    return two_cameras(camera, camera.scaled(*size), np.eye(4), 1000.0, "lowres_wide_intrinsics/")


def _trajectory(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Stamps and camera-to-world poses; the file holds world-to-camera as stamp, rotation vector, translation."""
    try:
        table = np.array([line.split() for line in read_text(path).splitlines() if line.strip()], np.float64)
        table = table.reshape(-1, 7)
    except ValueError as error:
        raise InputError(
            f"{path}: {error}, expected lines of a stamp, a rotation vector and a translation"
        ) from error
    table = table[np.argsort(table[:, 0], kind="stable")]
    poses = []
    for row in table:
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = Rotation.from_rotvec(row[1:4]).as_matrix(), row[4:7]
        poses.append(pose_vector(np.linalg.inv(T)))
    return table[:, 0], np.array(poses).reshape(-1, 7)
