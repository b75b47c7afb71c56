"""The map's surface as PLY, OBJ or GLB."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dsmap.classes import colourise
from dsmap.files import atomic_path
from dsmap.fusion.exports.level import transformed
from dsmap.fusion.exports.surface import SurfaceMesh

if TYPE_CHECKING:
    import trimesh

_VERTEX = [
    *((name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")),
    *((name, "u1") for name in ("red", "green", "blue", "label")),
]
_T_GLTF_LEVEL = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""glTF and most programs that read OBJ have y up."""


def write_mesh_ply(path: Path, surface: SurfaceMesh, T_level_world: np.ndarray) -> None:
    """Write a binary PLY in the world's frame: vertices with normal, colour and `label`, triangles."""
    vertices = np.zeros(len(surface.vertices), dtype=_VERTEX)
    for axis in range(3):
        vertices["xyz"[axis]] = surface.vertices[:, axis]
        vertices[("nx", "ny", "nz")[axis]] = surface.normal[:, axis]
        vertices[("red", "green", "blue")[axis]] = surface.colour[:, axis]
    vertices["label"] = surface.label
    faces = np.zeros(len(surface.faces), dtype=[("count", "u1"), ("vertex", "<i4", (3,))])
    faces["count"], faces["vertex"] = 3, surface.faces
    header = ["ply", "format binary_little_endian 1.0", "comment surface by dsmap, metres, world frame"]
    header += ["comment up " + " ".join(f"{v:.6f}" for v in T_level_world[2, :3])]
    header += [f"element vertex {len(vertices)}"]
    header += [f"property {'uchar' if kind == 'u1' else 'float'} {name}" for name, kind in _VERTEX]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(("\n".join(header) + "\n").encode("ascii"))
        vertices.tofile(file)
        faces.tofile(file)


def write_mesh_glb(path: Path, surface: SurfaceMesh, T_level_world: np.ndarray) -> None:
    """Write binary glTF with y up and the floor at 0: colours, and the class of a vertex as attribute `_LABEL`.

    Raises:
        ModuleNotFoundError: trimesh is not installed.
    """
    from trimesh.exchange.gltf import export_glb

    mesh = upright_trimesh(surface, T_level_world)
    mesh.vertex_attributes["_LABEL"] = surface.label.astype(np.float32)
    with atomic_path(path) as temporary:
        temporary.write_bytes(export_glb(mesh, include_normals=True))


def write_mesh_obj(path: Path, surface: SurfaceMesh, T_level_world: np.ndarray) -> None:
    """Write Wavefront OBJ with y up and the floor at 0, and colours behind the coordinates, as Blender and MeshLab
    read them. OBJ has no place for labels.

    Raises:
        ModuleNotFoundError: trimesh is not installed.
    """
    from trimesh.exchange.obj import export_obj

    mesh = upright_trimesh(surface, T_level_world)
    with atomic_path(path) as temporary:
        temporary.write_text(export_obj(mesh, include_normals=True, include_color=True))


MESH_WRITERS: dict[str, Callable[[Path, SurfaceMesh, np.ndarray], None]] = {
    "ply": write_mesh_ply, "obj": write_mesh_obj, "glb": write_mesh_glb,
}  # fmt: skip
"""File type to the function that writes a surface, given T_level_world."""


def in_class_colours(surface: SurfaceMesh) -> SurfaceMesh:
    """The surface in the colours of its classes."""
    return SurfaceMesh(
        surface.vertices, surface.faces, surface.normal, colourise(surface.label), surface.label
    )


def upright_trimesh(surface: SurfaceMesh, T_level_world: np.ndarray) -> "trimesh.Trimesh":
    """The surface with its colours for trimesh's writers, y up and the floor at 0.

    Raises:
        ModuleNotFoundError: trimesh is not installed.
    """
    import trimesh
    from trimesh.visual import ColorVisuals

    T = _T_GLTF_LEVEL @ T_level_world
    mesh = trimesh.Trimesh(
        transformed(T, surface.vertices),
        surface.faces,
        vertex_normals=surface.normal @ T[:3, :3].T,
        process=False,
    )
    mesh.visual = ColorVisuals(mesh, vertex_colors=surface.colour)
    return mesh
