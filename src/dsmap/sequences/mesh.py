"""The ground-truth surface of a sequence: `mesh.ply`, triangles with a class each."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.files import atomic_path

FILE = "mesh.ply"
_VERTEX = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
_FACE = np.dtype([("n", "u1"), ("vertex_indices", "<i4", (3,)), ("rgb", "u1", (3,)), ("label", "u1")])
_HEADER = """ply
format binary_little_endian 1.0
comment ground-truth surface, metres, world frame; label: class id of classes.json
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


def write_mesh(path: Path | str, mesh: LabelledMesh, colour: np.ndarray | None = None) -> None:
    """Write a mesh as binary PLY.

    Args:
        colour: RGB of each face for viewers, uint8, shape (F, 3); grey if not given.
    """
    vertices = np.zeros(len(mesh.vertices), dtype=_VERTEX)
    for axis, name in enumerate("xyz"):
        vertices[name] = mesh.vertices[:, axis]
    faces = np.zeros(len(mesh.faces), dtype=_FACE)
    faces["n"], faces["vertex_indices"], faces["label"] = 3, mesh.faces, mesh.label
    faces["rgb"] = 128 if colour is None else colour
    header = _HEADER.format(vertices=len(vertices), faces=len(faces))
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(header.encode("ascii"))
        file.write(vertices.tobytes())
        file.write(faces.tobytes())


def read_mesh(path: Path | str) -> LabelledMesh:
    """Read what `write_mesh` wrote.

    Raises:
        InputError: no such file, not a mesh of this form, or cut short.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}), expected a labelled mesh") from error
    head, _, body = data.partition(b"end_header\n")
    lines = head.decode("ascii", "replace").splitlines()
    elements = [words for words in map(str.split, lines) if words[:1] == ["element"]]
    counts = {words[1]: int(words[2]) for words in elements if len(words) == 3 and words[2].isdigit()}
    v, f = counts.get("vertex", 0), counts.get("face", 0)
    if (head + b"end_header\n").decode("ascii", "replace") != _HEADER.format(vertices=v, faces=f):
        raise InputError(
            f"{path}: found another PLY header, expected the labelled mesh of a rendered sequence"
        )
    expected = v * _VERTEX.itemsize + f * _FACE.itemsize
    if len(body) != expected:
        raise InputError(f"{path}: found {len(body)} bytes after the header, expected {expected}")
    vertices = np.frombuffer(body, dtype=_VERTEX, count=v)
    faces = np.frombuffer(body, dtype=_FACE, offset=v * _VERTEX.itemsize)
    return LabelledMesh(
        np.stack([vertices[name] for name in "xyz"], axis=1),
        np.ascontiguousarray(faces["vertex_indices"]),
        np.ascontiguousarray(faces["label"]),
    )
