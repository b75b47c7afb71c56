"""The map's surface cut into its things: one binary glTF with a node for every thing and every piece of structure."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from dsmap.classes import CLASS_NAMES
from dsmap.files import atomic_path
from dsmap.fusion.exports.mesh import upright_trimesh
from dsmap.fusion.exports.surface import SurfaceMesh
from dsmap.fusion.objects.things import Plane, SceneObjects, Thing

REST = "rest"
"""Name of the node with what is nobody's."""


def split_surface(
    surface: SurfaceMesh, surfels: Mapping[str, np.ndarray], scene: SceneObjects
) -> dict[int, SurfaceMesh]:
    """The part of a surface that is each thing's or plane's, by id; 0: nobody's. Every triangle is in one of them.

    Args:
        surface: of these surfels, or of some of them.
        surfels: arrays by the names of `SurfelMap`, N rows.
        scene: the things of these surfels.
    """
    owner = np.zeros(len(surfels["weight"]), np.int32)
    for one in (*scene.planes, *scene.things):
        owner[one.surfels] = one.id
    alive = np.flatnonzero(surfels["weight"] > 0)
    _, nearest = KDTree(surfels["position"][alive]).query(
        np.take(surface.vertices, surface.faces, axis=0).mean(axis=1)
    )
    of_face = owner[alive[nearest]]
    return {int(number): _part(surface, of_face == number) for number in np.unique(of_face)}


def _part(surface: SurfaceMesh, faces: np.ndarray) -> SurfaceMesh:
    used, index = np.unique(surface.faces[faces], return_inverse=True)
    return SurfaceMesh(
        surface.vertices[used], index.reshape(-1, 3).astype(np.int32), surface.normal[used], surface.colour[used],
        surface.label[used],
    )  # fmt: skip


def write_objects_glb(
    path: Path, parts: Mapping[int, SurfaceMesh], scene: SceneObjects, T_level_world: np.ndarray
) -> int:
    """Write the parts as nodes named as in objects.json, y up and the floor at 0; returns how many things have one.

    A node's extras hold `id`, `class` and `score`; of a thing `T_world_box` and `extent` [m] as in objects.json, of a
    plane `corners` [m].

    Raises:
        ModuleNotFoundError: trimesh is not installed.
    """
    import trimesh
    from trimesh.exchange.gltf import export_glb

    named: dict[int, Thing | Plane] = {one.id: one for one in (*scene.things, *scene.planes)}
    nodes = trimesh.Scene()
    for number, part in parts.items():
        mesh = upright_trimesh(part, T_level_world)
        mesh.metadata |= _extras(named[number]) if number else {}
        name = named[number].name if number else REST
        nodes.add_geometry(mesh, node_name=name, geom_name=name)
    with atomic_path(path) as temporary:
        temporary.write_bytes(export_glb(nodes, include_normals=True))
    return sum(thing.id in parts for thing in scene.things)


def _extras(one: Thing | Plane) -> dict[str, Any]:
    values: dict[str, Any] = {"id": one.id, "class": CLASS_NAMES[one.label]}
    if isinstance(one, Plane):
        return values | {"corners": one.corners.round(4).tolist()}
    box = {"T_world_box": one.box.T_world_box.round(4).tolist(), "extent": one.box.extent.round(4).tolist()}
    return values | {"score": round(one.score, 4)} | box
