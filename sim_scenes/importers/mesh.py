"""Readers of triangle meshes for `importers`: GLB, glTF and OBJ scenes, labelled PLY scans."""

import contextlib
import logging
import warnings
from collections.abc import Hashable, Iterator
from pathlib import Path, PurePosixPath
from typing import Any

import cv2
import numpy as np
import trimesh
from trimesh.resolvers import FilePathResolver

from dsmap.errors import InputError, InputWarning
from dsmap.limits import MAX_IMAGE_BYTES, MAX_MESH_BYTES
from dsmap.plain import read_json
from dsmap.reading import check_plain, reason
from dsmap.sim_scenes.geometry.shapes import Shape
from dsmap.sim_scenes.importers.chunk import Chunk, Foreign
from dsmap.sim_scenes.importers.class_map import everyday, own
from dsmap.sim_scenes.scene import Material

_LABELS = ("label", "semantic", "semantic_id", "class", "class_id", "scalar_label", "category_id")
_OBJECTS = ("object_id", "objectid", "instance", "instance_id")
_MAX_BESIDE = {".mtl": 1 << 24, **dict.fromkeys((".png", ".jpg", ".jpeg"), MAX_IMAGE_BYTES)}
"""How large the materials and textures of a mesh may be [bytes]."""
LARGEST_TEXTURE = 1024
"""Images of materials are reduced to this many texels a side."""
GREY = np.array([170, 170, 170], np.uint8)


def read_scene(path: Path) -> Foreign:
    """GLB, glTF, OBJ: a chunk for each node; its name, its geometry's and its material's may say the class."""
    loaded = _load(path)
    world = loaded if isinstance(loaded, trimesh.Scene) else trimesh.Scene(loaded)
    chunks, looks = [], {}
    for node in world.graph.nodes_geometry:
        transform, name = world.graph[node]
        mesh = world.geometry[name]
        if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
            continue
        vertices = trimesh.transform_points(mesh.vertices, transform)
        faces = np.asarray(mesh.faces)
        if np.linalg.det(transform[:3, :3]) < 0:
            faces = faces[:, ::-1]
        visual: Any = mesh.visual
        source: Any = getattr(visual, "material", None)
        keys: list[Hashable] = [node, name, str(getattr(source, "name", None) or "")]
        if visual.kind == "texture" and visual.uv is not None:
            uv = np.asarray(visual.uv)[:, :2] * [1, -1] + [0, 1]
            shape = Shape(vertices, faces, uv)
            material = looks.setdefault(id(source), _material(source))
        elif visual.kind in ("vertex", "face"):
            shape, material = coloured(vertices, faces, _corner_colours(mesh))
        else:
            shape = Shape(vertices, faces, np.zeros((len(vertices), 2)))
            material = looks.setdefault(id(source), _material(source))
        if getattr(source, "doubleSided", False):
            shape = Shape(shape.vertices, np.concatenate([shape.faces, shape.faces[:, ::-1]]), shape.uv)
        chunks.append(Chunk(shape, material, [k for k in keys if k], node))
    return Foreign(chunks, [], "y" if path.suffix.lower() != ".obj" else "z", lit=False)


def read_scan(path: Path) -> Foreign:
    """A scan: colours a vertex (shown as they are), a class or object id for each vertex or face."""
    mesh = _load(path)
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise InputError(f"{path}: found no faces, expected a triangle mesh with labels")
    raw = {
        name: element["data"] for name, element in mesh.metadata["_ply_raw"].items() if element.get("length")
    }
    vertices = np.column_stack([_column(raw["vertex"], axis) for axis in "xyz"]).astype(float)
    faces, polygon = _triangles(path, raw["face"])
    labels, objects = (_ids(raw, faces, polygon, names) for names in (_LABELS, _OBJECTS))
    if labels is None and objects is None:
        found = ", ".join([*_names(raw["vertex"]), *_names(raw["face"])])
        raise InputError(
            f"{path}: found properties {found}, expected one of {', '.join((*_LABELS, *_OBJECTS))}"
        )
    colours = _colours(raw, faces, polygon)
    shape, material = coloured(vertices, faces, colours, emission=1.0)
    ids = objects if labels is None else labels
    assert ids is not None
    keys, names = _replica(path) if labels is None else (None, None)
    group = np.stack([ids, ids if objects is None else objects], 1)
    chunks = []
    for value, thing in np.unique(group, axis=0).tolist():
        mine = (group == (value, thing)).all(1)
        name: list[Hashable] = [names[value]] if names is not None and value in names else [value]
        chunks.append(Chunk(_subset(shape, mine), material, name, (value, thing)))
    return Foreign(chunks, [], "z", lit=True, class_map=own() if _is_ours(path) else keys)


