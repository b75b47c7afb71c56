"""Surfels as a PLY point cloud, and back."""

from pathlib import Path
from typing import Any, Literal

import numpy as np

from dsmap.classes import CLASS_NAMES, NUM_CLASSES, colourise
from dsmap.errors import InputError
from dsmap.files import atomic_path
from dsmap.limits import MAX_MESH_BYTES
from dsmap.reading import check_plain, reading

_FIELDS = (
    ("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("nx", "<f4"), ("ny", "<f4"), ("nz", "<f4"),
    ("red", "u1"), ("green", "u1"), ("blue", "u1"),
    ("radius", "<f4"), ("confidence", "<f4"), ("label", "u1"), ("t_created", "<i4"), ("t_updated", "<i4"),
    ("segment", "<i4"),
)  # fmt: skip
"""One vertex of `map.ply`; t_created and t_updated are frame numbers (the surfel's t_0 and t); segment is 0
where there is none."""

_PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "<i2", "int16": "<i2",
    "ushort": "<u2", "uint16": "<u2", "int": "<i4", "int32": "<i4", "uint": "<u4", "uint32": "<u4",
    "float": "<f4", "float32": "<f4", "double": "<f8", "float64": "<f8",
}  # fmt: skip
_PLY_NAMES = {"<f4": "float", "u1": "uchar", "<i4": "int"}


def write_ply(
    path: Path | str,
    surfels: dict[str, np.ndarray],
    *,
    probabilities: np.ndarray | None = None,
    colour: Literal["rgb", "label"] = "rgb",
    min_weight: float = 0.0,
    up: np.ndarray | None = None,
) -> int:
    """Write surfels as a binary little-endian PLY point cloud.

    Args:
        surfels: arrays of N rows by the names of `SurfelMap` (see `SurfelMap.numpy`).
        probabilities: class posterior, shape (N, 13), added as `prob_<class>`; or None.
        colour: what red, green, blue hold: the surfel's colour, or its class's colour of the palette.
        min_weight: surfels of a lower confidence are left out; dead ones (weight 0) always are.
        up: which way is up in the world's frame, shape (3,), for a comment of the header; or None.

    Returns:
        The number of points written.

    Raises:
        InputError: the file cannot be written.
    """
    weight = surfels["weight"]
    rows = np.flatnonzero((weight > 0) & (weight >= min_weight))
    names = [f"prob_{name}" for name in CLASS_NAMES[1:]] if probabilities is not None else []
    fields = [*_FIELDS, *((name, "<f4") for name in names)]
    vertices = np.empty(len(rows), dtype=fields)
    position, normal = surfels["position"][rows], surfels["normal"][rows]
    label = surfels["label"][rows]
    rgb = colourise(label) if colour == "label" else np.rint(surfels["colour"][rows].clip(0, 1) * 255)
    for axis in range(3):
        vertices["xyz"[axis]] = position[:, axis]
        vertices[("nx", "ny", "nz")[axis]] = normal[:, axis]
        vertices[("red", "green", "blue")[axis]] = rgb[:, axis]
    vertices["radius"], vertices["confidence"], vertices["label"] = (
        surfels["radius"][rows],
        weight[rows],
        label,
    )
    vertices["t_created"], vertices["t_updated"] = surfels["t_created"][rows], surfels["t_updated"][rows]
    vertices["segment"] = surfels["segment"][rows] if "segment" in surfels else 0
    if probabilities is not None:
        for column, name in enumerate(names):
            vertices[name] = probabilities[rows, column]
    properties = [
        f"property {_PLY_NAMES[kind]} {name}" for name, kind in [*_FIELDS, *((n, "<f4") for n in names)]
    ]
    header = ["ply", "format binary_little_endian 1.0", "comment surfels by dsmap, metres, world frame"]
    if up is not None:
        header.append("comment up " + " ".join(f"{v:.6f}" for v in up))
    header += [f"element vertex {len(rows)}", *properties, "end_header"]
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(("\n".join(header) + "\n").encode("ascii"))
        vertices.tofile(file)
    return len(rows)


