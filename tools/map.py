"""`dsmap map`: a recording goes in, a RUN folder comes out."""

import dataclasses
import math
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from tqdm import tqdm

from dsmap.errors import InputError
from dsmap.fusion.config import LabelConfig, MapConfig, SurfelConfig, TrackConfig
from dsmap.fusion.mapper import Mapper, StepResult
from dsmap.fusion.run_folder import config_values, save_run, statistics, write_json, write_yaml
from dsmap.sequences import Sequence, open_sequence
from dsmap.tools.parse import parse_intrinsics, parse_size
from dsmap.tools.segmenters import SegmenterSpec, make_segmenter

STRIP_FRAMES = 4
"""Frames shown in the strip picture, spread over the sequence."""
LOG_EVERY = 20
"""Without a terminal: frames between two lines of progress."""
INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells expect; everything so far is written."""


@dataclass
class Args:
    path: tyro.conf.Positional[Path]
    """The recording: a folder in TUM RGB-D, 7-Scenes or Redwood/Open3D layout."""
    out: Path
    """RUN folder to write."""
    overwrite: bool = False
    """Replace the files of an existing RUN."""
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
    """Ignore farther depth [m]; default: the calibration's depth_max, else 3, the good range of Kinect-like sensors."""
    intrinsics: str | None = None
    """fx,fy,cx,cy of the recording's own images [px]; before calibration.yaml and known defaults."""
    depth_scale: float | None = None
    """Stored depth units per metre, e.g. 1000 or 5000."""
    undistort: bool = False
    """Remove lens distortion, where the calibration has one."""
    poses: Literal["track", "given"] = "track"
    """Estimate the motion, or take the recording's poses."""
    segmenter: str = "dsnet"
    """dsnet, labels (the recording's own), none, or module:factory returning a segmenter."""
    weights: str | None = None
    """Weights of the network; default: those that come with dsmap."""
    label_noise: float = 0.0
    """Corrupt this share of `labels` (a test of label fusion)."""
    label_noise_kind: Literal["pixels", "blobs", "confusion"] = "pixels"
    """How labels are corrupted."""
    label_fusion: Literal["bayes", "mean", "geometric"] = "bayes"
    """How a surfel's labels of many views are combined."""
    segment_every: str = "1"
    """Segment every n-th frame, or `keyframes`."""
    save_probabilities: bool = False
    """Add the 13 class probabilities to map.ply."""
    pictures: bool = True
    """Draw the pictures."""
    seed: int = 0
    """Seed of label corruption."""
    track: Annotated[TrackConfig, tyro.conf.arg(help="tracking parameters")] = field(
        default_factory=TrackConfig
    )
    surfels: Annotated[SurfelConfig, tyro.conf.arg(help="surfel parameters")] = field(
        default_factory=SurfelConfig
    )


def main(args: Args) -> int:
    """Map a recording; returns the exit code."""
    sequence = open_sequence(
        args.path, intrinsics=parse_intrinsics(args.intrinsics), depth_scale=args.depth_scale,
        size=parse_size(args.size), start=args.start, stop=args.stop, stride=args.stride, undistort=args.undistort,
    )  # fmt: skip
    config, spec = map_config(args, sequence), segmenter_spec(args)
    if args.poses == "given" and not sequence.has_poses:
        raise InputError(
            f"{args.path}: --poses given, but the recording has no poses; expected a ground truth file"
        )
    if spec.kind == "labels" and not sequence.has_labels:
        raise InputError(
            f"{args.path}: --segmenter labels, but the recording has no labels; expected label.txt"
        )
    mapper = Mapper(config, sequence.intrinsics, make_segmenter(spec, _torch_device(args.device)))
    claim_folder(args.out, args.overwrite)
    print(
        f"{sequence.layout} recording, {len(sequence)} frames, intrinsics from {sequence.intrinsics_source}"
    )
    for note in sequence.notes:
        print(f"note: {note}")
    start = time.perf_counter()
    shown, interrupted = run(mapper, sequence)
    write_run(args, mapper, sequence, spec, time.perf_counter() - start)
    if args.pictures:
        draw(args.out, mapper, sequence, shown)
    report(mapper, sequence, args.out)
    return INTERRUPTED if interrupted else 0


def map_config(args: Args, sequence: Sequence) -> MapConfig:
    """The mapper's configuration from the command line."""
    every = 0 if args.segment_every == "keyframes" else _positive(args.segment_every)
    depth_max = args.depth_max or sequence.depth_max or 3.0
    if not 0 <= args.depth_min < depth_max or not math.isfinite(depth_max):
        raise InputError(
            f"depth range is {args.depth_min}..{depth_max} m; expected 0 <= --depth-min < --depth-max"
        )
    device = {"cuda": "cuda:0"}.get(args.device, args.device)
    labels = LabelConfig(rule=args.label_fusion, every=every)
    return MapConfig(device, args.depth_min, depth_max, args.poses, args.track, args.surfels, labels)


def segmenter_spec(args: Args) -> SegmenterSpec:
    """The segmenter of the command line."""
    return SegmenterSpec(args.segmenter, args.weights, args.label_noise, args.label_noise_kind, args.seed)


