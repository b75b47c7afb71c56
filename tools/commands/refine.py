"""`dsmap refine`: labels that agree with the shape of the map, and the things that it shows."""

import dataclasses
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from dsmap.errors import InputError
from dsmap.fusion.config import CrfConfig, SegmentConfig
from dsmap.fusion.runs.read_run import load_run
from dsmap.fusion.runs.refine import by_crf, by_segments, refine_run
from dsmap.tools.mapping.start import check_new, claimed


@dataclass
class Args:
    run: tyro.conf.Positional[Path]
    """RUN folder that `dsmap map` wrote; it stays as it is."""
    out: Path
    """RUN folder to write."""
    method: Literal["segments", "crf"] = "segments"
    """segments: the surfels of a segment share their class probabilities (Nakajima et al. 2018); crf: a fully connected
    CRF over all surfels (SemanticFusion, McCormac et al. 2017)."""
    overwrite: bool = False
    """Replace the files of an existing RUN."""
    segments: Annotated[SegmentConfig, tyro.conf.arg(help="geometric segments")] = field(
        default_factory=SegmentConfig
    )
    crf: Annotated[CrfConfig, tyro.conf.arg(help="fully connected CRF")] = field(default_factory=CrfConfig)


def main(args: Args) -> int:
    """Refine a run; returns the exit code."""
    run = load_run(args.run, measured=True)
    if args.out.resolve() == args.run.resolve():
        raise InputError(f"--out {args.out} is the run itself; expected another folder")
    check_new(args.out, args.overwrite)
    began = time.perf_counter()
    config = args.segments if args.method == "segments" else args.crf
    refine = by_segments(args.segments) if args.method == "segments" else by_crf(args.crf)
    settings = {"method": args.method, "of": str(args.run), **dataclasses.asdict(config)}
    with claimed(args.out):
        scene = refine_run(run, args.out, refine, settings)
    segments = int(scene.segment.max(initial=0))
    print(
        f"{run.surfels.count:,} surfels, {segments:,} segments, {len(scene.things)} things, "
        f"{len(scene.planes)} planes in {time.perf_counter() - began:.1f} s"
    )
    print(f"written to {args.out}: map.ply labels.ply objects.json scene_graph.json checkpoint.safetensors")
    return 0
