"""`dsmap map`: a recording goes in, a RUN folder comes out."""

import contextlib
import time
from pathlib import Path

import tyro

from dsmap.errors import InputError
from dsmap.files import all_that_fits
from dsmap.fusion.runs.map_realtime import map_realtime
from dsmap.fusion.runs.map_recording import RunState, map_recording, signals_noted
from dsmap.sequences import Sequence, open_sequence
from dsmap.sequences.formats.protocol import Options
from dsmap.sequences.pose_conventions import with_convention
from dsmap.stopping import exit_code
from dsmap.tools.mapping.checks import check_recording, verdict, without_partner
from dsmap.tools.mapping.help import help_text
from dsmap.tools.mapping.options import Args
from dsmap.tools.mapping.output import draw_pictures, remove_pictures, report_run, write_run
from dsmap.tools.mapping.presets import write_preset
from dsmap.tools.mapping.spelling import spelled_out
from dsmap.tools.mapping.start import check_new, checkpoint_of, claimed, default_args, start_run
from dsmap.tools.support.parse import parse_intrinsics, parse_size


def parse(argv: list[str]) -> Args:
    """The options of a command line; those not given are those of --config, of the run to resume, or the usual ones.

    Raises:
        InputError: a configuration or a checkpoint that cannot be read.
        SystemExit: the help was asked for, or a flag is wrong.
    """
    argv = spelled_out(argv)
    usual = Args(tyro.MISSING, tyro.MISSING)
    if "--help" in argv or "-h" in argv:
        print(help_text(usual))
        raise SystemExit(0)
    if any(word.partition("=")[0] in ("--write-config", "--write_config") for word in argv):
        usual = Args(Path(), Path())  # nothing is mapped
    return tyro.cli(Args, args=argv, prog="dsmap map", default=default_args(usual, argv))


def main(args: Args) -> int:
    """Map a recording; returns the exit code."""
    if args.write_config is not None:
        write_preset(args.write_config, args)
        print(f"written: {args.write_config}")
        return 0
    began = time.perf_counter()
    sequence = open_recording(args)
    with contextlib.ExitStack() as held:
        if args.resume:
            checkpoint_of(args.out)
            held.enter_context(claimed(args.out))
        state, sequence = start_run(args, sequence)
        check_recording(args, sequence, state.mapper.config)
        if not args.resume:
            check_new(args.out, args.overwrite)
            held.enter_context(claimed(args.out))
        announce(args, sequence, state)
        asked_to_stop = held.enter_context(signals_noted())  # writing is finished first, too
        watch = None
        if args.view:
            from dsmap.tools.live.watch_map import watching

            watch, asked_to_stop = held.enter_context(watching(args, state, asked_to_stop))
        if args.realtime:
            map_realtime(state, sequence, asked_to_stop, watch)
        else:
            map_recording(state, sequence, args.checkpoint_every, asked_to_stop, watch)
        state.wall_s += time.perf_counter() - began
        with all_that_fits(args.out) as attempt:
            whole = attempt(write_run, args, state, sequence)
            if args.pictures:
                attempt(draw_pictures, args.out, state, sequence)
            else:
                remove_pictures(args.out)
            report_run(state, args.out, whole)
        stopped = asked_to_stop()
    return exit_code(stopped) if stopped else verdict(state, sequence)


def open_recording(args: Args) -> Sequence:
    """The recording of the command line, checked against what was asked of it."""
    sequence = open_sequence(
        args.path, intrinsics=parse_intrinsics(args.intrinsics), depth_scale=args.depth_scale,
        size=parse_size(args.size), start=args.start, stop=args.stop, stride=args.stride, undistort=args.undistort,
        label_map=args.label_map, options=Options(args.color_topic, args.depth_topic),
    )  # fmt: skip
    if args.pose_convention is not None:
        sequence = with_convention(sequence, args.pose_convention)
    if args.map.poses == "given" and not sequence.has_poses:
        raise InputError(
            f"{args.path}: --poses given, but the recording has no poses; expected a ground truth file"
        )
    if args.spec.kind == "labels" and not sequence.has_labels:
        why = sequence.recording.labels_unused or "the recording has no labels; expected label.txt"
        raise InputError(f"{args.path}: --segmenter labels, but {why}")
    return sequence


def announce(args: Args, sequence: Sequence, state: RunState) -> None:
    """Say what is about to happen."""
    print(
        f"{sequence.layout} recording, {len(sequence)} frames, intrinsics from {sequence.intrinsics_source}"
    )
    for note in [*sequence.notes, without_partner(sequence)]:
        if note:
            print(f"note: {note}")
    if args.realtime:
        camera = sequence.intrinsics
        print(f"at its own speed, in images of {camera.width}x{camera.height}")
    if args.resume:
        print(f"going on at frame {state.done} of {len(sequence)} with the parameters of {args.out}")
    elif args.localize_in is not None:
        what = "extending" if args.extend else "tracking in"
        print(f"{what} the map of {args.localize_in}: {state.mapper.surfels.count:,} surfels")
