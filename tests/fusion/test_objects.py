"""Segments, things, planes and relations of a small room; maps that have nothing to find."""

import json

import corner_frames
import numpy as np
import pytest
from synthetic_map import map_of, room_arrays

from dsmap.classes import CLASS_NAMES
from dsmap.fusion.config import SegmentConfig
from dsmap.fusion.labels.semantics import GroundTruthSegmenter
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.objects.boxes import EDGES, Box, box_overlap, fit_box
from dsmap.fusion.objects.files import graph_tree, objects_tree, write_objects
from dsmap.fusion.objects.pooling import pool_probabilities, set_probabilities
from dsmap.fusion.objects.relations import find_relations
from dsmap.fusion.objects.segments import segment_map
from dsmap.fusion.objects.things import SceneObjects, find_objects
from dsmap.fusion.runs.read_run import load_run
from dsmap.fusion.runs.run_folder import save_run
from dsmap.kernels.label import posterior
from dsmap.kernels.segment_graph import join_cells
from dsmap.tools.cli import run
from dsmap.tools.twins import segment_graph as reference_segments

UP = np.array([0.0, 0.0, 1.0])
CONFIG = SegmentConfig(cell=0.04)


def furnished_room() -> dict[str, np.ndarray]:
    """The room of `synthetic_map`: floor, walls, a table top; with a box on the table and a chair's seat and back."""
    room = room_arrays()
    parts = [
        slab([2.0, 1.5, 0.85], [0.3, 0.2, 0.2], "objects"),
        slab([3.2, 1.5, 0.45], [0.4, 0.4, 0.02], "chair"),
        slab([3.4, 1.5, 0.75], [0.02, 0.4, 0.3], "chair"),
    ]
    arrays = {name: np.concatenate([room[name], *(part[name] for part in parts)]) for name in room}
    arrays["observations"] = np.full(len(arrays["weight"]), 3.0, np.float32)
    return arrays


def slab(centre, size, name: str, spacing: float = 0.02) -> dict[str, np.ndarray]:
    """Surfels on the six sides of a box."""
    points, normals = [], []
    for axis in range(3):
        a, b = [i for i in range(3) if i != axis]
        u, v = np.meshgrid(*(np.arange(-size[i] / 2, size[i] / 2 + 1e-6, spacing) for i in (a, b)))
        for side in (-1, 1):
            p, n = np.zeros((u.size, 3)), np.zeros((u.size, 3))
            p[:, a], p[:, b], p[:, axis], n[:, axis] = u.ravel(), v.ravel(), side * size[axis] / 2, side
            points.append(p + centre)
            normals.append(n)
    count = sum(map(len, points))
    return {
        "position": np.concatenate(points).astype(np.float32),
        "normal": np.concatenate(normals).astype(np.float32),
        "colour": np.full((count, 3), 0.5, np.float32),
        "weight": np.full(count, 20, np.float32),
        "radius": np.full(count, spacing, np.float32),
        "t_created": np.full(count, 7, np.int32),
        "t_updated": np.full(count, 42, np.int32),
        "label": np.full(count, CLASS_NAMES.index(name), np.uint8),
        "segment": np.zeros(count, np.int32),
    }


def sure(label: np.ndarray, p: float = 0.9) -> np.ndarray:
    """Probabilities (N, 13) that give each label `p`."""
    return (np.full((len(label), 13), (1 - p) / 12) + (p - (1 - p) / 12) * np.eye(13)[label - 1]).astype(
        np.float32
    )


@pytest.fixture(scope="module")
def scene() -> SceneObjects:
    arrays = furnished_room()
    return find_objects(arrays, sure(arrays["label"]), UP, CONFIG)


def test_things_have_class_box_and_frames(scene):
    things = {CLASS_NAMES[thing.label]: thing for thing in scene.things}
    assert sorted(things) == ["chair", "objects", "table"] and len(scene.things) == 3
    box = things["objects"].box
    np.testing.assert_allclose(box.T_world_box[:3, 3], [2.0, 1.5, 0.85], atol=0.03)
    np.testing.assert_allclose(box.extent, [0.3, 0.2, 0.2], atol=0.06)
    assert things["chair"].box.extent[2] > 0.4, "seat and back are one chair"
    assert (things["objects"].first_seen, things["objects"].last_seen) == (7, 42)
    assert things["objects"].score > 0.8 and things["objects"].observations == 3.0


def test_structure_is_planes(scene):
    names = [CLASS_NAMES[plane.label] for plane in scene.planes]
    assert sorted(names) == ["ceiling", "floor", "wall", "wall", "wall", "wall"]
    floor = scene.planes[names.index("floor")]
    np.testing.assert_allclose(floor.normal, UP, atol=1e-6)
    assert abs(floor.offset) < 0.01 and sorted(np.round(floor.extent)) == [3, 4]
    for plane in scene.planes:
        assert np.abs(plane.corners @ plane.normal - plane.offset).max() < 1e-6


