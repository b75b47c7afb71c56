"""How a run of `dsmap map` starts: anew, where a checkpoint stopped, or in a saved map."""

import dataclasses
import math
from pathlib import Path
from typing import Any, TypeVar

from dsmap.config_file import fill
from dsmap.errors import InputError
from dsmap.files import as_read_back
from dsmap.fusion.config import MapConfig
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.runs.checkpoint import load_map, read_metadata, save_map
from dsmap.fusion.runs.map_recording import Run
from dsmap.fusion.runs.resume import mapper_in_saved_map, resumed_mapper
from dsmap.fusion.runs.run_folder import CHECKPOINT
from dsmap.fusion.segmenter import Segmenter
from dsmap.kernels.runtime import chosen_device
from dsmap.sequences import Sequence
from dsmap.tools.mapping.segmenters import SegmenterSpec, make_segmenter
from dsmap.tools.support.presets import load_preset, option

A = TypeVar("A")
_MAX_READOUT_S = 0.1
"""Nobody reads an image for longer than three frames."""
_OF_A_CALL = ("path", "out", "config", "overwrite", "resume", "localize_in", "extend", "checkpoint_every")
"""Options that say what to do, not how: a configuration file cannot set them."""
_MAY_CHANGE = (*_OF_A_CALL[:5], "checkpoint_every", "stop", "pictures", "save_probabilities", "device")
"""Options that may be others when a run goes on."""


def default_args(usual: A, argv: list[str]) -> A:
    """`usual` with the parameters of the run that `argv` resumes, or of the --config that it names."""
    out, name = option(argv, "--out"), option(argv, "--config")
    if "--resume" in argv and out is not None:
        path = checkpoint_of(Path(out))
        values = read_metadata(path)["run"].get("command")
        if values is None:
            raise InputError(f"{path}: not written by `dsmap map`; expected a RUN folder of it")
        return fill(usual, values, str(path))
    if name is None:
        return usual
    values = load_preset(name)
    for key in _OF_A_CALL:
        if key in values:
            raise InputError(
                f"--config {name}: {key!r} has no place in a configuration; expected it as a flag"
            )
    return dataclasses.replace(fill(usual, values, f"--config {name}"), config=name)  # type: ignore[type-var]


def start(args: Any, sequence: Sequence, spec: SegmenterSpec) -> Run:
    """The mapper of the command line at its first frame, or where the checkpoint to resume stopped.

    Raises:
        InputError: options or recording do not fit the checkpoint, or there is none.
    """
    config = map_config(args, sequence)
    _check(args)
    segmenter = make_segmenter(spec, torch_device(args.device))
    saved = checkpoint_of(args.localize_in) if args.localize_in is not None else None
    if saved is not None:
        theirs = _saved_config(saved)
        labels = dataclasses.replace(config.labels, rule=theirs.labels.rule)
        config = dataclasses.replace(config, ferns=theirs.ferns, labels=labels)
    device = chosen_device(config.device)
    if args.resume:
        return _resume(args, config, sequence, segmenter)
    if saved is not None:
        surfels, meta = load_map(saved, device)
        mapper = mapper_in_saved_map(
            surfels, meta, str(saved), sequence.intrinsics, segmenter, config, frozen=not args.extend
        )
    else:
        mapper = Mapper(config, sequence.intrinsics, segmenter)
    return Run(mapper, lambda now: _save(args, now))


def map_config(args: Any, sequence: Sequence) -> MapConfig:
    """The mapper's configuration from the command line."""
    labels, loop = args.labels, args.loop
    if args.segment_every is not None:
        every = 0 if args.segment_every == "keyframes" else _positive(args.segment_every)
        labels = dataclasses.replace(labels, every=every)
    if args.label_fusion is not None:
        labels = dataclasses.replace(labels, rule=args.label_fusion)
    if args.loops is not None:
        loop = dataclasses.replace(loop, mode=args.loops)
    depth_max = args.depth_max or sequence.depth_max or MapConfig.depth_max
    if not 0 <= args.depth_min < depth_max or not math.isfinite(depth_max):
        raise InputError(
            f"depth range is {args.depth_min}..{depth_max} m; expected 0 <= --depth-min < --depth-max"
        )
    readout_s = sequence.readout_s if args.readout_s is None else args.readout_s
    if not abs(readout_s) <= _MAX_READOUT_S:
        raise InputError(
            f"readout_s is {readout_s}; expected seconds from an image's first row to its last, e.g. 0.026"
        )
    device = "cuda:0" if args.device == "cuda" else args.device
    return MapConfig(
        device, args.depth_min, depth_max, args.poses, readout_s, args.camera_up,
        track=args.track, surfels=args.surfels, labels=labels,
        loops=loop, ferns=args.ferns, relocalise=args.relocalise, graph=args.graph,
        moving=args.moving,
    )  # fmt: skip


