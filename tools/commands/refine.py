"""`dsmap refine`: labels that agree with the shape of the map, and the things that it shows."""

import dataclasses
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from dsmap.errors import InputError
from dsmap.fusion.config import SegmentConfig
from dsmap.fusion.runs.read_run import load_run
from dsmap.fusion.runs.refine import by_segments, refine_run
from dsmap.tools.mapping.start import check_new, claimed


@dataclass
class Args:
    run: tyro.conf.Positional[Path]
    """RUN folder that `dsmap map` wrote; it stays as it is."""
    out: Path
    """RUN folder to write."""
    method: Literal["segments"] = "segments"
    """segments: the surfels of a geometric segment share their class probabilities (Nakajima et al. 2018)."""
    overwrite: bool = False
    """Replace the files of an existing RUN."""
    segments: Annotated[SegmentConfig, tyro.conf.arg(help="geometric segments")] = field(
        default_factory=SegmentConfig
    )


def main(args: Args) -> int:
    """Refine a run; returns the exit code."""
    run = load_run(args.run)
    if args.out.resolve() == args.run.resolve():
        raise InputError(f"--out {args.out} is the run itself; expected another folder")
    check_new(args.out, args.overwrite)
    began = time.perf_counter()
    settings = {"method": args.method, "of": str(args.run), **dataclasses.asdict(args.segments)}
    with claimed(args.out):
        scene = refine_run(run, args.out, by_segments(args.segments), settings)
    segments = int(scene.segment.max(initial=0))
    print(
        f"{run.surfels.count:,} surfels, {segments:,} segments, {len(scene.things)} things, "
        f"{len(scene.planes)} planes in {time.perf_counter() - began:.1f} s"
    )
    print(f"written to {args.out}: map.ply labels.ply objects.json scene_graph.json checkpoint.safetensors")
    return 0