def _load(path: Path) -> Any:
    check_plain(path, f"a {path.suffix[1:].upper()} mesh", MAX_MESH_BYTES)
    try:
        with _told_of_losses(path):
            return trimesh.load(path, process=False, resolver=_Beside(str(path)))
    except Exception as error:  # trimesh lets through whatever its parsers meet
        raise InputError(
            f"{path}: not readable as a {path.suffix[1:].upper()} mesh ({reason(error)})"
        ) from error


class _Beside(FilePathResolver):
    """What a mesh names beside itself (materials, textures, buffers): plain files of a bounded size."""

    def get(self, name: str) -> bytes:
        for candidate in (name.strip(), name.strip().lstrip("/"), PurePosixPath(name).name):
            path = Path(self.parent) / candidate
            if path.exists():
                most = _MAX_BESIDE.get(path.suffix.lower(), MAX_MESH_BYTES)
                check_plain(path, "a file that belongs to a mesh", most)
                break
        return super().get(name)


class _Losses(logging.Handler):
    """Collects what trimesh could not load."""

    def __init__(self) -> None:
        super().__init__(logging.DEBUG)
        self.found: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        text = " ".join(record.getMessage().split())
        if (
            text.lower().startswith(("failed to load", "unable to load", "failed to"))
            and text not in self.found
        ):
            self.found.append(text)


@contextlib.contextmanager
def _told_of_losses(path: Path) -> Iterator[None]:
    """An image or a material that trimesh cannot load becomes grey, with no more than a line for debugging."""
    log, losses = logging.getLogger("trimesh"), _Losses()
    level, passes_on = log.level, log.propagate
    log.addHandler(losses)
    log.setLevel(logging.DEBUG)
    log.propagate = False
    try:
        yield
    finally:
        log.removeHandler(losses)
        log.setLevel(level)
        log.propagate = passes_on
        for text in losses.found:
            warnings.warn(InputWarning(f"{path}: {text}: what it belongs to is shown plain"), stacklevel=2)


def _is_ours(path: Path) -> bool:
    with path.open("rb") as file:
        return b"comment dsmap" in file.read(400)


def _replica(path: Path) -> tuple[Any, dict[int, str] | None]:
    """Replica's `info_semantic.json` beside the mesh: the class name of every object id."""
    beside = path.parent / "info_semantic.json"
    if not beside.is_file():
        return None, None
    content = read_json(beside, "Replica's classes (id, name) and objects (id, class_id)")
    try:
        names = {int(c["id"]): str(c["name"]) for c in content["classes"]}
        return everyday(), {int(o["id"]): names.get(int(o["class_id"]), "void") for o in content["objects"]}
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{beside}: found {reason(error)}, expected Replica's classes (id, name) and objects (id, class_id)"
        ) from error


def _names(data: Any) -> list[str]:
    return list(data.dtype.names if isinstance(data, np.ndarray) else data)


def _column(data: Any, name: str) -> np.ndarray:
    return np.asarray(data[name]).reshape(-1)


def _triangles(path: Path, data: Any) -> tuple[np.ndarray, np.ndarray]:
    """Fans of all polygons (F, 3), and which polygon each triangle is of (F,)."""
    name = next((n for n in ("vertex_indices", "vertex_index") if n in _names(data)), None)
    if name is None:
        raise InputError(f"{path}: found faces without vertex_indices, expected a triangle mesh")
    corners = np.asarray(data[name])
    if corners.dtype.names:
        corners = corners[corners.dtype.names[-1]]
    if corners.dtype == object:
        fans = [np.stack([np.full(len(c) - 2, c[0]), c[1:-1], c[2:]], 1) for c in corners]
        return np.concatenate(fans), np.repeat(np.arange(len(fans)), [len(f) for f in fans])
    corners = corners.reshape(len(corners), -1)
    count = corners.shape[1] - 2
    fans = [np.stack([corners[:, 0], corners[:, k + 1], corners[:, k + 2]], 1) for k in range(count)]
    return np.concatenate(fans).astype(np.int64), np.tile(np.arange(len(corners)), count)


def _ids(
    raw: dict[str, Any], faces: np.ndarray, polygon: np.ndarray, names: tuple[str, ...]
) -> np.ndarray | None:
    """Id of each triangle, from a property of faces, else the one that most of its corners have."""
    for element in ("face", "vertex"):
        lower = {n.lower(): n for n in _names(raw[element])}
        name = next((lower[n] for n in names if n in lower), None)
        if name is None:
            continue
        values = _column(raw[element], name).astype(np.int64)
        if element == "face":
            return values[polygon]
        a, b, c = values[faces].T
        return np.where(b == c, b, a)
    return None