def read_ply(path: Path | str) -> np.ndarray:
    """Read the vertices of a binary little-endian PLY without lists in them, as `write_ply` makes.

    Returns:
        A structured array, one record a vertex, fields by property name.

    Raises:
        InputError: no such file, not such a PLY, or cut short.
    """
    path = Path(path)
    check_plain(path, "a PLY file", MAX_MESH_BYTES)
    with reading(path, "a PLY file"), path.open("rb") as file:
        dtype, count = _read_header(file, path)
        there = (path.stat().st_size - file.tell()) // dtype.itemsize
        if there < count:
            raise InputError(f"{path} ends after {there} vertices; its header promises {count}")
        return np.fromfile(file, dtype=dtype, count=count)


def up_of_ply(path: Path | str) -> np.ndarray | None:
    """Which way is up in the world's frame by the header of a `map.ply`, shape (3,); None where it does not say."""
    with Path(path).open("rb") as file:
        for line in iter(lambda: file.readline(256), b"end_header\n"):
            words = line.decode("ascii", "replace").split()
            if words[:2] == ["comment", "up"] and len(words) == 5:
                with reading(path, "three numbers behind `comment up`"):
                    up = np.array([float(word) for word in words[2:]])
                if not abs(np.linalg.norm(up) - 1) < 1e-3:
                    raise InputError(f"{path}: found up {' '.join(words[2:])}, expected a unit vector")
                return up
            if not line:
                break
    return None


def _read_header(file: Any, path: Path) -> tuple[np.dtype, int]:
    if file.readline(16).strip() != b"ply":
        raise InputError(f"{path} is not a PLY file (its first line is not `ply`)")
    count, fields, binary, in_vertex = -1, [], False, False
    for _ in range(256):
        words = file.readline(256).decode("ascii", "replace").split()
        if words[:1] == ["end_header"]:
            break
        if words[:1] == ["format"]:
            binary = words[1:2] == ["binary_little_endian"]
        elif words[:1] == ["element"]:
            in_vertex = words[1:2] == ["vertex"] and count < 0
            if in_vertex and len(words) == 3 and words[2].isdigit():
                count = int(words[2])
            elif count < 0:
                raise InputError(f"{path}: its first element is {words[1:]}; expected `vertex` and a count")
        elif words[:1] == ["property"] and in_vertex:
            if len(words) != 3 or words[1] not in _PLY_TYPES:
                raise InputError(f"{path}: the vertex property {words[1:]} is not a plain number")
            if words[2] in dict(fields):
                raise InputError(f"{path}: the vertex property {words[2]} is there twice; expected each once")
            fields.append((words[2], _PLY_TYPES[words[1]]))
    else:
        raise InputError(f"{path}: its PLY header has no `end_header` in 256 lines")
    if not binary or count < 0 or not fields:
        raise InputError(f"{path} is not a binary little-endian PLY with vertices")
    return np.dtype(fields), count


def surfels_of_ply(vertices: np.ndarray, path: Path | str) -> dict[str, np.ndarray]:
    """The vertices of a `map.ply` as surfel arrays by the names of `SurfelMap` (without label evidence).

    Raises:
        InputError: the file (`path`, for the message) lacks a property of ours, so another program wrote it.
    """
    given = set(vertices.dtype.names or ()) | {"segment"}  # older files have none
    missing = [name for name, _ in _FIELDS if name not in given]
    if missing:
        raise InputError(f"{path} was not written by dsmap: it has no vertex property {', '.join(missing)}")
    for name, _ in _FIELDS:
        values = vertices[name] if name in given and name != "segment" else np.zeros(0)
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            raise InputError(f"{path}: {name} holds numbers that are none; expected finite ones")
    if len(vertices) and not 0 <= vertices["label"].min() <= vertices["label"].max() < NUM_CLASSES:
        raise InputError(
            f"{path}: label goes to {vertices['label'].max()}; expected at most {NUM_CLASSES - 1}"
        )
    columns = {name: vertices[name] for name, _ in _FIELDS if name in (vertices.dtype.names or ())}
    return {
        "position": np.stack([columns["x"], columns["y"], columns["z"]], axis=1),
        "normal": np.stack([columns["nx"], columns["ny"], columns["nz"]], axis=1),
        "colour": np.stack([columns["red"], columns["green"], columns["blue"]], axis=1) / np.float32(255),
        "weight": columns["confidence"],
        "radius": columns["radius"],
        "label": columns["label"],
        "t_created": columns["t_created"],
        "t_updated": columns["t_updated"],
        "segment": columns.get("segment", np.zeros(len(vertices), np.int32)),
    }
