"""`dsmap convert`: a recording in the format of another tool."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from dsmap.errors import InputError
from dsmap.ranges import Every
from dsmap.sequences import open_sequence
from dsmap.sequences.exporters import EXPORTERS


@dataclass
class Args:
    """Options of `dsmap convert`."""

    source: tyro.conf.Positional[Path]
    """The recording: a rendered sequence, or any other that dsmap reads."""
    destination: tyro.conf.Positional[Path]
    """New folder."""
    to: Literal["nyu40", "coco", "nerfstudio"]
    """nyu40 = label images with NYU40 ids; coco = COCO panoptic; nerfstudio = transforms.json with images and depth."""
    label_map: str | None = None
    """Which classes the recording's label images hold, if not the 13: nyu40, scannet, or a file of ids, names or
    colours (docs/guide/labels.md)."""
    stride: Every = 1
    """Every n-th frame."""


def main(args: Args) -> None:
    """Convert and say what was written."""
    if args.destination.exists() and (not args.destination.is_dir() or any(args.destination.iterdir())):
        raise InputError(f"{args.destination}: found something there already, expected a new folder")
    sequence = open_sequence(args.source, stride=args.stride, label_map=args.label_map)
    count = EXPORTERS[args.to](sequence, args.destination)
    print(f"{args.destination}: {count} of {len(sequence)} frames as {args.to}")
