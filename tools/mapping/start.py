"""How a run of `dsmap map` starts: anew, where a checkpoint stopped, or in a saved map."""

import contextlib
import dataclasses
import os
from collections.abc import Iterator
from pathlib import Path

from dsmap.config_file import fill
from dsmap.errors import InputError, WriteError
from dsmap.files import as_read_back
from dsmap.folders import locked, remove_leftovers
from dsmap.fusion.config import MapConfig
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.runs.checkpoint import load_map, read_metadata, save_map
from dsmap.fusion.runs.map_realtime import size_that_keeps_up
from dsmap.fusion.runs.map_recording import RunState
from dsmap.fusion.runs.resume import mapper_in_saved_map, resumed_mapper
from dsmap.fusion.runs.run_folder import CHECKPOINT
from dsmap.fusion.segmenter import Segmenter
from dsmap.kernels.runtime import chosen_device
from dsmap.reading import reading
from dsmap.sequences import Sequence
from dsmap.tools.mapping.options import OF_A_CALL, Args, options_of, plain_values, with_values
from dsmap.tools.mapping.presets import load_preset, option
from dsmap.tools.mapping.segmenters import make_segmenter, names_code

_MAY_CHANGE = (
    *("path", "out", "config", "write_config", "overwrite", "resume"),
    *("checkpoint_every", "view", "stop", "pictures", "objects", "refine", "save_probabilities", "device"),
)
"""Options that may be others when a run goes on."""


def default_args(usual: Args, argv: list[str]) -> Args:
    """`usual` with the parameters of the run that `argv` resumes, or of the --config that it names."""
    out, name = option(argv, "--out"), option(argv, "--config")
    if "--resume" in argv and out is not None:
        path = checkpoint_of(Path(out))
        values = read_metadata(path)["run"].get("command")
        if not isinstance(values, dict):
            raise InputError(f"{path}: not written by `dsmap map`; expected a RUN folder of it")
        return _without_code(with_values(usual, values, str(path)), str(path), argv)
    if name is None:
        return usual
    values = load_preset(name)
    for key in OF_A_CALL:
        if key in values:
            raise InputError(
                f"--config {name}: {key!r} has no place in a configuration; expected it as a flag"
            )
    where = f"--config {name}"
    return dataclasses.replace(_without_code(with_values(usual, values, where), where, argv), config=name)


def _without_code(args: Args, where: str, argv: list[str]) -> Args:
    """The options of a file, which must not be able to say what is run here, whoever wrote it."""
    kind = args.spec.kind
    if names_code(kind) and option(argv, "--segmenter") is None:
        raise InputError(
            f"{where}: names the code {kind} as its segmenter, which no file may; expected --segmenter {kind} on the "
            "command line, if you trust it"
        )
    return args


def start_run(args: Args, sequence: Sequence) -> tuple[RunState, Sequence]:
    """The mapper of the command line at its first frame, or where the checkpoint to resume stopped; and the recording,
    with --realtime at the size in which it can be mapped that fast.

    Raises:
        InputError: options or recording do not fit the checkpoint, or there is none.
    """
    config = args.map.resolved_for(sequence)
    _check(args)
    segmenter = make_segmenter(args.spec, torch_device(config.device), code=True)
    if args.realtime and args.size is None and args.localize_in is None:
        sequence = sequence.resized(size_that_keeps_up(sequence, config, segmenter))
    saved = checkpoint_of(args.localize_in) if args.localize_in is not None else None
    if saved is not None:
        theirs = _saved_config(saved)
        labels = dataclasses.replace(config.labels, rule=theirs.labels.rule)
        config = dataclasses.replace(config, ferns=theirs.ferns, labels=labels)
    device = chosen_device(config.device)
    if args.resume:
        return _resume(args, config, sequence, segmenter), sequence
    if saved is not None:
        surfels, meta = load_map(saved, device, measured=args.extend)
        mapper = mapper_in_saved_map(
            surfels, meta, str(saved), sequence.intrinsics, segmenter, config, frozen=not args.extend
        )
    else:
        mapper, meta = Mapper(config, sequence.intrinsics, segmenter), {}
    state = RunState(mapper, lambda now: write_checkpoint(args, now))
    if mapper.model.frozen:
        state.measured = meta["measured"]
    return state, sequence


