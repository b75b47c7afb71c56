"""SUN3D: `image/` and `depth/` of files called number-microseconds, `intrinsics.txt`, `extrinsics/*.txt`."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.sequences.base import Recording
from dsmap.sequences.calibration import Calibration
from dsmap.sequences.formats.parts import (
    Stamped,
    camera_from,
    read_matrix_of,
    recording_by_stamp,
    rigid,
)
from dsmap.sequences.formats.protocol import Options, Reader
from dsmap.sequences.images import image_size, stored_depth
from dsmap.sequences.text import read_text
from dsmap.sequences.turned_depth import is_turned, packed

_NAME = re.compile(r"\d+-(\d+)\.(?:jpg|jpeg|png)", re.IGNORECASE)
_APART_S = 0.034
"""SUN3D takes the nearest depth image of each colour image; both come at 30 Hz."""


def _detect(path: Path) -> bool:
    return (path / "intrinsics.txt").is_file() and all(
        (path / name).is_dir() and any(_NAME.fullmatch(f.name) for f in (path / name).iterdir())
        for name in ("image", "depth")
    )


def _read(path: Path, _options: Options) -> Recording:
    colour, depth = _stamped(path / "image"), _stamped(path / "depth")
    notes: list[str] = []
    if _turned(depth):
        depth = [Stamped(s.time, packed(s.image)) for s in depth]
    else:
        notes.append("depth is in plain millimetres, not turned by three bits")
    K, size = read_matrix_of(path / "intrinsics.txt", 3, 3), None
    if colour and isinstance(colour[0].image, Path):
        size = image_size(colour[0].image)
    calibration = (
        Calibration(camera_from(K, size), 1000.0, "intrinsics.txt") if K is not None and size else None
    )
    recording = recording_by_stamp("sun3d", path, colour, depth, calibration, notes, _APART_S)
    # SUN3D takes a pair for one moment, that of the colour image: both stamps are those of their arrival.
    recording = replace(recording, entries=[replace(e, depth_time=None) for e in recording.entries])
    poses = _extrinsics(path / "extrinsics")
    if not poses:
        return recording
    position = {s.image: i for i, s in enumerate(colour)}
    if len(poses) != len(colour):
        notes.append(f"extrinsics holds {len(poses)} poses for {len(colour)} images")
    entries = [
        replace(e, T_world_camera=poses[position[e.rgb]] if position[e.rgb] < len(poses) else None)
        for e in recording.entries
    ]
    return replace(recording, entries=entries)


READER = Reader("sun3d", _detect, _read)


def _stamped(folder: Path) -> list[Stamped]:
    found = []
    for path in folder.iterdir():
        if match := _NAME.fullmatch(path.name):
            found.append(Stamped(int(match[1]) / 1e6, path))
    return sorted(found, key=lambda s: (s.time, str(s.image)))


def _turned(depth: list[Stamped]) -> bool:
    """Whether depth is turned as SUN3D's is; so is what cannot tell."""
    samples = [stored_depth(stamped.image) for stamped in depth[:: max(1, len(depth) // 3)]]
    told = [stored for stored in samples if stored is not None and stored.any()]
    return is_turned(told) or not told


def _extrinsics(folder: Path) -> list[np.ndarray | None]:
    """Camera-to-world poses of the colour images, 3x4 each, of the newest file."""
    files = sorted(folder.glob("*.txt")) if folder.is_dir() else []
    if not files:
        return []
    try:
        values = np.array(read_text(files[-1]).split(), np.float64).reshape(-1, 3, 4)
    except ValueError as error:
        raise InputError(f"{files[-1]}: {error}, expected a 3x4 matrix for each image") from error
    return [rigid(np.vstack([T, (0, 0, 0, 1)])) for T in values]
