"""How good the things of a map are: boxes against a recording's instances, supports against its mesh."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage
from scipy.spatial import KDTree

from dsmap.classes import CLASS_NAMES, VOID
from dsmap.fusion.objects.boxes import Box, box_overlap, fit_box
from dsmap.fusion.objects.relations import find_relations
from dsmap.fusion.objects.things import STRUCTURE, SceneObjects
from dsmap.fusion.runs.read_run import SavedRun
from dsmap.fusion.runs.refine import objects_of_run
from dsmap.sequences import Sequence
from dsmap.sequences.mesh import MESH_FILE, LabelledMesh, read_mesh

MIN_OVERLAP = 0.5
"""A box is found by one that overlaps it by this much (intersection over union)."""
_CELL = 0.02
_SEEN_TWICE = 2
"""Pixels in a cell of an instance before it counts: a single one may be a flying pixel."""
_LEAST = 50
"""Cells of the smallest instance that was seen well enough to be asked for: 2 dm^2 of surface."""
_THINNEST = 0.05
"""Both boxes' sides count as at least this [m]: a picture is as thick as its depth is noisy."""
_SAME = 0.25
"""Overlap from which a thing is taken for an instance where relations are compared."""
_TOUCH, _FACES_UP = 0.03, 0.9
_STRUCTURE = [CLASS_NAMES.index(name) for name in STRUCTURE]


@dataclass(frozen=True)
class Instance:
    """A thing of the recording, as far as the camera saw it."""

    id: int
    label: int
    box: Box


def evaluate_objects(run: SavedRun, reference: Sequence) -> dict[str, Any]:
    """Scores of the things of a map that was made with the reference's own poses; None with a reason for others.

    Keys: those of `average_precision`, and `supports` with `stated`, `right` and `asked`, where the reference has a
    mesh.
    """
    nothing: dict[str, Any] = {"map50": None, "precision": None, "recall": None, "supports": None}
    if run.config.poses != "given" or not any(entry.instance is not None for entry in reference.entries):
        return nothing | {"reason": "needs --poses given and a recording with instances"}
    scene = objects_of_run(run)
    up = scene.up
    instances = seen_instances(reference, up, run.config.depth_range[1])
    scores = nothing | average_precision(match_boxes(scene, instances), instances)
    if (reference.path / MESH_FILE).is_file():
        mesh = read_mesh(reference.path / MESH_FILE)
        if mesh.instance is not None:
            counts = compare_supports(scene, instances, true_supports(mesh, up))
            scores["supports"] = dict(zip(("stated", "right", "asked"), counts, strict=True))
    return scores


def seen_instances(sequence: Sequence, up: np.ndarray, depth_max: float, stride: int = 2) -> list[Instance]:
    """The things that the recording's frames show, boxed over the depth that its camera measured of them.

    Args:
        sequence: with instances, labels and poses.
        up: unit vector in the world of its poses, shape (3,).
        depth_max: [m].
        stride: every n-th frame is looked at.
    """
    points: dict[int, list[np.ndarray]] = {}
    votes: dict[int, np.ndarray] = {}
    k = sequence.intrinsics
    y, x = np.mgrid[: k.height, : k.width]
    for i in range(0, len(sequence), stride):
        frame = sequence.frame(i)
        if frame.instance is None or frame.label is None or frame.T_world_camera is None:
            continue
        same = ndimage.maximum_filter(frame.instance, 3) == ndimage.minimum_filter(frame.instance, 3)
        good = same & (frame.depth > 0) & (frame.depth <= depth_max)
        good &= (frame.label != VOID) & ~np.isin(frame.label, _STRUCTURE)
        z = frame.depth[good].astype(np.float64)
        camera = np.stack([(x[good] - k.cx) / k.fx * z, (y[good] - k.cy) / k.fy * z, z], axis=1)
        world = camera @ frame.T_world_camera[:3, :3].T + frame.T_world_camera[:3, 3]
        ids, labels = frame.instance[good], frame.label[good]
        for number in np.unique(ids[ids > 0]).tolist():
            here = ids == number
            points.setdefault(number, []).append(world[here])
            votes[number] = votes.get(number, 0) + np.bincount(labels[here], minlength=len(CLASS_NAMES))
    found = []
    for number, parts in sorted(points.items()):
        cells, count = np.unique(np.floor(np.concatenate(parts) / _CELL), axis=0, return_counts=True)
        cells = (cells[count >= _SEEN_TWICE] + 0.5) * _CELL
        if len(cells) >= _LEAST:
            found.append(Instance(number, int(votes[number].argmax()), fit_box(cells, up)))
    return found


