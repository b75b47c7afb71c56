"""`dsmap cut`: a stretch of a recording as a new sequence."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from dsmap.ranges import Range, Scale
from dsmap.sequences import open_sequence
from dsmap.sequences.cut import cut_sequence
from dsmap.tools.support.parse import parse_intrinsics


@dataclass
class Args:
    source: tyro.conf.Positional[Path]
    """The recording: a folder, or a file as cameras leave it (docs/guide/recordings.md)."""
    destination: tyro.conf.Positional[Path]
    """New folder for the sequence (TUM layout; image files are copied as they are)."""
    start: Annotated[float, Range(0, 1e9)] = 0.0
    """Where to begin, after the first colour image [s]."""
    seconds: Annotated[float, Range(0, 1e9, above=True)] = 10.0
    """How much to copy [s]."""
    intrinsics: str | None = None
    """fx,fy,cx,cy of the recording's images [px]; before calibration.yaml and known defaults."""
    depth_scale: Scale | None = None
    """Stored depth units per metre, e.g. 1000 or 5000."""
    label_map: str | None = None
    """Which classes the recording's label images hold, if not the 13: nyu40, scannet, or a file of ids, names or
    colours (docs/guide/labels.md); the 13 are written."""
    outside: bool = False
    """Copy files outside the recording's folder as well, where its lists or links lead there."""


def main(args: Args) -> None:
    """Cut and say what was written."""
    sequence = open_sequence(
        args.source,
        intrinsics=parse_intrinsics(args.intrinsics),
        depth_scale=args.depth_scale,
        label_map=args.label_map,
    )
    result = cut_sequence(
        sequence, args.destination, start_s=args.start, seconds=args.seconds, outside=args.outside
    )
    written = ", ".join(f"{count} {name}" for name, count in result.counts.items() if count)
    print(f"{args.destination}: {written}, from stamp {result.begin:.6f}")
    print(f"calibration.yaml written from: {sequence.intrinsics_source}")
    if sequence.recording.labels_unused:
        print(f"note: {sequence.recording.labels_unused}")
