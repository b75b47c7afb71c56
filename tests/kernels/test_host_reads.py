"""Where a step of the mapper makes the host wait for a GPU: every place is stated here, so none is added unseen."""

import ast
from collections import Counter
from pathlib import Path

import dsmap.fusion
import dsmap.kernels

_ELSEWHERE = {"evaluate", "pictures", "runs", "exports", "objects"}
"""Folders of fusion that no step enters."""
_READS = ("numpy", "item", "synchronize", "synchronize_device", "synchronize_stream")

EVERY_FRAME = {
    "fusion/stage_clock.py StageClock.stage": 1,  # a stage: what it measures is what has run
    "fusion/locator.py Locator._find": 1,  # too little depth?
    "fusion/tracking/exposure.py exposure_gain": 4,
    "fusion/tracking/tracker.py Tracker.colours": 3,
    "fusion/tracking/tracker.py Tracker.remember": 1,
    "fusion/tracking/tracker.py _middle_depth": 1,
    "fusion/tracking/observability.py normal_noise": 1,
    "fusion/tracking/moving_things.py MovingThings._depth": 1,
    "fusion/tracking/moving_things.py MovingThings._things": 2,
    "kernels/registration.py register_on_device": 1,  # a registration: the pose, after all its iterations
    "kernels/odometry.py rotation_normal_equations.at": 1,  # an iteration
    "kernels/culling.py Blocks.visible": 3,  # which blocks are walked is decided on the host
    "kernels/culling.py Blocks.to_clean": 2,
    "kernels/culling.py Blocks.dead": 1,
    "kernels/compact.py _move": 3,
    "kernels/fuse.py _ranks": 2,  # how many surfels are new
    "kernels/prune.py prune": 1,  # how many died
}
"""Within the step of a frame that is tracked."""
SOMETIMES = {
    "fusion/labels/gravity.py MapGravity.of_frame": 2,
    "fusion/labels/gravity.py _sample": 1,
    "fusion/tracking/rolling_shutter.py corrected_frame": 2,  # what the network is shown
    "fusion/tracking/agreement.py agreement": 3,  # of a pose in doubt
    "fusion/tracking/moving_things.py mask_depth": 1,
    "fusion/tracking/moving_things.py with_edges": 1,
    "kernels/moving.py carried_over": 1,
    "kernels/reactivate.py reactivate": 1,
    "kernels/odometry.py joint_normal_equations.at": 1,  # where starts are compared, or nothing holds the camera
    "fusion/loops/constraints.py constraints": 6,
    "fusion/loops/deformation_graph.py DeformationGraph.build": 1,
    "fusion/loops/gates.py view_overlap": 3,
    "fusion/loops/loop_closure.py LoopCloser._bent_graph": 1,
    "fusion/loops/loop_closure.py LoopCloser._try": 1,
    "fusion/places/recovery.py Recovery._coarse": 2,
    "fusion/places/recovery.py Recovery.find": 2,
    "fusion/places/recovery.py Recovery.remember_view": 2,
    "fusion/places/relocalise.py Relocaliser._imagined": 2,
    "fusion/places/rotation_search.py search_rotation": 2,
}
"""On keyframes, loops, recovery, or where something moves."""
NEVER = {
    "fusion/mapper.py Mapper.objects": 1,
    "fusion/surfels/model.py SurfelModel.state": 1,
    "fusion/tracking/tracker.py Tracker.state": 1,
    "kernels/compact.py compact": 1,
    "kernels/dense_crf.py find_neighbours": 1,
    "kernels/dense_crf.py mean_field": 2,
    "kernels/label.py posterior": 2,
    "kernels/mesh_distance.py closest_on_mesh": 3,
    "kernels/segment_graph.py join_cells": 1,
    "kernels/surface.py paint_points": 1,
    "kernels/surface.py surface_distance": 1,
    "kernels/types.py SurfelMap.numpy": 1,
    "kernels/preprocess.py half_image": 1,  # of its body for the CPU
    "kernels/preprocess.py intensity_map": 1,  # likewise
}
"""Not within a step on a GPU."""


def reads_of(source: str, name: str) -> Counter:
    """Calls that wait for a device, by the function they are in."""
    found: Counter = Counter()

    def walk(node: ast.AST, inside: list[str]) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef | ast.ClassDef):
                walk(child, [*inside, child.name])
                continue
            if (
                isinstance(child, ast.Call)
                and isinstance(child.func, ast.Attribute)
                and child.func.attr in _READS
            ):
                found[f"{name} {'.'.join(inside)}"] += 1
            walk(child, inside)

    walk(ast.parse(source), [])
    return found


def test_every_read_by_the_host_is_stated():
    found: Counter = Counter()
    for package in (dsmap.kernels, dsmap.fusion):
        folder = Path(package.__path__[0])
        for path in sorted(folder.rglob("*.py")):
            inner = path.relative_to(folder)
            if inner.parts[0] not in _ELSEWHERE:
                found += reads_of(path.read_text(), f"{folder.name}/{inner.as_posix()}")
    assert dict(found) == EVERY_FRAME | SOMETIMES | NEVER


def test_a_read_is_found_wherever_it_is():
    lines = [
        "class A:",
        " def f(self):",
        "  x = [a.numpy() for a in b]",
        "  wp.synchronize_device(x[0].item())",
    ]
    source = "\n".join(lines)
    assert reads_of(source, "m.py") == {"m.py A.f": 3}