def claim_folder(out: Path, overwrite: bool) -> None:
    """Make sure that the RUN folder is ours to write, before an hour is spent on it."""
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} is a file; expected a folder to write, or a new name")
    if out.is_dir() and any(out.iterdir()) and not overwrite:
        raise InputError(f"{out} exists and is not empty; expected a new folder, or --overwrite")
    try:
        out.mkdir(parents=True, exist_ok=True)
        (out / ".probe").touch()
        (out / ".probe").unlink()
    except OSError as error:
        raise InputError(f"{out} cannot be written ({error.strerror}); expected a writable folder") from error


def run(mapper: Mapper, sequence: Sequence) -> tuple[list[tuple[int, StepResult]], bool]:
    """Map all frames with a progress bar; Ctrl-C stops early.

    Returns:
        (frame position, result) of the frames for the strip picture, and whether it was interrupted.
    """
    shown: list[tuple[int, StepResult]] = []
    times, position_of = sequence.times, {entry.index: i for i, entry in enumerate(sequence.entries)}
    positions = set(np.linspace(0, len(sequence) - 1, STRIP_FRAMES + 2).astype(int)[1:-1].tolist())
    bar = tqdm(total=len(sequence), unit="frame", disable=None)  # None: off where stderr is no terminal
    try:
        for frame in sequence:
            position = position_of[frame.index]
            while len(mapper.trajectory) < position:
                mapper.skip(times[len(mapper.trajectory)])  # a damaged frame: counted, with the last pose
            result = mapper.step(frame)
            if position in positions:
                shown.append((position, result))
            state = "ok" if result.tracked else f"LOST: {result.reason}"
            bar.set_postfix_str(f"{mapper.surfels.count:,} surfels, {state}", refresh=False)
            bar.update(position + 1 - bar.n)
            if bar.disable and (position + 1) % LOG_EVERY == 0:
                print(
                    f"frame {position + 1} of {len(sequence)}: {mapper.surfels.count:,} surfels, {state}",
                    file=sys.stderr,
                )
    except KeyboardInterrupt:
        print("\nstopped: writing what is there so far", file=sys.stderr)
        return shown, True
    finally:
        bar.close()
    return shown, False


def write_run(args: Args, mapper: Mapper, sequence: Sequence, spec: SegmenterSpec, wall_s: float) -> None:
    """Write everything but the pictures."""
    save_run(mapper, args.out, with_probabilities=args.save_probabilities)
    k = sequence.intrinsics
    values: dict[str, Any] = {
        "sequence": {
            "path": str(args.path), "start": args.start, "stop": args.stop, "stride": args.stride,
            "size": [k.width, k.height], "undistort": args.undistort, "depth_scale": sequence.depth_scale,
            "intrinsics": {"fx": k.fx, "fy": k.fy, "cx": k.cx, "cy": k.cy, "width": k.width, "height": k.height},
            "intrinsics_source": sequence.intrinsics_source,
        },
        "map": config_values(mapper),
        "segmenter": dataclasses.asdict(spec),
    }  # fmt: skip
    write_yaml(args.out / "config.yaml", values)
    write_json(args.out / "stats.json", statistics(mapper, len(sequence.skipped), wall_s))


def draw(out: Path, mapper: Mapper, sequence: Sequence, shown: list[tuple[int, StepResult]]) -> None:
    """Draw the pictures of a run."""
    from dsmap.fusion.pictures import StripFrame, write_pictures

    strip = []
    for position, result in shown:
        frame = sequence.frame(position)
        probabilities = mapper.segmenter(frame) if mapper.segmenter and result.tracked else None
        predicted = (
            None if probabilities is None else (probabilities[..., 1:].argmax(-1) + 1).astype(np.uint8)
        )
        strip.append(StripFrame(frame, result.T_world_camera, predicted))
    reference = [sequence.T_world_camera(i) for i in range(len(sequence))]
    write_pictures(out, mapper.surfels, mapper.trajectory, sequence.intrinsics, strip, reference)


def report(mapper: Mapper, sequence: Sequence, out: Path) -> None:
    """Say in a few lines what came out."""
    stats = statistics(mapper, len(sequence.skipped), 0.0)
    tracking, speed = stats["tracking"], stats["speed"]
    lost, skipped = tracking["lost_frames"], tracking["skipped_frames"]
    print(
        f"{tracking['tracked_frames']} of {len(mapper.trajectory)} frames tracked, {lost} lost, {skipped} skipped"
    )
    for index, reason in sequence.skipped[:5]:
        print(f"skipped frame {index}: {reason}")
    fps = f"{speed['fps']:.1f} frames/s" if speed["fps"] else "no frame mapped"
    print(f"{stats['map']['surfels']:,} surfels, {fps}, {speed['peak_rss_bytes'] / 2**20:.0f} MiB at most")
    print(f"written to {out}: map.ply labels.ply trajectory.txt stats.json checkpoint.safetensors pictures/")


def _positive(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        raise InputError(f"--segment-every is {text!r}; expected a positive number or `keyframes`")
    return int(text)


def _torch_device(device: str) -> str:
    if device != "auto":
        return device
    import warp as wp

    return "cuda" if wp.is_cuda_available() else "cpu"
