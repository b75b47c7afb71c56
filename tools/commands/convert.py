"""`dsmap convert`: a recording in the format of another tool."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from dsmap.fusion.exports.formats import FORMATS, ExportJob, write
from dsmap.ranges import Every
from dsmap.sequences import open_sequence


@dataclass
class Args:
    """Options of `dsmap convert`."""

    source: tyro.conf.Positional[Path]
    """The recording: a rendered sequence, or any other that dsmap reads."""
    destination: tyro.conf.Positional[Path]
    """New folder, or the file of a trajectory."""
    to: Literal["nyu40", "coco", "nerfstudio", "colmap", "labels-2d", "trajectory"]
    """nyu40 = label images with NYU40 ids; coco = COCO panoptic; nerfstudio = transforms.json with images and depth;
    colmap = COLMAP's text model with images; labels-2d = labelled frames in TUM's layout; trajectory = the poses."""
    type: Literal["tum", "kitti", "euroc"] = "tum"
    """Layout of a trajectory."""
    label_map: str | None = None
    """Which classes the recording's label images hold, if not the 13: nyu40, scannet, or a file of ids, names or
    colours (docs/guide/labels.md)."""
    stride: Every = 1
    """Every n-th frame."""
    undistort: bool = False
    """Remove lens distortion, where the calibration has one."""


def main(args: Args) -> None:
    """Convert and say what was written."""
    sequence = open_sequence(
        args.source, stride=args.stride, label_map=args.label_map, undistort=args.undistort
    )
    job = ExportJob(None, lambda: sequence, type=args.type if FORMATS[args.to].types else "")
    print(f"{args.destination}: {write(args.to, job, args.destination)} as {args.to}")
