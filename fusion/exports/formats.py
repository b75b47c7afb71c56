"""What dsmap writes for other programs: every format with its file types, and the function that writes it."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.fusion.exports import mesh, points, surface, trajectory
from dsmap.fusion.exports.coco import export_coco
from dsmap.fusion.exports.colmap import export_colmap
from dsmap.fusion.exports.labels_2d import export_labels_2d
from dsmap.fusion.exports.level import level_transform
from dsmap.fusion.exports.nerfstudio import export_nerfstudio
from dsmap.fusion.exports.nyu40 import export_nyu40
from dsmap.fusion.exports.objects_glb import split_surface, write_objects_glb
from dsmap.fusion.exports.occupancy import CELL_M, occupancy_grid, write_occupancy
from dsmap.fusion.exports.octomap import OCTREE_VOXEL_M, octomap_voxels, write_octomap
from dsmap.fusion.exports.rerun_log import write_rerun
from dsmap.fusion.exports.run_frames import RunFrames
from dsmap.fusion.exports.splat import write_splat
from dsmap.fusion.runs.read_run import SavedRun
from dsmap.fusion.runs.refine import objects_of_run
from dsmap.sequences import Sequence


@dataclass
class ExportJob:
    """What is to be exported: a run, or a recording alone."""

    run: SavedRun | None
    recording: Callable[[], Sequence]
    """Opens the recording: with a run the one that was mapped."""
    type: str = ""
    """Kind of file, of a format that has several."""
    cell: float | None = None
    """Edge of a voxel or a cell [m]; None: the format's."""
    stride: int = 1
    """Every n-th frame; of a recording alone it is opened so."""
    min_confidence: float = 0.0
    """Surfels of a lower confidence are left out."""
    class_colours: bool = False
    """Meshes in the colours of their classes."""

    @property
    def mapped(self) -> SavedRun:
        """The run.

        Raises:
            InputError: there is none.
        """
        if self.run is None:
            raise InputError(
                "this format needs a map, expected a RUN folder of `dsmap map` (see `dsmap export`)"
            )
        return self.run

    @cached_property
    def surfels(self) -> dict[str, np.ndarray]:
        """The run's living surfels of enough confidence, arrays by the names of `SurfelMap`."""
        arrays = self.mapped.surfels.numpy()
        kept = (arrays["weight"] > 0) & (arrays["weight"] >= self.min_confidence)
        return {name: values[kept] for name, values in arrays.items()}

    @cached_property
    def frames(self) -> Sequence:
        """The recording, of a run with its poses and labels."""
        recording = self.recording()
        return recording if self.run is None else RunFrames(self.run, recording, self.stride)

    @property
    def poses(self) -> list[tuple[float, np.ndarray]]:
        """Stamp and T_world_camera of the frames that have a pose."""
        if self.run is not None:
            rows = zip(self.run.times.tolist(), self.run.colour_poses, self.run.tracked, strict=True)
            return [(t, T) for t, T, tracked in rows if tracked][:: self.stride]
        found = self.recording()
        return [(e.time, e.T_world_camera) for e in found.entries if e.T_world_camera is not None]


@dataclass(frozen=True)
class Format:
    """A form of output."""

    about: str
    write: Callable[[ExportJob, Path], str]
    """Writes it to a path and says in words how much there is."""
    types: tuple[str, ...] = ()
    """Kinds of file, the usual one first; none: a folder."""
    of_recordings: bool = False
    """Whether a recording without a run has what it takes."""
    suffix: str = ""
    """Of the file, where it is not the type."""


def _trajectory(job: ExportJob, out: Path) -> str:
    rows = job.poses
    if not rows:
        raise InputError(
            "found no pose to write, expected a recording with poses, or a run that tracked a frame"
        )
    trajectory.TRAJECTORY_WRITERS[job.type](out, rows)
    return f"{len(rows)} poses"


def _mesh(job: ExportJob, out: Path) -> str:
    found = surface.surface_of(job.surfels, job.cell or surface.MESH_VOXEL_M)
    shown = mesh.in_class_colours(found) if job.class_colours else found
    mesh.MESH_WRITERS[job.type](out, shown, level_transform(job.mapped))
    return f"{len(found.vertices):,} vertices, {len(found.faces):,} triangles"