def match_boxes(scene: SceneObjects, instances: list[Instance]) -> list[tuple[int, float, bool]]:
    """(class, score, right) of every thing: right where its box is the best unclaimed one of its class, best first.

    Things too small to be asked for are no answers, unless they are right.
    """
    cells = np.bincount(scene.owner, minlength=len(scene.things) + 1)
    free = {instance.id for instance in instances}
    answers = []
    for thing in sorted(scene.things, key=lambda t: -t.score):
        box, best, home = thing.box.at_least(_THINNEST), MIN_OVERLAP, None
        for one in instances:
            if one.label == thing.label and one.id in free:
                common = box_overlap(box, one.box.at_least(_THINNEST))
                if common >= best:
                    best, home = common, one.id
        free.discard(home or 0)
        if home is not None or cells[thing.id] >= _LEAST:
            answers.append((thing.label, thing.score, home is not None))
    return answers


def average_precision(answers: list[tuple[int, float, bool]], instances: list[Instance]) -> dict[str, Any]:
    """AP of each class that the instances have, their mean, and recall and precision over all.

    AP is the area under precision over recall, precision made monotonous (Everingham et al., VOC 2010). Answers and
    instances of several scenes are simply joined.
    """
    per_class = {}
    for label in sorted({one.label for one in instances}):
        asked = sum(one.label == label for one in instances)
        right = np.array(
            [hit for _, _, hit in sorted((a for a in answers if a[0] == label), key=lambda a: -a[1])], bool
        )
        recall = np.cumsum(right) / asked
        precision = np.cumsum(right) / np.arange(1, len(right) + 1)
        best_after = np.maximum.accumulate(precision[::-1])[::-1]
        area = float((np.diff(recall, prepend=0.0) * best_after).sum())
        per_class[CLASS_NAMES[label]] = {"ap": area, "instances": asked, "things": len(right)}
    hits = sum(right for _, _, right in answers)
    return {
        "map50": float(np.mean([c["ap"] for c in per_class.values()])) if per_class else None,
        "precision": hits / len(answers) if answers else None,
        "recall": hits / len(instances) if instances else None,
        "per_class": per_class,
    }


def true_supports(mesh: LabelledMesh, up: np.ndarray) -> set[tuple[int, int]]:
    """Pairs (carrier, carried) of instances: the carrier has surface facing up within 3 cm of the carried one's bottom.

    A floor is instance 0, whatever its number. Walls, ceilings and windows take no part.
    """
    points, normal, label, instance = _sampled(mesh)
    heights = points @ up
    flat = normal @ up > _FACES_UP
    floor = label == CLASS_NAMES.index("floor")
    owner = np.where(floor, 0, instance.astype(np.int64))
    usable = floor | ~np.isin(label, _STRUCTURE)
    tops = np.flatnonzero(flat & usable)
    tree = KDTree(points[tops])
    pairs = set()
    for number in np.unique(owner[usable & ~floor]).tolist():
        own = np.flatnonzero((owner == number) & usable & ~floor)
        lowest = heights[own].min()
        bottom = points[own[heights[own] < lowest + _TOUCH]]
        near = np.unique(np.concatenate([*tree.query_ball_point(bottom, 1.5 * _TOUCH), []]).astype(int))
        below = [n for n in tops[near] if owner[n] != number and abs(heights[n] - lowest) < _TOUCH]
        if below:
            pairs.add((int(np.bincount(owner[below]).argmax()), number))
    return pairs


def compare_supports(
    scene: SceneObjects, instances: list[Instance], true: set[tuple[int, int]]
) -> tuple[int, int, int]:
    """How many supports the scene states, how many of them are true, and how many there are among what was seen."""
    home: dict[int, int] = {}
    for thing in scene.things:
        box = thing.box.at_least(_THINNEST)
        common = [(box_overlap(box, one.box.at_least(_THINNEST)), one.id) for one in instances]
        if common and max(common)[0] >= _SAME:
            home[thing.id] = max(common)[1]
    home |= {p.id: 0 for p in scene.planes if CLASS_NAMES[p.label] == "floor"}
    stated = {(r.subject, r.object) for r in find_relations(scene) if r.kind == "supports"}
    said = {(home[a], home[b]) for a, b in stated if a in home and b in home}
    seen = {0} | {one.id for one in instances}
    asked = {(a, b) for a, b in true if a in seen and b in seen}
    return len(stated), len(said & true), len(asked)


def _sampled(
    mesh: LabelledMesh, spacing: float = 0.03
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points on the mesh about `spacing` apart, with the normal, class and instance of their faces."""
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double = np.linalg.norm(cross, axis=1)
    rng = np.random.default_rng(0)
    count = np.minimum(np.maximum(double / 2 / spacing**2, 1), 200_000).astype(int)
    face = np.repeat(np.arange(len(count)), count)
    u, v = rng.random((2, len(face)))
    flip = u + v > 1
    u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
    a, b, c = corners[face].transpose(1, 0, 2)
    points = a + u[:, None] * (b - a) + v[:, None] * (c - a)
    normal = cross / np.maximum(double, 1e-12)[:, None]
    assert mesh.instance is not None
    return points, normal[face], mesh.label[face], mesh.instance[face]
