"""Replica as it was rendered for others.

For NICE-SLAM: `results/frame000000.jpg`, `results/depth000000.png`, `traj.txt`; for Semantic-NeRF and vMAP:
`rgb/rgb_0.png`, `depth/depth_0.png`, `traj_w_c.txt`.
"""

from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.plain import parse_json
from dsmap.sequences.base import Recording
from dsmap.sequences.calibration import Calibration
from dsmap.sequences.formats.parts import numbered, recording_by_number
from dsmap.sequences.formats.protocol import Options, Reader
from dsmap.sequences.images import image_size
from dsmap.sequences.text import read_text

_PUBLISHED = Calibration(
    Intrinsics(1200, 680, 600.0, 600.0, 599.5, 339.5), 6553.5, "known default of Replica"
)


_HALF_PI_CAMERA = Calibration(
    Intrinsics(640, 480, 320.0, 320.0, 319.5, 239.5), 1000.0, "known default of Semantic-NeRF's Replica"
)
"""Its field of view is 90 degrees wide."""


def _detect(path: Path) -> bool:
    return _layout(path) is not None


def _layout(path: Path) -> tuple[Path, Path, Path] | None:
    """Folders of colour and depth and the file of poses, or None."""
    results, own = path / "results", path / "depth"
    if (path / "traj.txt").is_file() and any(results.glob("depth*.png")):
        return results, results, path / "traj.txt"
    if (path / "traj_w_c.txt").is_file() and any(own.glob("depth_*.png")):
        return path / "rgb", own, path / "traj_w_c.txt"
    return None


def _read(path: Path, _options: Options) -> Recording:
    layout = _layout(path)
    if layout is None:
        raise InputError(f"{path}: found no traj.txt beside results/, expected Replica as it was rendered")
    colour_folder, depth_folder, trajectory = layout
    colour = numbered(colour_folder, r"(?:frame|rgb|color)_?(\d+)\.(?:jpg|jpeg|png)")
    depth = numbered(depth_folder, r"depth_?(\d+)\.png")
    poses = _trajectory(trajectory)
    first = min(colour.keys() | depth.keys(), default=0)
    return recording_by_number(
        "replica", path, colour, depth, _calibration(path, colour, trajectory.name),
        expected=f"{colour_folder.name}/ and {depth_folder.name}/ with numbered images",
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


def _calibration(path: Path, colour: dict[int, Path], trajectory: str) -> Calibration | None:
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
    published = _PUBLISHED if trajectory == "traj.txt" else _HALF_PI_CAMERA
    own = (published.intrinsics.width, published.intrinsics.height)
    return published if size == own else None