def _objects(job: ExportJob, out: Path) -> str:
    run, T_level_world = job.mapped, level_transform(job.mapped)
    scene = objects_of_run(run)
    found = surface.surface_of(job.surfels, job.cell or surface.MESH_VOXEL_M)
    shown = mesh.in_class_colours(found) if job.class_colours else found
    count = write_objects_glb(out, split_surface(shown, run.surfels.numpy(), scene), scene, T_level_world)
    return f"{count} of {len(scene.things)} things, {len(scene.planes)} planes"


def _points(job: ExportJob, out: Path) -> str:
    return f"{points.POINT_WRITERS[job.type](out, job.surfels):,} points"


def _splat(job: ExportJob, out: Path) -> str:
    return f"{write_splat(out, job.surfels, job.mapped.config.stable_weight):,} Gaussians"


def _occupancy(job: ExportJob, out: Path) -> str:
    T_level_world = level_transform(job.mapped)
    grid = occupancy_grid(job.surfels, T_level_world, job.cell or CELL_M)
    free = write_occupancy(out, grid, T_level_world)
    height, width = grid.cells.shape
    return f"{width}x{height} cells, {free} of them free"


def _octomap(job: ExportJob, out: Path) -> str:
    voxels = octomap_voxels(job.mapped, level_transform(job.mapped), job.cell or OCTREE_VOXEL_M)
    write_octomap(out, voxels)
    return f"{len(voxels.occupied):,} occupied and {len(voxels.free):,} free voxels"


def _rerun(job: ExportJob, out: Path) -> str:
    up = level_transform(job.mapped)[2, :3]
    return f"{write_rerun(out, job.frames, job.surfels, up)} frames"


def _nerfstudio(job: ExportJob, out: Path) -> str:
    return f"{export_nerfstudio(job.frames, out, job.surfels if job.run else None)} images"


def _colmap(job: ExportJob, out: Path) -> str:
    return f"{export_colmap(job.frames, out, job.mapped.surfels.numpy() if job.run else None)} images"


def _images(write: Callable[[Sequence, Path], int]) -> Callable[[ExportJob, Path], str]:
    return lambda job, out: f"{write(job.frames, out)} of {len(job.frames)} frames"


FORMATS: dict[str, Format] = {
    "trajectory": Format("poses", _trajectory, ("tum", "kitti", "euroc"), True, suffix="txt"),
    "mesh": Format("a surface with colours and labels", _mesh, ("ply", "obj", "glb")),
    "objects": Format("every thing a node of one file", _objects, ("glb",)),
    "points": Format("surfels as points", _points, ("ply", "pcd", "las", "e57")),
    "occupancy": Format("a 2D grid for ROS's map_server", _occupancy, ("yaml",)),
    "octomap": Format("a 3D grid for OctoMap", _octomap, ("bt", "ot")),
    "nerfstudio": Format("poses, images, depth, points", _nerfstudio, of_recordings=True),
    "colmap": Format("COLMAP's text model with images", _colmap, of_recordings=True),
    "splat": Format("3D Gaussians to begin training with", _splat, ("ply",)),
    "labels-2d": Format("labels of every frame", _images(export_labels_2d), of_recordings=True),
    "coco": Format("COCO panoptic", _images(export_coco), of_recordings=True),
    "nyu40": Format("label images with NYU40 ids", _images(export_nyu40), of_recordings=True),
    "rerun": Format("a recording for rerun's viewer", _rerun, ("rrd",)),
}
"""Every format by its name."""


def write(name: str, job: ExportJob, out: Path) -> str:
    """Write a format to a file, or into a new folder; returns how much there is, in words.

    Raises:
        InputError: the job lacks what the format needs, there is something at the place already, or it cannot be
            written.
    """
    form = FORMATS[name]
    if form.types and job.type not in form.types:
        raise InputError(f"{name} of type {job.type!r}; expected one of: {', '.join(form.types)}")
    if not form.types and out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out}: found something there already, expected a new folder")
    was_there = out.exists()
    try:
        return form.write(job, out)
    except BaseException:  # half of it would stand in the way of the next try
        if not was_there and out.is_dir():
            shutil.rmtree(out, ignore_errors=True)
        raise
