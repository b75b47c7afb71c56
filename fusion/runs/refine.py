"""A RUN whose labels agree with the shape of its map: another RUN folder with the same trajectory."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np

from dsmap.files import write_yaml
from dsmap.fusion.config import CrfConfig, SegmentConfig
from dsmap.fusion.exports.ply import read_ply, up_of_ply, write_ply
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.objects.crf import refine_by_crf
from dsmap.fusion.objects.files import write_objects
from dsmap.fusion.objects.pooling import pool_probabilities, set_probabilities
from dsmap.fusion.objects.segments import segment_map, set_segments
from dsmap.fusion.objects.things import SceneObjects, find_objects
from dsmap.fusion.runs.checkpoint import rewrite_map
from dsmap.fusion.runs.read_run import SavedRun
from dsmap.fusion.runs.run_folder import CHECKPOINT
from dsmap.gravity import estimate_up
from dsmap.kernels.types import SurfelMap

Refined = Callable[[SurfelMap, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""From a map and its class probabilities (N, 13) to better ones, and which surfels have any, bool (N,)."""
_SAME = ("trajectory.txt", "trajectory_status.txt", "loops.json", "classes.json", "stats.json")


def by_segments(config: SegmentConfig) -> Refined:
    """Refinement by geometric segments, which become the surfels' own (see `fusion.objects.pooling`)."""

    def refine(surfels: SurfelMap, probabilities: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        arrays = surfels.numpy()
        segment = segment_map(arrays, config, probabilities)
        set_segments(surfels, segment)
        return pool_probabilities(probabilities, arrays["observations"], segment, config)

    return refine


def by_crf(config: CrfConfig) -> Refined:
    """Refinement by SemanticFusion's CRF (see `fusion.objects.crf`)."""

    def refine(surfels: SurfelMap, probabilities: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return refine_by_crf(surfels.numpy(), probabilities, config, surfels.device)

    return refine


def refine_map(mapper: Mapper, refine: Refined) -> dict[str, np.ndarray]:
    """Refine the labels of a mapper's map where it is; returns the arrays of labels as they were, by name.

    Fusion cannot go on with refined labels as if they had been measured: give those to `checkpoint.save_map`.
    """
    labels, measured = mapper.config.labels, label_arrays(mapper.surfels)
    refined, there = refine(mapper.surfels, mapper.probabilities())
    set_probabilities(mapper.surfels, refined, there, labels.rule, labels.posterior_temperature)
    return measured


def label_arrays(surfels: SurfelMap) -> dict[str, np.ndarray]:
    """A copy of what labels are made of: `evidence` (N, 13), `observations` (N,) and `label` (N,)."""
    arrays = surfels.numpy()
    return {name: arrays[name].copy() for name in ("evidence", "observations", "label")}


def refine_run(run: SavedRun, out: Path, refine: Refined, settings: dict) -> SceneObjects:
    """Write `out`: the run with refined labels, segments, objects.json and scene_graph.json.

    Args:
        run: as read, with labels as measured; its surfels are changed.
        out: folder that is there, empty or to be overwritten.
        settings: what was asked for, for config.yaml.

    Returns:
        The things of the refined map.
    """
    labels, measured = run.config.labels, label_arrays(run.surfels)
    refined, there = refine(run.surfels, run.probabilities())
    set_probabilities(run.surfels, refined, there, labels.rule, labels.posterior_temperature)
    up = up_of_run(run)
    scene = find_objects(run.surfels.numpy(), refined, up)
    set_segments(run.surfels, scene.segment)
    for name in _SAME:
        if (run.path / name).is_file():
            shutil.copyfile(run.path / name, out / name)
    with_probabilities = "prob_bed" in (_names(run.path / "map.ply") or ())
    arrays = run.surfels.numpy()
    write_ply(out / "map.ply", arrays, probabilities=refined if with_probabilities else None, up=up)
    write_ply(out / "labels.ply", arrays, colour="label", up=up)
    write_objects(out, scene)
    write_yaml(out / "config.yaml", run.settings | {"refine": settings})
    rewrite_map(run.path / CHECKPOINT, out / CHECKPOINT, run.surfels, measured)
    return scene


def objects_of_run(run: SavedRun) -> SceneObjects:
    """The things and the structure of a run's map, as its objects.json has them."""
    return find_objects(run.surfels.numpy(), run.probabilities(), up_of_run(run))


def up_of_run(run: SavedRun) -> np.ndarray:
    """Which way is up in the world's frame, shape (3,): as map.ply says, else by normals and poses."""
    if (run.path / "map.ply").is_file() and (up := up_of_ply(run.path / "map.ply")) is not None:
        return up
    start = -run.poses[:, :3, 1].mean(axis=0) if len(run.poses) else (0.0, 0.0, 1.0)
    return estimate_up(run.surfels.numpy()["normal"], start).direction


def _names(path: Path) -> tuple[str, ...] | None:
    return read_ply(path).dtype.names if path.is_file() else None