def test_relations_say_what_stands_on_what(scene):
    name = {one.id: CLASS_NAMES[one.label] for one in (*scene.things, *scene.planes)}
    said = {(name[r.subject], r.kind, name[r.object]) for r in find_relations(scene)}
    assert ("table", "supports", "objects") in said and ("objects", "on", "table") in said
    assert ("floor", "supports", "objects") not in said


def test_files_hold_plain_numbers(scene, tmp_path):
    write_objects(tmp_path, scene)
    objects = json.loads((tmp_path / "objects.json").read_text())
    graph = json.loads((tmp_path / "scene_graph.json").read_text())
    assert len(objects["objects"]) == 3 and len(objects["structure"]) == 6
    assert {edge["relation"] for edge in graph["edges"]} >= {"supports", "on"}
    assert len(graph["rooms"]) == 1 and 9 < graph["rooms"][0]["area"] < 14
    assert len(graph["rooms"][0]["members"]) == 9


def test_a_segment_is_no_more_than_one_side_of_a_crease(scene):
    arrays = furnished_room()
    segment = segment_map(arrays, CONFIG)
    floor = segment[arrays["label"] == CLASS_NAMES.index("floor")]
    thing = segment[arrays["label"] == CLASS_NAMES.index("objects")]
    assert np.bincount(floor).max() > 0.9 * len(floor), "the floor is one segment"
    assert not set(floor) & set(thing) and (segment > 0).all()


def test_joining_equals_its_twin():
    rng = np.random.default_rng(3)
    edges = rng.integers(0, 60, (80, 2))
    cost = rng.random(80).astype(np.float32)
    found = join_cells(edges, cost, np.ones(60), scale=0.4, small=3, small_cost=0.5)
    expected = reference_segments.join_cells(edges, cost, 60, scale=0.4, small=3, small_cost=0.5)
    np.testing.assert_array_equal(found, expected)
    assert 1 < found.max() < 59


@pytest.mark.parametrize("rule", ["bayes", "geometric", "mean"])
def test_pooling_corrects_speckles_and_stays_a_distribution(rule):
    arrays = furnished_room()
    rng = np.random.default_rng(0)
    shown = np.where(rng.random(len(arrays["label"])) < 0.2, 7, arrays["label"])
    p = sure(shown, 0.6)
    p[5] = np.nan
    observations = arrays["observations"].copy()
    observations[11] = 0  # never labelled, but its segment is
    pooled, there = pool_probabilities(p, observations, segment_map(arrays, CONFIG), CONFIG)
    assert there.all() and (shown == arrays["label"]).mean() < 0.85
    np.testing.assert_allclose(pooled.sum(axis=1), 1, atol=1e-5)
    assert (pooled.argmax(axis=1) + 1 == arrays["label"]).mean() > 0.98
    surfels = map_of(arrays | {"observations": observations})
    set_probabilities(surfels, pooled, there, rule)
    np.testing.assert_allclose(posterior(surfels, rule), pooled, atol=1e-4)


@pytest.mark.parametrize("what", ["empty", "one surfel", "no labels", "NaN", "dead", "one class"])
def test_maps_with_nothing_to_find(what):
    arrays = furnished_room()
    count = {"empty": 0, "one surfel": 1}.get(what, len(arrays["weight"]))
    arrays = {name: values[:count] for name, values in arrays.items()}
    p = sure(arrays["label"])
    if what == "no labels":
        arrays["observations"] = np.zeros(count, np.float32)
    elif what == "NaN":
        p[:] = np.nan
        arrays["position"][::7] = np.nan
    elif what == "dead":
        arrays["weight"] = np.zeros(count, np.float32)
    elif what == "one class":
        p[:] = np.eye(13)[CLASS_NAMES.index("bed") - 1]
    scene = find_objects(arrays, p, UP, CONFIG)
    tree, graph = objects_tree(scene), graph_tree(scene)
    assert len(scene.segment) == count
    assert {CLASS_NAMES[thing.label] for thing in scene.things} <= ({"bed"} if what == "one class" else set())
    if what != "one class":
        assert tree["objects"] == tree["structure"] == graph["edges"] == graph["rooms"] == []
    json.dumps([tree, graph], allow_nan=False)


def test_boxes_overlap_as_their_volumes_do():
    T = np.eye(4)
    box = Box(T, np.array([2.0, 1.0, 1.0]))
    moved = np.eye(4)
    moved[0, 3] = 1.0
    assert box_overlap(box, box) == pytest.approx(1.0, abs=1e-3)
    assert box_overlap(box, Box(moved, box.extent)) == pytest.approx(1 / 3, abs=1e-3)
    moved[2, 3] = 2.0
    assert box_overlap(box, Box(moved, box.extent)) == 0.0
    corners = box.corners()
    assert sorted(np.linalg.norm(corners[a] - corners[b]) for a, b in EDGES) == [1.0] * 8 + [2.0] * 4