def _colours(raw: dict[str, Any], faces: np.ndarray, polygon: np.ndarray) -> np.ndarray:
    """Colour of each triangle's corners, (F, 3, 3) uint8; grey where there are none."""
    for element, index in (("vertex", faces), ("face", np.repeat(polygon[:, None], 3, 1))):
        if {"red", "green", "blue"} <= set(_names(raw[element])):
            colours = np.column_stack([_column(raw[element], n) for n in ("red", "green", "blue")])
            scale = 255 if np.issubdtype(colours.dtype, np.floating) else 1
            return (colours * scale).astype(np.uint8)[index]
    return np.broadcast_to(GREY, (len(faces), 3, 3))


def _corner_colours(mesh: trimesh.Trimesh) -> np.ndarray:
    """Of a mesh with colours a vertex or a face, (F, 3, 3) uint8."""
    visual: Any = mesh.visual
    if visual.kind == "face":
        return np.repeat(np.asarray(visual.face_colors)[:, None, :3], 3, 1)
    return np.asarray(visual.vertex_colors)[:, :3][mesh.faces]


def coloured(
    vertices: np.ndarray, faces: np.ndarray, colours: np.ndarray, emission: float = 0.0
) -> tuple[Shape, Material]:
    """A mesh whose colours run linearly over each triangle, as a texture that every renderer can show.

    Each triangle gets 2 x 2 texels: three hold its corners' colours, the fourth continues them linearly, so
    that bilinear filtering between their centres gives exactly the interpolated colours, and no neighbour's.

    Args:
        vertices: (V, 3) [m].
        faces: (F, 3).
        colours: of the corners, uint8 (F, 3, 3).
        emission: 1 where the colours hold the light already.
    """
    count = len(faces)
    side = int(np.ceil(np.sqrt(count)))
    corner = colours.astype(np.int16)
    fourth = np.clip(corner[:, 1] + corner[:, 2] - corner[:, 0], 0, 255)
    blocks = np.zeros((side * side, 2, 2, 3), np.uint8)
    blocks[:count, 0, 0], blocks[:count, 0, 1], blocks[:count, 1, 0] = (
        corner[:, 0],
        corner[:, 1],
        corner[:, 2],
    )
    blocks[:count, 1, 1] = fourth
    image = blocks.reshape(side, side, 2, 2, 3).transpose(0, 2, 1, 3, 4).reshape(2 * side, 2 * side, 3)
    row, column = np.divmod(np.arange(count), side)
    first = np.stack([column, row], 1) * 2 + 0.5
    uv = (first[:, None] + np.array([[0, 0], [1, 0], [0, 1]])) / (2 * side)
    shape = Shape(vertices[faces].reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), uv.reshape(-1, 2))
    return shape, Material(np.ascontiguousarray(image), 1.0, 0.02, 0.1, emission=emission)


def _subset(shape: Shape, faces: np.ndarray) -> Shape:
    """Some of the faces of a mesh in which no two share vertices."""
    corner = shape.faces[faces].reshape(-1)
    return Shape(shape.vertices[corner], np.arange(len(corner)).reshape(-1, 3), shape.uv[corner])


def _material(source: Any) -> Material:
    """Of a trimesh material: its base colour texture times factor, or its plain colour."""
    image = getattr(source, "baseColorTexture", None) or getattr(source, "image", None)
    factor = getattr(source, "baseColorFactor", None)
    if image is None:
        plain = getattr(source, "main_color", None)
        texture = np.broadcast_to(GREY if plain is None else np.asarray(plain)[:3], (4, 4, 3)).astype(
            np.uint8
        )
    else:
        texture = np.asarray(image.convert("RGB"))
        shrink = LARGEST_TEXTURE / max(texture.shape[:2])
        if shrink < 1:
            texture = cv2.resize(texture, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
        if factor is not None:
            texture = (texture * (np.asarray(factor)[:3] / 255.0)).astype(np.uint8)
    rough = getattr(source, "roughnessFactor", None)
    metal = getattr(source, "metallicFactor", None)
    shine = 0.1 if rough is None else 1 - float(rough)
    return Material(
        np.ascontiguousarray(texture),
        1.0,
        0.3 * shine,
        shine,
        metallic=0.0 if metal is None else float(metal),
    )
