"""`dsmap map`: a recording goes in, a RUN folder comes out."""

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from dsmap.errors import InputError
from dsmap.fusion.config import (
    FernConfig,
    GraphConfig,
    LabelConfig,
    LoopConfig,
    MovingConfig,
    RelocaliseConfig,
    SurfelConfig,
    TrackConfig,
)
from dsmap.fusion.runs.map_recording import INTERRUPTED, Run, run
from dsmap.sequences import Sequence, open_sequence
from dsmap.sequences.formats.protocol import Options
from dsmap.sequences.pose_conventions import with_convention
from dsmap.tools.mapping.checks import check_recording, verdict, without_partner
from dsmap.tools.mapping.output import draw, remove_pictures, report, write_run
from dsmap.tools.mapping.start import claim_folder, default_args, segmenter_spec, start
from dsmap.tools.support.parse import parse_intrinsics, parse_size


@dataclass
class Args:
    path: tyro.conf.Positional[Path]
    """The recording: a folder, or a file as cameras leave it (docs/guide/recordings.md)."""
    out: Path
    """RUN folder to write."""
    config: str | None = None
    """Parameters of a data set: a YAML file, or a name: default, tum_fr1, ... (flags come before it)."""
    overwrite: bool = False
    """Replace the files of an existing RUN."""
    checkpoint_every: int = 0
    """Write the checkpoint after every n-th frame, so that a crash loses no more; 0: only at the end."""
    resume: bool = False
    """Go on with RUN where its checkpoint stopped, with its own parameters; the result is the same bit for bit."""
    localize_in: Path | None = None
    """Track in the saved map of this RUN (or checkpoint) without changing it; poses are in its world."""
    extend: bool = False
    """With --localize-in: go on mapping in it; the result is written to --out."""
    device: Literal["cpu", "cuda", "auto"] = "auto"
    """Where kernels and network run."""
    size: str | None = None
    """WxH: resize frames first, e.g. 320x240."""
    start: int = 0
    """First frame (after association)."""
    stop: int | None = None
    """Frame to stop before."""
    stride: int = 1
    """Take every n-th frame."""
    depth_min: float = 0.3
    """Ignore nearer depth [m]."""
    depth_max: float | None = None
    """Ignore farther depth [m]; default: the calibration's depth_max, else 4, what Kinect-like sensors are made for."""
    intrinsics: str | None = None
    """fx,fy,cx,cy of the recording's own images [px]; before calibration.yaml and known defaults."""
    depth_scale: float | None = None
    """Stored depth units per metre, e.g. 1000 or 5000."""
    color_topic: str | None = None
    """Topic of the colour images of a bag; without it dsmap looks for one."""
    depth_topic: str | None = None
    """Topic of the depth images of a bag; without it dsmap looks for one."""
    undistort: bool = False
    """Remove lens distortion, where the calibration has one."""
    readout_s: float | None = None
    """Rolling shutter: time from an image's first row to its last [s]; default: the calibration's, else 0."""
    camera_up: Literal["auto", "top", "right", "bottom", "left"] = "auto"
    """The side of the image that is up, roughly; auto: the top, or the bottom once the map shows that the camera
    hangs upside down. A phone held upright is filmed with right or left."""
    poses: Literal["track", "given"] = "track"
    """Estimate the motion, or take the recording's poses."""
    pose_convention: str | None = None
    """How the recording's poses are written, if not camera-to-world in metres with x right, y down, z forward:
    world-to-camera, opengl or ros (axes), wxyz, millimetres or centimetres; several joined by commas."""
    loops: Literal["on", "local", "global", "off"] | None = None
    """Close loops: all, only view against view, only by keyframes, none; default: loop.mode."""
    segmenter: str = "dsnet"
    """dsnet, labels (the recording's own), none, or module:factory returning a segmenter."""
    weights: str | None = None
    """Weights of the network: a file, or one that comes with dsmap: dsnet-p (default; colour and geometry) or dsnet
    (the paper's, small, colour alone)."""
    prior: float | None = None
    """Class prior of the network's answers: 0 as frequent as in its training data (most pixels right), 1 all classes
    alike (best average over classes); default: as the weights say."""
    engine: Literal["auto", "torch", "onnx"] = "auto"
    """What runs the network: torch, onnx (ONNX Runtime, CPU), or auto: the faster one that is installed."""
    label_map: str | None = None
    """Which classes the recording's label images hold, if not the 13: nyu40, scannet, or a file of ids, names or
    colours (docs/guide/labels.md)."""
    label_noise: float = 0.0
    """Corrupt this share of `labels` (a test of label fusion)."""
    label_noise_kind: Literal["pixels", "blobs", "confusion"] = "pixels"
    """How labels are corrupted."""
    label_fusion: Literal["bayes", "mean", "geometric"] | None = None
    """How a surfel's labels of many views are combined; default: geometric (labels.rule)."""
    segment_every: str | None = None
    """Segment every n-th frame, or `keyframes`; default: labels.every, which says keyframes."""
    save_probabilities: bool = False
    """Add the 13 class probabilities to map.ply."""
    pictures: bool = True
    """Draw the pictures."""
    seed: int = 0
    """Seed of label corruption."""
    track: Annotated[TrackConfig, tyro.conf.arg(help="tracking")] = field(default_factory=TrackConfig)
    surfels: Annotated[SurfelConfig, tyro.conf.arg(help="surfels")] = field(default_factory=SurfelConfig)
    labels: Annotated[LabelConfig, tyro.conf.arg(help="labels")] = field(default_factory=LabelConfig)
    loop: Annotated[LoopConfig, tyro.conf.arg(help="loop closure")] = field(default_factory=LoopConfig)
    ferns: Annotated[FernConfig, tyro.conf.arg(help="keyframes")] = field(default_factory=FernConfig)
    relocalise: Annotated[RelocaliseConfig, tyro.conf.arg(help="relocalisation")] = field(
        default_factory=RelocaliseConfig
    )
    moving: Annotated[MovingConfig, tyro.conf.arg(help="moving things")] = field(default_factory=MovingConfig)
    graph: Annotated[GraphConfig, tyro.conf.arg(help="deformation graph")] = field(
        default_factory=GraphConfig
    )