def test_a_box_turns_with_its_points():
    rng = np.random.default_rng(1)
    turn = np.array([[np.cos(0.5), -np.sin(0.5), 0], [np.sin(0.5), np.cos(0.5), 0], [0, 0, 1]])
    points = (rng.random((4000, 3)) - 0.5) * [2.0, 1.0, 0.4] @ turn.T + [3, 1, 1]
    box = fit_box(points, UP)
    np.testing.assert_allclose(box.extent, [2.0, 1.0, 0.4], rtol=0.08)
    assert abs(box.T_world_box[:3, 0] @ turn[:, 0]) > 0.99


@pytest.mark.parametrize("method", ["segments", "crf"])
def test_a_refined_run_is_a_run(method, tmp_path):
    mapper = Mapper(corner_frames.config(poses="given"), corner_frames.INTRINSICS, GroundTruthSegmenter(0.2))
    for frame in corner_frames.frames(4):
        mapper.step(frame)
    (tmp_path / "run").mkdir()
    save_run(mapper, tmp_path / "run", objects=False)
    argv = [str(tmp_path / "run"), "--out", str(tmp_path / "out"), "--method", method]
    assert run("refine", argv) == 0
    before, after = load_run(tmp_path / "run"), load_run(tmp_path / "out")
    assert (after.surfels.numpy()["segment"] > 0).any() and not before.surfels.numpy()["segment"].any()
    np.testing.assert_array_equal(before.poses, after.poses)
    assert (before.surfels.numpy()["label"] != after.surfels.numpy()["label"]).any()
    assert json.loads((tmp_path / "out" / "objects.json").read_text())["structure"]
    assert run("refine", argv) == 2, "the folder is not empty"
    assert run("refine", [*argv[:2], argv[0]]) == 2, "the run itself"


def test_map_refines_at_its_end(tmp_path):
    path = corner_frames.record(tmp_path / "recording")
    argv = [str(path), "--segmenter", "labels", "--label-noise", "0.2", "--poses", "given", "--no-pictures"]
    for refine in ("none", "crf"):
        assert run("map", [*argv, "--out", str(tmp_path / refine), "--refine", refine]) == 0
    before, after = (load_run(tmp_path / refine).surfels.numpy() for refine in ("none", "crf"))
    np.testing.assert_array_equal(before["position"], after["position"])
    assert (before["label"] != after["label"]).any()
    measured = load_run(tmp_path / "crf", measured=True).surfels.numpy()
    for name in ("label", "evidence", "observations"):
        np.testing.assert_array_equal(before[name], measured[name])
    assert run("refine", [str(tmp_path / "crf"), "--out", str(tmp_path / "again"), "--method", "crf"]) == 0
    again = load_run(tmp_path / "again").surfels.numpy()
    np.testing.assert_array_equal(
        after["label"], again["label"], "from the measured labels, not refined twice"
    )
    assert json.loads((tmp_path / "crf" / "objects.json").read_text())["structure"]


def test_every_thing_is_a_node(tmp_path):
    """All of the surface is in the file, each piece under the name that objects.json gives it."""
    trimesh = pytest.importorskip("trimesh")
    path = corner_frames.record(tmp_path / "recording")
    argv = [
        str(path),
        "--segmenter",
        "labels",
        "--poses",
        "given",
        "--no-pictures",
        "--out",
        str(tmp_path / "run"),
    ]
    assert run("map", argv) == 0
    common = [str(tmp_path / "run"), "--cell", "0.03", "--to"]
    assert run("export", [*common, "objects", "--out", str(tmp_path / "objects.glb")]) == 0
    assert run("export", [*common, "mesh", "--out", str(tmp_path / "mesh.glb")]) == 0
    scene = trimesh.load(tmp_path / "objects.glb", process=False)
    tree = json.loads((tmp_path / "run" / "objects.json").read_text())
    named = {one["name"]: one for one in (*tree["objects"], *tree["structure"])}
    parts = {name: scene.geometry[scene.graph[name][1]] for name in scene.graph.nodes_geometry}
    assert set(parts) - {"rest"} <= set(named) and len(set(parts) & set(named)) > 1
    for name in set(parts) & set(named):
        extras = parts[name].metadata
        assert extras["id"] == named[name]["id"] and extras["class"] == named[name]["class"]
    whole = trimesh.load(tmp_path / "mesh.glb", process=False, force="mesh")
    assert sum(len(part.faces) for part in parts.values()) == len(whole.faces)
    assert sum(part.area for part in parts.values()) == pytest.approx(whole.area, rel=1e-4)


def test_nothing_is_split_where_nothing_is():
    surfels = {name: values[:0] for name, values in furnished_room().items()}
    scene = find_objects(surfels, np.zeros((0, 13), np.float32), UP)
    assert scene.things == [] and scene.planes == []
