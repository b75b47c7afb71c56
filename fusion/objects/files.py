"""`objects.json` and `scene_graph.json` of a RUN."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dsmap.classes import CLASS_NAMES
from dsmap.errors import InputError
from dsmap.files import write_json
from dsmap.fusion.objects.boxes import Box
from dsmap.fusion.objects.relations import find_relations, find_rooms
from dsmap.fusion.objects.things import Plane, SceneObjects, Thing
from dsmap.plain import read_json

OBJECTS, SCENE_GRAPH = "objects.json", "scene_graph.json"
"""Names of the files."""
_EXPECTED = "objects.json as `dsmap map` writes it"


@dataclass(frozen=True)
class NamedBox:
    """A thing as its file has it."""

    name: str
    label: int
    box: Box


def write_objects(folder: Path | str, scene: SceneObjects) -> None:
    """Write both files into a folder; each is whole or absent."""
    write_json(Path(folder) / OBJECTS, objects_tree(scene))
    write_json(Path(folder) / SCENE_GRAPH, graph_tree(scene))


def remove_objects(folder: Path | str) -> None:
    """Remove the files of an earlier run: they tell of another map than the one that is there now."""
    for name in (OBJECTS, SCENE_GRAPH):
        (Path(folder) / name).unlink(missing_ok=True)


def read_boxes(folder: Path | str) -> list[NamedBox]:
    """The boxes of a RUN's objects.json; none where it has no such file.

    Raises:
        InputError: the file is damaged.
    """
    path = Path(folder) / OBJECTS
    if not path.is_file():
        return []
    tree = read_json(path, _EXPECTED)
    try:
        return [_named_box(one) for one in tree["objects"]]
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: damaged ({error}); expected {_EXPECTED}") from error


def _named_box(one: dict[str, Any]) -> NamedBox:
    T, extent = (np.array(one["box"][name], np.float64) for name in ("T_world_box", "extent"))
    if T.shape != (4, 4) or extent.shape != (3,) or not (np.isfinite(T).all() and np.isfinite(extent).all()):
        raise ValueError(f"box of {str(one['name'])[:40]!r}")
    return NamedBox(str(one["name"]), CLASS_NAMES.index(one["class"]), Box(T, extent))


def objects_tree(scene: SceneObjects) -> dict[str, Any]:
    """The content of `objects.json`: metres, world frame."""
    return {
        "up": _numbers(scene.up),
        "objects": [_thing(thing) for thing in scene.things],
        "structure": [_plane(plane) for plane in scene.planes],
    }


def graph_tree(scene: SceneObjects) -> dict[str, Any]:
    """The content of `scene_graph.json`: nodes by id, edges by subject."""
    names = {one.id: one for one in (*scene.things, *scene.planes)}
    return {
        "rooms": [
            {"id": r.id, "centre": _numbers(r.centre), "area": round(r.area, 2), "members": r.members}
            for r in find_rooms(scene)
        ],
        "nodes": [{"id": i, "name": one.name, "class": CLASS_NAMES[one.label]} for i, one in names.items()],
        "edges": [
            {"subject": r.subject, "relation": r.kind, "object": r.object} for r in find_relations(scene)
        ],
    }


def _thing(thing: Thing) -> dict[str, Any]:
    return {
        "id": thing.id,
        "name": thing.name,
        "class": CLASS_NAMES[thing.label],
        "probabilities": dict(zip(CLASS_NAMES[1:], _numbers(thing.probabilities), strict=True)),
        "box": {
            "T_world_box": [_numbers(row) for row in thing.box.T_world_box],
            "extent": _numbers(thing.box.extent),
        },
        "centroid": _numbers(thing.centroid),
        "surfels": len(thing.surfels),
        "observations": round(thing.observations, 2),
        "first_seen": thing.first_seen,
        "last_seen": thing.last_seen,
    }


def _plane(plane: Plane) -> dict[str, Any]:
    return {
        "id": plane.id,
        "name": plane.name,
        "class": CLASS_NAMES[plane.label],
        "normal": _numbers(plane.normal),
        "offset": round(plane.offset, 4),
        "corners": [_numbers(corner) for corner in plane.corners],
        "extent": _numbers(np.array(plane.extent)),
        "surfels": len(plane.surfels),
    }


def _numbers(values: np.ndarray) -> list[float]:
    return [round(float(v), 4) for v in values]
