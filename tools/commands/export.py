"""`dsmap export`: a run for other programs."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from dsmap.errors import InputError
from dsmap.fusion.exports.formats import FORMATS, ExportJob, Format, write
from dsmap.fusion.runs.read_run import load_run
from dsmap.ranges import Every, Range
from dsmap.tools.mapping.recording import recording_of

_OF_A_MESH = 0.4
"""Surfels of this share of the stable weight make a mesh: less is mostly noise, more leaves holes."""


@dataclass
class Args:
    run: tyro.conf.Positional[Path]
    """RUN folder that `dsmap map` wrote."""
    to: Literal[tuple(FORMATS)]  # type: ignore[valid-type]
    """What to write (docs/guide/exports.md)."""
    out: Path | None = None
    """File or new folder; default: RUN/exports/, by the format's name. Its ending says which type of file."""
    type: str | None = None
    """Type of file, of a format with several: mesh ply, obj, glb; points ply, pcd, las, e57; trajectory tum, kitti,
    euroc; octomap bt, ot. Default: by the ending of --out, else the first of these."""
    recording: Path | None = None
    """The recording that was mapped, if it is no longer where config.yaml says."""
    cell: Annotated[float, Range(0.001, 10)] | None = None
    """Edge of a voxel or a cell [m]: mesh and objects 0.01, occupancy and octomap 0.05."""
    stride: Every = 1
    """Every n-th tracked frame, where frames are written."""
    min_confidence: Annotated[float, Range(0, 1e6)] | None = None
    """Leave out surfels of a lower confidence; default: for mesh and objects 0.4 times that of a stable one
    (surfels.stable_weight), else none."""
    class_colours: bool = False
    """mesh, objects: the colours of the classes."""


def main(args: Args) -> None:
    """Export and say what was written."""
    form = FORMATS[args.to]
    kind = type_of(args, form)
    out = args.out or args.run / "exports" / default_name(args.to, form, kind)
    run = load_run(args.run)
    confidence = args.min_confidence
    if confidence is None:
        of_mesh = args.to in ("mesh", "objects")
        confidence = _OF_A_MESH * run.config.stable_weight if of_mesh else 0.0
    job = ExportJob(
        run, lambda: recording_of(run, args.recording, undistort=True), kind, args.cell, args.stride,
        confidence, args.class_colours,
    )  # fmt: skip
    print(f"{out}: {write(args.to, job, out)}")


def type_of(args: Args, form: Format) -> str:
    """The type of file that was asked for.

    Raises:
        InputError: the format has no such type.
    """
    if not form.types:
        if args.type is not None:
            raise InputError(f"--type is {args.type}, but --to {args.to} writes a folder of one kind")
        return ""
    ending = args.out.suffix[1:].lower() if args.out is not None else ""
    if args.type is not None:
        kind = args.type.lower()
    elif form.suffix or not ending:  # a trajectory's ending says nothing
        kind = form.types[0]
    else:
        kind = ending
    if kind not in form.types:
        where = f"--type is {args.type}" if args.type is not None else f"--out ends in .{ending}"
        raise InputError(f"{where}; expected one of: {', '.join(form.types)}")
    return kind


def default_name(name: str, form: Format, kind: str) -> str:
    """The name of the file or folder in RUN/exports."""
    if not form.types:
        return name
    return f"{name}_{kind}.{form.suffix}" if form.suffix else f"{name}.{kind}"
