"""`dsmap info`: what dsmap understands of a recording."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from dsmap.errors import InputError
from dsmap.lens import model_of
from dsmap.ranges import Scale
from dsmap.sequences import Sequence, open_sequence
from dsmap.sequences.associate import gaps
from dsmap.sequences.bodies import read_bodies
from dsmap.sequences.formats.protocol import Options
from dsmap.sequences.pose_conventions import fit_poses
from dsmap.tools.support.depth_check import depth_warnings, sample_depth
from dsmap.tools.support.mirror_check import mirror_warnings
from dsmap.tools.support.parse import parse_intrinsics


@dataclass
class Args:
    path: tyro.conf.Positional[Path]
    """The recording: a folder, or a file as cameras leave it (docs/guide/recordings.md)."""
    intrinsics: str | None = None
    """fx,fy,cx,cy of the recording's own images [px]; before calibration.yaml and known defaults."""
    depth_scale: Scale | None = None
    """Stored depth units per metre, e.g. 1000 or 5000."""
    label_map: str | None = None
    """Which classes the recording's label images hold, if not the 13: nyu40, scannet, or a file of ids, names or
    colours (docs/guide/labels.md)."""
    color_topic: str | None = None
    """Topic of the colour images of a bag; without it dsmap looks for one."""
    depth_topic: str | None = None
    """Topic of the depth images of a bag; without it dsmap looks for one."""


def main(args: Args) -> None:
    """Print what was understood, and warnings."""
    sequence = open_sequence(
        args.path, intrinsics=parse_intrinsics(args.intrinsics), depth_scale=args.depth_scale,
        label_map=args.label_map, options=Options(args.color_topic, args.depth_topic),
    )  # fmt: skip
    depth = sample_depth(sequence)
    moving, found = describe_moving(sequence)
    rows = [*describe_recording(sequence), *moving, *describe_depth(depth)]
    width = max(len(name) for name, _ in rows)
    for name, text in rows:
        print(f"{name:<{width}}  {text}")
    found += [*depth_warnings(depth), *mirror_warnings(sequence), *_pose_warnings(sequence)]
    for note in sequence.notes:
        print(f"note: {note}")
    for warning in found:
        print(f"warning: {warning}")


def describe_recording(sequence: Sequence) -> list[tuple[str, str]]:
    """Name and text of everything that is known without decoding frames."""
    k, recording, times = sequence.intrinsics, sequence.recording, sequence.times
    pairs = len(recording.entries)
    posed = sum(entry.T_world_camera is not None for entry in sequence.entries)
    with_instances = sum(entry.instance is not None for entry in sequence.entries)
    holes = gaps(times)
    longest = sorted(holes, key=lambda gap: -gap[1])[:3]
    named = ", ".join(f"{length:.2f} s after {t:.3f}" for t, length in longest)
    distortion = " ".join([model_of(k.distortion), *(f"{v:g}" for v in k.distortion or ())])
    return [
        ("layout", sequence.layout),
        ("image size", f"{k.width}x{k.height}"),
        ("intrinsics", f"fx {k.fx:g} fy {k.fy:g} cx {k.cx:g} cy {k.cy:g} (integer pixel centres)"),
        ("from", sequence.intrinsics_source),
        ("pixel centre", f"{sequence.calibration.pixel_center} in the source"),
        ("distortion", distortion),
        ("depth scale", f"{sequence.depth_scale:g} units per metre"),
        ("colour images", f"{recording.num_rgb} ({recording.num_rgb - pairs} without depth)"),
        ("depth images", f"{recording.num_depth} ({recording.num_depth - pairs} without colour)"),
        ("pairs", f"{pairs} over {times[-1] - times[0]:.2f} s"),
        ("gaps", f"{len(holes)} longer than 3 median intervals" + (f": {named}" if holes else "")),
        ("poses", f"{posed} frames" if posed else "none"),
        ("labels", f"{len(sequence.labelled())} frames" if sequence.has_labels else "none"),
        ("instances", f"{with_instances} frames" if with_instances else "none"),
    ]


def describe_moving(sequence: Sequence) -> tuple[list[tuple[str, str]], list[str]]:
    """What `bodies.txt` of a rendered recording says, and what is wrong with it; nothing where there is none."""
    try:
        bodies = read_bodies(sequence.path)
    except InputError as error:
        return [], [str(error)]
    named = [f"{name} (instance {i}, {len(times)} poses)" for name, (i, times, _) in bodies.items()]
    return [("moving things", ", ".join(named))] if named else [], []


def describe_depth(depth: np.ndarray | InputError) -> list[tuple[str, str]]:
    """Depth range of the sampled frames."""
    if isinstance(depth, InputError):
        return [("depth range", "unknown")]
    low, median, high = np.percentile(depth, (1, 50, 99))
    return [("depth range", f"{low:.2f} to {high:.2f} m (1st to 99th percentile), median {median:.2f} m")]


def _pose_warnings(sequence: Sequence) -> list[str]:
    """What is probably wrong with the poses."""
    fit = fit_poses(sequence) if sequence.has_poses else None
    return [fit.sentence(sequence.path)] if fit is not None and fit.is_other else []
