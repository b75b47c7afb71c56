"""A scene of the user's own instead of a procedural one: MJCF, GLB/glTF/OBJ, or a labelled PLY mesh.

Classes come from a class map (`class_map`): names of MuJoCo geoms and bodies, of nodes and materials of a
GLB, or ids of a labelled mesh (ScanNet's NYU40 labels, Replica's object ids with `info_semantic.json`).
The floor is found and put at z = 0, the middle of the scene at x = y = 0; rooms, targets and, where the
file has none, lights follow from the bounds.
"""

from collections.abc import Hashable
from pathlib import Path

import numpy as np

from dsmap.classes import CLASS_NAMES
from dsmap.errors import InputError
from dsmap.plain import brief
from dsmap.reading import is_file, reading
from dsmap.sim_scenes.geometry.shapes import Shape, merged
from dsmap.sim_scenes.importers.chunk import Foreign
from dsmap.sim_scenes.importers.class_map import everyday, read_class_map
from dsmap.sim_scenes.rooms import lighting
from dsmap.sim_scenes.scene import Part, Room, Scene

MESHES = (".glb", ".gltf", ".obj")
SCENE_FORMATS = (*MESHES, ".ply", ".xml")
_SHELL = tuple(CLASS_NAMES.index(name) for name in ("wall", "floor", "ceiling", "window", "void"))
_FARTHEST = 1e4
"""Of a vertex from the origin [m]."""
_SMALLEST = 1e-3
"""Extent of a scene [m]."""
TARGETS = 40
"""Most things to look at."""


def load_scene(path: Path | str, class_map: Path | str | None = None, up: str | None = None) -> Scene:
    """A scene from a file, ready for `open_renderer` and camera paths.

    Args:
        path: .xml (MJCF), .glb, .gltf, .obj, or .ply with a label or object id for each vertex or face.
        class_map: YAML or CSV file of names or ids to classes; None: built-in names, NYU40 ids, or what the
            file says itself.
        up: `z` or `y`; None = what the format says (y for glTF, z for all others).

    Raises:
        InputError: unreadable or foreign file, things without a class (listed), no faces.
    """
    path = Path(path)
    if path.suffix.lower() not in SCENE_FORMATS:
        raise InputError(
            f"{path}: found {path.suffix or 'no suffix'}, expected a file of: {', '.join(SCENE_FORMATS)}"
        )
    if not is_file(path):
        raise InputError(f"{path}: there is no such file")
    if up not in (None, "y", "z"):
        raise InputError(f"up is {up!r}; expected y or z")
    own_classes = read_class_map(class_map) if class_map else None
    with reading(path, "a scene"), np.errstate(all="ignore"):
        foreign = _read(path)
        _check(path, foreign)
        classes = own_classes or foreign.class_map or everyday()
        labels = [classes.resolve(chunk.keys) for chunk in foreign.chunks]
        classes.require(path)
        turn = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]) if (up or foreign.up) == "y" else np.eye(3)
        shapes = [chunk.shape.turned(turn) for chunk in foreign.chunks]
        shift = -_origin(merged(shapes))
        return _assemble(path, foreign, [s.moved(shift) for s in shapes], labels, turn, shift)


def _check(path: Path, foreign: Foreign) -> None:
    """Refuse what no renderer can show: no faces, faces beyond the vertices, vertices that are nowhere.

    Raises:
        InputError: names the thing.
    """
    if not foreign.chunks:
        raise InputError(f"{path}: found no faces, expected at least one triangle mesh")
    for chunk in foreign.chunks:
        shape, name = chunk.shape, brief(chunk.keys[0]) if chunk.keys else "a mesh"
        if not len(shape.faces) or not 0 <= shape.faces.min() <= shape.faces.max() < len(shape.vertices):
            raise InputError(
                f"{path}: {name} has faces beyond its {len(shape.vertices)} vertices, or none; expected some"
            )
        if not np.abs(shape.vertices).max() <= _FARTHEST:  # not so for NaN
            raise InputError(
                f"{path}: {name} has a vertex at {np.abs(shape.vertices).max():g}; expected metres, at most "
                f"{_FARTHEST:g}"
            )
        if not np.isfinite(shape.uv).all():
            raise InputError(
                f"{path}: {name} has texture coordinates that are no numbers; expected finite ones"
            )
    whole = np.array([chunk.shape.bounds() for chunk in foreign.chunks])
    if not (whole[:, 1].max(0) - whole[:, 0].min(0)).max() > _SMALLEST:
        raise InputError(f"{path}: the whole scene is a point; expected one of at least {_SMALLEST:g} m")


