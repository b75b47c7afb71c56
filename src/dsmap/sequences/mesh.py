"""The ground-truth surface of a sequence: `mesh.ply`, triangles with a class each."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dsmap.classes import PALETTE
from dsmap.errors import InputError
from dsmap.files import atomic_path
from dsmap.limits import MAX_MESH_BYTES
from dsmap.reading import read_bytes

MESH_FILE = "mesh.ply"
_INDICES = "vertex_indices"
_VERTEX = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
_FACE = np.dtype(
    [("n", "u1"), (_INDICES, "<i4", (3,)), ("red", "u1"), ("green", "u1"), ("blue", "u1"),
     ("label", "u1"), ("instance", "<u2")]
)  # fmt: skip
_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "<i2", "int16": "<i2",
    "ushort": "<u2", "uint16": "<u2", "int": "<i4", "int32": "<i4", "uint": "<u4", "uint32": "<u4",
    "float": "<f4", "float32": "<f4", "double": "<f8", "float64": "<f8",
}  # fmt: skip
_HEADER = """ply
format binary_little_endian 1.0
comment dsmap ground-truth surface, metres, world frame; label: class id of classes.json
element vertex {vertices}
property float x
property float y
property float z
element face {faces}
property list uchar int vertex_indices
property uchar red
property uchar green
property uchar blue
property uchar label
property ushort instance
end_header
"""


@dataclass
class LabelledMesh:
    """Triangles in the world frame."""

    vertices: np.ndarray
    """[m], float32, shape (V, 3)."""
    faces: np.ndarray
    """Vertex indices, int32, shape (F, 3)."""
    label: np.ndarray
    """Class id of each face, uint8, shape (F,)."""
    instance: np.ndarray | None = None
    """Instance id of each face, uint16, shape (F,)."""


def write_mesh(path: Path | str, mesh: LabelledMesh) -> None:
    """Write a mesh as binary PLY; faces have their class's colour for viewers."""
    vertices = np.zeros(len(mesh.vertices), dtype=_VERTEX)
    for axis, name in enumerate("xyz"):
        vertices[name] = mesh.vertices[:, axis]
    faces = np.zeros(len(mesh.faces), dtype=_FACE)
    faces["n"], faces[_INDICES], faces["label"] = 3, mesh.faces, mesh.label
    for channel, name in enumerate(("red", "green", "blue")):
        faces[name] = PALETTE[mesh.label, channel]
    if mesh.instance is not None:
        faces["instance"] = mesh.instance
    header = _HEADER.format(vertices=len(vertices), faces=len(faces))
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(header.encode("ascii"))
        file.write(vertices.tobytes())
        file.write(faces.tobytes())


def read_mesh(path: Path | str) -> LabelledMesh:
    """Read a binary little-endian PLY of triangles with a `label` property on the faces.

    Raises:
        InputError: no such file, not such a mesh, or cut short.
    """
    path = Path(path)
    data = read_bytes(path, "a labelled mesh", MAX_MESH_BYTES)
    head, _, body = data.partition(b"end_header\n")
    (v, vertex_type), (f, face_type) = _layout(path, head.decode("ascii", "replace").splitlines())
    if min(v, f) < 0:
        raise InputError(f"{path}: found {v} vertices and {f} faces, expected numbers from 0")
    expected = v * vertex_type.itemsize + f * face_type.itemsize
    if len(body) != expected:
        raise InputError(
            f"{path}: found {len(body)} bytes after the header, expected {expected} (triangles only)"
        )
    vertices = np.frombuffer(body, dtype=vertex_type, count=v)
    faces = np.frombuffer(body, dtype=face_type, offset=v * vertex_type.itemsize)
    indices = faces[_INDICES]["i"].astype(np.int32)
    if (faces[_INDICES]["n"] != 3).any() or (f and not 0 <= indices.min() <= indices.max() < v):
        raise InputError(f"{path}: found faces that are no triangles of its {v} vertices")
    if not all(np.isfinite(vertices[name]).all() for name in "xyz"):
        raise InputError(f"{path}: found vertices that are no numbers, expected finite ones")
    return LabelledMesh(
        np.stack([vertices[name].astype(np.float32) for name in "xyz"], axis=1),
        indices,
        faces["label"].astype(np.uint8),
        faces["instance"].astype(np.uint16) if "instance" in (face_type.names or ()) else None,
    )


def _layout(path: Path, lines: list[str]) -> list[tuple[int, np.dtype]]:
    """Count and record type of the vertices and of the faces, from the header."""
    elements: list[tuple[str, int, list]] = []
    try:
        for words in map(str.split, lines):
            if words[:1] == ["element"]:
                elements.append((words[1], int(words[2]), []))
            elif words[:2] == ["property", "list"]:
                kind = np.dtype([("n", _TYPES[words[2]]), ("i", _TYPES[words[3]], (3,))])
                elements[-1][2].append((_INDICES, kind))
            elif words[:1] == ["property"]:
                elements[-1][2].append((words[2], _TYPES[words[1]]))
        types = [(count, np.dtype(fields)) for _, count, fields in elements]
    except (IndexError, KeyError, ValueError, TypeError):
        types = []
    names = [name for name, _, _ in elements]
    binary = lines[:2] == ["ply", "format binary_little_endian 1.0"]
    if not binary or names != ["vertex", "face"] or len(types) != 2 or not _complete(types):
        raise InputError(
            f"{path}: found another header, expected a binary little-endian PLY of vertices x y z and "
            "triangles with a label"
        )
    return types


def _complete(types: list[tuple[int, np.dtype]]) -> bool:
    vertex, face = (set(kind.names or ()) for _, kind in types)
    return vertex >= {"x", "y", "z"} and face >= {_INDICES, "label"}
