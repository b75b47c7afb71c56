"""Replica as rendered for NICE-SLAM: `results/frame000000.jpg`, `results/depth000000.png`, `traj.txt`."""

from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.plain import parse_json
from dsmap.sequences.base import Recording
from dsmap.sequences.calibration import Calibration
from dsmap.sequences.formats.parts import numbered, read_text, recording_by_number
from dsmap.sequences.formats.protocol import Options, Reader
from dsmap.sequences.images import image_size

_PUBLISHED = Calibration(
    Intrinsics(1200, 680, 600.0, 600.0, 599.5, 339.5), 6553.5, "known default of Replica"
)


def _detect(path: Path) -> bool:
    return (path / "traj.txt").is_file() and any((path / "results").glob("depth*.png"))


def _read(path: Path, _options: Options) -> Recording:
    colour = numbered(path / "results", r"(?:frame|rgb|color)_?(\d+)\.(?:jpg|jpeg|png)")
    depth = numbered(path / "results", r"depth_?(\d+)\.png")
    poses = _trajectory(path / "traj.txt")
    first = min(colour.keys() | depth.keys(), default=0)
    return recording_by_number(
        "replica", path, colour, depth, _calibration(path, colour),
        expected="results/frame000000.jpg beside results/depth000000.png",
        poses={first + i: T for i, T in enumerate(poses)},
    )  # fmt: skip


READER = Reader("replica", _detect, _read)


def _trajectory(path: Path) -> list[np.ndarray]:
    """Camera-to-world poses, one line of 16 numbers each."""
    try:
        return [
            np.array(line.split(), np.float64).reshape(4, 4)
            for line in read_text(path).splitlines()
            if line.strip()
        ]
    except ValueError as error:
        raise InputError(f"{path}: {error}, expected lines of 16 numbers") from error


def _calibration(path: Path, colour: dict[int, Path]) -> Calibration | None:
    for file in (path / "cam_params.json", path.parent / "cam_params.json"):
        if file.is_file():
            try:
                c = parse_json(read_text(file), file)["camera"]
                fx, fy, cx, cy = (float(c[key]) for key in ("fx", "fy", "cx", "cy"))
                camera = Intrinsics(int(c["w"]), int(c["h"]), fx, fy, cx, cy)
                return Calibration(camera, float(c["scale"]), file.name)
            except (ValueError, KeyError, TypeError) as error:
                raise InputError(
                    f"{file}: {error!r}, expected camera with w, h, fx, fy, cx, cy, scale"
                ) from error
    size = image_size(next(iter(colour.values()))) if colour else None
    return _PUBLISHED if size == (1200, 680) else None