def segmenter_spec(args: Any) -> SegmenterSpec:
    """The segmenter of the command line."""
    return SegmenterSpec(
        args.segmenter,
        args.weights,
        args.label_noise,
        args.label_noise_kind,
        args.seed,
        args.engine,
        args.prior,
    )


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


def checkpoint_of(path: Path) -> Path:
    """The checkpoint of a RUN folder, or the file itself.

    Raises:
        InputError: a folder without one.
    """
    if path.is_dir():
        file = path / CHECKPOINT
        if not file.exists():
            raise InputError(
                f"{path}: no {CHECKPOINT} in it; expected a RUN folder that got as far as its first checkpoint"
            )
        return file
    if not path.exists():
        raise InputError(f"{path}: no such file or folder; expected a RUN folder of `dsmap map`")
    return path


def torch_device(device: str) -> str:
    """The network's device of `--device`."""
    if device != "auto":
        return device
    import warp as wp

    return "cuda" if wp.is_cuda_available() else "cpu"


def _check(args: Any) -> None:
    if args.checkpoint_every < 0:
        raise InputError(f"--checkpoint-every is {args.checkpoint_every}; expected a number of frames, or 0")
    if args.extend and args.localize_in is None:
        raise InputError("--extend without --localize-in; expected the map to extend: --localize-in RUN")
    if args.localize_in is not None and args.poses == "given":
        raise InputError(
            "--localize-in with --poses given; expected --poses track: poses are looked for in the map"
        )
    if args.localize_in is not None and (args.loops or args.loop.mode) == "off":
        raise InputError(
            "--localize-in with --loops off; expected keyframes, which find the camera in the map"
        )


def _save(args: Any, state: Run) -> None:
    plain = {key: str(v) if isinstance(v, Path) else v for key, v in dataclasses.asdict(args).items()}
    progress = {"done": state.done, "skipped": state.skipped, "wall_s": state.wall_s}
    save_map(state.mapper, args.out / CHECKPOINT, run={"command": plain, **progress})


def _resume(args: Any, config: MapConfig, sequence: Sequence, segmenter: Segmenter | None) -> Run:
    path = checkpoint_of(args.out)
    surfels, meta = load_map(path, chosen_device(config.device))
    command = fill(args, meta["run"].get("command", {}), str(path))
    for field in dataclasses.fields(args):
        ours, theirs = getattr(args, field.name), getattr(command, field.name)
        if field.name not in _MAY_CHANGE and ours != theirs:
            raise InputError(
                f"--{field.name.replace('_', '-')} is {ours}, but {args.out} was begun with {theirs}; expected the same"
            )
    camera = dataclasses.asdict(sequence.intrinsics)
    if meta["intrinsics"] != as_read_back(camera):
        raise InputError(
            f"{args.path}: another camera than that of {args.out}; expected the recording it was begun with"
        )
    mapper = resumed_mapper(surfels, meta, str(path), sequence.intrinsics, segmenter, config)
    state = Run(mapper, lambda now: _save(args, now))
    state.done = meta["run"]["done"]
    state.skipped = [(int(index), str(reason)) for index, reason in meta["run"]["skipped"]]
    state.wall_s = meta["run"]["wall_s"]
    stamps = meta["times"][mapper.first_frame :]
    if len(sequence) < len(stamps) or (sequence.times[: len(stamps)] != stamps).any():
        raise InputError(
            f"{args.path}: its stamps are not those of {args.out}; expected the recording it was begun with"
        )
    for left in args.out.glob(".*.tmp*"):  # what a killed process was writing
        left.unlink()
    return state


def _saved_config(path: Path) -> MapConfig:
    return fill(MapConfig(), read_metadata(path)["config"], str(path), strict=False)


def _positive(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        raise InputError(f"--segment-every is {text!r}; expected a positive number or `keyframes`")
    return int(text)
