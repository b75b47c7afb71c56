"""`dsmap calibrate PATH`: the camera of a recording from the recording itself, without a target."""

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from dsmap.errors import InputError
from dsmap.fusion.calibration.calibrate import TooLittleSeen, calibrate
from dsmap.fusion.calibration.report import Line, Report
from dsmap.ranges import Range, Scale
from dsmap.sequences import open_sequence
from dsmap.sequences.calibration import CALIBRATION_FILE, write_calibration_file
from dsmap.sequences.formats.protocol import Options
from dsmap.tools.support.parse import parse_intrinsics


@dataclass
class Args:
    path: tyro.conf.Positional[Path]
    """The recording: a folder, or a file as cameras leave it (docs/guide/recordings.md)."""
    out: Path | None = None
    """File to write; default calibration.yaml in the recording's folder, where `dsmap map` finds it."""
    frames: Annotated[int, Range(15, 100_000)] = 270
    """How many frames are looked at, in windows spread over the recording."""
    scale_from_poses: bool = False
    """Take the depth scale from the recording's own poses. Only where these were not made from the same depth."""
    intrinsics: str | None = None
    """fx,fy,cx,cy of the recording's own images to begin with [px]; before calibration.yaml and known defaults."""
    depth_scale: Scale | None = None
    """Stored depth units per metre, e.g. 1000 or 5000."""
    color_topic: str | None = None
    """Topic of the colour images of a bag; without it dsmap looks for one."""
    depth_topic: str | None = None
    """Topic of the depth images of a bag; without it dsmap looks for one."""
    overwrite: bool = False
    """Replace a calibration.yaml that is there."""


def main(args: Args) -> int:
    """Calibrate, print and write; returns the exit code: 1 where the recording shows too little."""
    sequence = open_sequence(
        args.path, intrinsics=parse_intrinsics(args.intrinsics), depth_scale=args.depth_scale,
        options=Options(args.color_topic, args.depth_topic),
    )  # fmt: skip
    target = args.out or (args.path if args.path.is_dir() else args.path.parent) / CALIBRATION_FILE
    if os.path.lexists(target) and not args.overwrite:
        raise InputError(f"{target}: found a file there already, expected a new one; --overwrite replaces it")
    try:
        result = calibrate(sequence, args.frames, args.scale_from_poses, _say)
    except TooLittleSeen as error:
        print(f"dsmap calibrate: {error}", file=sys.stderr)
        return 1
    print("\n".join(describe(result)))
    write_calibration_file(target, result.calibration)
    print(f"written to {target}")
    return 0


def describe(result: Report) -> list[str]:
    """The report as lines of text."""
    rows = [("", "given", "found", "std. dev.", "")]
    rows += [(line.name, f"{line.given:.5g}", *_found(line), line.unit) for line in result.lines]
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = [
        f"{row[0]:<{widths[0]}}  " + "  ".join(f"{row[k]:>{widths[k]}}" for k in (1, 2, 3)) + f"  {row[4]}"
        for row in rows
    ]
    for line in result.lines:
        if line.verdict == "undetermined":
            lines.append(f"undetermined: {line.name} stays as given; {line.advice}")
    return [line.rstrip() for line in lines] + [f"warning: {warning}" for warning in result.warnings]


def _found(line: Line) -> tuple[str, str]:
    if line.verdict == "undetermined":
        return "-", "-" if line.sigma == float("inf") else f"{line.sigma:.2g}"
    return f"{line.found:.5g}", f"{line.sigma:.2g}"


def _say(what: str) -> None:
    print(what, file=sys.stderr)
