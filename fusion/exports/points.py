"""Surfels as point clouds: PLY, PCD, LAS, E57."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.files import atomic_path
from dsmap.fusion.exports.ply import write_ply

_PCD = [
    *(
        (name, "<f4")
        for name in ("x", "y", "z", "rgb", "normal_x", "normal_y", "normal_z", "confidence", "radius")
    ),
    ("label", "<u4"),
]
_LAS_STEP_M = 1e-4
"""LAS stores whole numbers of these."""
_LAS_OF_USERS = 64
"""LAS 1.4, table 17: classes from here on are the user's; ours are this plus their id."""
_LAS_UNCLASSIFIED = 1


def write_pcd(path: Path | str, surfels: dict[str, np.ndarray]) -> int:
    """Write a binary PCD (v0.7) of the Point Cloud Library: x y z, packed rgb, normal, confidence, radius, label."""
    rows = np.flatnonzero(surfels["weight"] > 0)
    table = np.zeros(len(rows), dtype=_PCD)
    for axis, name in enumerate("xyz"):
        table[name] = surfels["position"][rows, axis]
        table[f"normal_{name}"] = surfels["normal"][rows, axis]
    red, green, blue = _rgb(surfels, rows).astype(np.uint32).T
    table["rgb"] = (red << 16 | green << 8 | blue).view(np.float32)
    table["confidence"], table["radius"] = surfels["weight"][rows], surfels["radius"][rows]
    table["label"] = surfels["label"][rows]
    names = [name for name, _ in _PCD]
    header = [
        "# .PCD v0.7 - Point Cloud Data file format", "VERSION 0.7", f"FIELDS {' '.join(names)}",
        f"SIZE {' '.join('4' for _ in names)}", f"TYPE {' '.join('U' if 'u' in kind else 'F' for _, kind in _PCD)}",
        f"COUNT {' '.join('1' for _ in names)}", f"WIDTH {len(rows)}", "HEIGHT 1", "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(rows)}", "DATA binary",
    ]  # fmt: skip
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(("\n".join(header) + "\n").encode("ascii"))
        table.tofile(file)
    return len(rows)


def write_las(path: Path | str, surfels: dict[str, np.ndarray]) -> int:
    """Write LAS 1.4, point format 7: steps of 0.1 mm, colours of 16 bits, and as extra dimensions what a surfel has.

    The classification is 64 + our class id (the range that is free for users), 1 (unclassified) without one.

    Raises:
        ModuleNotFoundError: laspy is not installed.
    """
    import laspy

    rows = np.flatnonzero(surfels["weight"] > 0)
    position, label = surfels["position"][rows].astype(np.float64), surfels["label"][rows]
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales = np.full(3, _LAS_STEP_M)
    header.offsets = np.floor(position.min(axis=0)) if len(rows) else np.zeros(3)
    kinds = {"nx": "f4", "ny": "f4", "nz": "f4", "confidence": "f4", "radius": "f4", "label": "u1"}
    for name, kind in kinds.items():
        header.add_extra_dim(laspy.ExtraBytesParams(name=name, type=np.dtype(kind)))
    las = laspy.LasData(header)
    las.x, las.y, las.z = position.T
    las.red, las.green, las.blue = 257 * _rgb(surfels, rows).astype(np.uint16).T
    las.classification = np.where(label > 0, _LAS_OF_USERS + label, _LAS_UNCLASSIFIED).astype(np.uint8)
    for axis in range(3):
        las[("nx", "ny", "nz")[axis]] = surfels["normal"][rows, axis]
    las["confidence"], las["radius"], las["label"] = surfels["weight"][rows], surfels["radius"][rows], label
    with atomic_path(path) as temporary:
        las.write(str(temporary))
    return len(rows)


def write_e57(path: Path | str, surfels: dict[str, np.ndarray]) -> int:
    """Write one scan of ASTM E57: cartesian points, colours, and the confidence as intensity.

    E57 has no place for a label that programs would read.

    Raises:
        ModuleNotFoundError: pye57 is not installed.
    """
    import pye57

    rows = np.flatnonzero(surfels["weight"] > 0)
    if not len(rows):
        raise InputError("the map has no surfels, expected some: E57 holds no empty scan")
    axes = ("cartesianX", "cartesianY", "cartesianZ")
    data: dict[str, np.ndarray] = dict(zip(axes, surfels["position"][rows].T.astype(float), strict=True))
    data |= dict(zip(("colorRed", "colorGreen", "colorBlue"), _rgb(surfels, rows).T, strict=True))
    data["intensity"] = surfels["weight"][rows].astype(float)
    data = {name: np.ascontiguousarray(values) for name, values in data.items()}
    with atomic_path(path) as temporary:
        file = pye57.E57(str(temporary), mode="w")
        file.write_scan_raw(data, name="dsmap")
        file.close()
    return len(rows)


POINT_WRITERS: dict[str, Callable[[Path | str, dict[str, np.ndarray]], int]] = {
    "ply": write_ply, "pcd": write_pcd, "las": write_las, "e57": write_e57,
}  # fmt: skip
"""File type to the function that writes it and returns the number of points."""


def _rgb(surfels: dict[str, np.ndarray], rows: np.ndarray) -> np.ndarray:
    return np.rint(surfels["colour"][rows].clip(0, 1) * 255).astype(np.uint8)