def check_new(out: Path, overwrite: bool) -> None:
    """Refuse a RUN folder that holds something already."""
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} is a file; expected a folder to write, or a new name")
    if out.is_dir() and any(out.iterdir()) and not overwrite:
        raise InputError(f"{out} exists and is not empty; expected a new folder, or --overwrite")


@contextlib.contextmanager
def claimed(out: Path) -> Iterator[None]:
    """The RUN folder is ours alone, can be written, and holds nothing that a killed process was writing.

    Raises:
        InputError: another process writes it, or it cannot be written: said before an hour is spent on it.
    """
    with locked(out, "run"):
        for folder in (out, out / "pictures"):
            remove_leftovers(folder)
        probe = out / f".probe.{os.getpid()}.tmp"
        try:
            probe.touch()
            probe.unlink()
        except OSError as error:
            raise WriteError(
                f"{out} cannot be written ({error.strerror}); expected a writable folder"
            ) from error
        yield


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


def _check(args: Args) -> None:
    if args.checkpoint_every < 0:
        raise InputError(f"--checkpoint-every is {args.checkpoint_every}; expected a number of frames, or 0")
    if args.realtime and (args.resume or args.checkpoint_every):
        raise InputError(
            "--realtime with --resume or --checkpoint-every: what it dropped is gone, and a camera does not wait; "
            "expected neither"
        )
    if args.extend and args.localize_in is None:
        raise InputError("--extend without --localize-in; expected the map to extend: --localize-in RUN")
    if args.localize_in is not None and args.map.poses == "given":
        raise InputError(
            "--localize-in with --poses given; expected --poses track: poses are looked for in the map"
        )
    if args.localize_in is not None and args.map.loops.mode == "off":
        raise InputError(
            "--localize-in with --loops off; expected keyframes, which find the camera in the map"
        )


def write_checkpoint(args: Args, state: RunState) -> None:
    """Write the checkpoint of a run of this command line."""
    run = {
        "command": plain_values(args),
        "done": state.done,
        "skipped": state.skipped,
        "wall_s": state.wall_s,
    }
    save_map(state.mapper, args.out / CHECKPOINT, run, state.measured)


def _resume(args: Args, config: MapConfig, sequence: Sequence, segmenter: Segmenter | None) -> RunState:
    path = checkpoint_of(args.out)
    surfels, meta = load_map(path, chosen_device(config.device), measured=True)
    command = with_values(args, meta["run"].get("command", {}), str(path))
    for ours, theirs in zip(options_of(args), options_of(command), strict=True):
        if ours.name not in _MAY_CHANGE and ours.value != theirs.value:
            raise InputError(
                f"{ours.flag} is {ours.value}, but {args.out} was begun with {theirs.value}; expected the same"
            )
    camera = dataclasses.asdict(sequence.intrinsics)
    if meta["intrinsics"] != as_read_back(camera):
        raise InputError(
            f"{args.path}: another camera than that of {args.out}; expected the recording it was begun with"
        )
    mapper = resumed_mapper(surfels, meta, str(path), sequence.intrinsics, segmenter, config)
    state = RunState(mapper, lambda now: write_checkpoint(args, now))
    with reading(path, "a checkpoint of `dsmap map`"):
        state.done = meta["run"]["done"]
        state.skipped = [(int(index), str(reason)) for index, reason in meta["run"]["skipped"]]
        state.wall_s = meta["run"]["wall_s"]
    stamps = meta["times"][mapper.first_frame :]
    if len(sequence) < len(stamps) or (sequence.times[: len(stamps)] != stamps).any():
        raise InputError(
            f"{args.path}: its stamps are not those of {args.out}; expected the recording it was begun with"
        )
    return state


def _saved_config(path: Path) -> MapConfig:
    return fill(MapConfig(), read_metadata(path)["config"], str(path), strict=False)