def defaults(argv: list[str]) -> Args:
    """What flags that are not given mean: the parameters of the run to resume, of --config, or the usual ones."""
    return default_args(Args(tyro.MISSING, tyro.MISSING), argv)


def main(args: Args) -> int:
    """Map a recording; returns the exit code."""
    began = time.perf_counter()
    sequence, spec = open_recording(args), segmenter_spec(args)
    state = start(args, sequence, spec)
    check_recording(args, sequence, state.mapper.config)
    if not args.resume:
        claim_folder(args.out, args.overwrite)
    announce(args, sequence, state)
    interrupted = run(state, sequence, args.checkpoint_every)
    state.wall_s += time.perf_counter() - began
    write_run(args, state, sequence, spec)
    if args.pictures:
        draw(args.out, state, sequence)
    else:
        remove_pictures(args.out)
    report(state, args.out)
    return INTERRUPTED if interrupted else verdict(state, sequence)


def open_recording(args: Args) -> Sequence:
    """The recording of the command line, checked against what was asked of it."""
    sequence = open_sequence(
        args.path, intrinsics=parse_intrinsics(args.intrinsics), depth_scale=args.depth_scale,
        size=parse_size(args.size), start=args.start, stop=args.stop, stride=args.stride, undistort=args.undistort,
        label_map=args.label_map, options=Options(args.color_topic, args.depth_topic),
    )  # fmt: skip
    if args.pose_convention is not None:
        sequence = with_convention(sequence, args.pose_convention)
    if args.poses == "given" and not sequence.has_poses:
        raise InputError(
            f"{args.path}: --poses given, but the recording has no poses; expected a ground truth file"
        )
    if args.segmenter == "labels" and not sequence.has_labels:
        why = sequence.recording.labels_unused or "the recording has no labels; expected label.txt"
        raise InputError(f"{args.path}: --segmenter labels, but {why}")
    return sequence


def announce(args: Args, sequence: Sequence, state: Run) -> None:
    """Say what is about to happen."""
    print(
        f"{sequence.layout} recording, {len(sequence)} frames, intrinsics from {sequence.intrinsics_source}"
    )
    for note in [*sequence.notes, without_partner(sequence)]:
        if note:
            print(f"note: {note}")
    if args.resume:
        print(f"going on at frame {state.done} of {len(sequence)} with the parameters of {args.out}")
    elif args.localize_in is not None:
        what = "extending" if args.extend else "tracking in"
        print(f"{what} the map of {args.localize_in}: {state.mapper.surfels.count:,} surfels")