def _read(path: Path) -> Foreign:
    if path.suffix.lower() == ".xml":
        from dsmap.sim_scenes.importers.mjcf import read_mjcf

        return read_mjcf(path)
    from dsmap.sim_scenes.importers.mesh import read_scan, read_scene

    return read_scan(path) if path.suffix.lower() == ".ply" else read_scene(path)


def _assemble(
    path: Path,
    foreign: Foreign,
    shapes: list[Shape],
    labels: list[int | None],
    turn: np.ndarray,
    shift: np.ndarray,
) -> Scene:
    whole = np.array([shape.bounds() for shape in shapes])
    low, high = whole[:, 0].min(0), whole[:, 1].max(0)
    room = Room("imported", low[:2], high[:2], float(high[2]))
    scene = Scene(path.stem, 0, np.array([*(high - low)[:2], high[2]]), {}, rooms=[room])
    names: dict[int, str] = {}
    things: dict[Hashable, int] = {}
    for chunk, shape, label in zip(foreign.chunks, shapes, labels, strict=True):
        if id(chunk.material) not in names:
            names[id(chunk.material)] = f"material_{len(names)}"
            scene.materials[names[id(chunk.material)]] = chunk.material
        instance = things.setdefault(chunk.thing, len(things) + 1)
        scene.parts.append(Part(shape, names[id(chunk.material)], int(label or 0), instance))
    scene.instances = len(things)
    if len(things) > np.iinfo(np.uint16).max:
        raise InputError(f"{path}: found {len(things)} things, expected at most 65535")
    scene.targets = _targets(scene)
    if foreign.lit:
        scene.ambient = np.zeros(3)
    elif foreign.lights:
        moved = [lighting.moved_lamp(light, turn, shift) for light in foreign.lights]
        lighting.imported(scene, moved)
    else:
        lighting.imported(scene, lighting.ceiling_lights(room))
    return scene


def _origin(whole: Shape) -> np.ndarray:
    """Middle of the scene on its floor: the height at which most upward area lies, in the lowest third."""
    corner = whole.vertices[whole.faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = np.linalg.norm(normal, axis=1) / 2
    z, (low, high) = corner[:, :, 2].mean(1), (whole.vertices.min(0), whole.vertices.max(0))
    level = (np.abs(normal[:, 2]) > 1.8 * area) & (z < low[2] + max(0.34 * (high[2] - low[2]), 0.01))
    floor = low[2]
    if area[level].sum() > 0:
        edges = np.arange(low[2] - 0.025, z[level].max() + 0.06, 0.05)
        weight, _ = np.histogram(z[level], edges, weights=area[level])
        inside = level & (np.abs(z - (edges[weight.argmax()] + 0.025)) <= 0.05)
        floor = float(np.average(z[inside], weights=area[inside]))
    return np.array([*(low[:2] + high[:2]) / 2, floor])


def _targets(scene: Scene) -> list[np.ndarray]:
    """The middles of things that are no wall, floor or ceiling, the largest first; else the room's middle."""
    boxes: dict[int, list[np.ndarray]] = {}
    for part in scene.parts:
        if part.label not in _SHELL:
            boxes.setdefault(part.instance, []).append(part.shape.bounds())
    found = []
    for several in boxes.values():
        low, high = np.min([b[0] for b in several], 0), np.max([b[1] for b in several], 0)
        found.append((float(np.prod(np.maximum(high - low, 0.02))), (low + high) / 2))
    found.sort(key=lambda item: -item[0])
    return [middle for _, middle in found[:TARGETS]] or [np.array([0.0, 0.0, scene.rooms[0].height / 2])]
