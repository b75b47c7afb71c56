"""`dsmap live`: map a camera while it films, and watch."""

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any

import tyro

from dsmap.errors import InputError
from dsmap.files import all_that_fits
from dsmap.fusion.config import MapConfig
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.runs.map_live import Controls, Moment, map_live
from dsmap.fusion.runs.map_recording import RunState, signals_noted
from dsmap.fusion.runs.newest_frame import NewestFrame
from dsmap.fusion.runs.pace import Pace
from dsmap.fusion.runs.replay import Replay
from dsmap.ranges import Range
from dsmap.sequences import open_sequence
from dsmap.stopping import exit_code
from dsmap.tools.live.sources import LiveSource, open_source
from dsmap.tools.mapping.options import Args as MapArgs
from dsmap.tools.mapping.output import report_run, write_run
from dsmap.tools.mapping.segmenters import SegmenterSpec, make_segmenter
from dsmap.tools.mapping.start import check_new, claimed, torch_device, write_checkpoint
from dsmap.tools.support.parse import parse_size


@dataclass
class Args:
    """Options of `dsmap live`, and every parameter of mapping (see `dsmap map`)."""

    out: Path
    """RUN folder to write when it ends."""
    source: Annotated[str | None, tyro.conf.Positional] = None
    """The camera: realsense, oak, record3d (an iPhone on USB), or module:factory returning a source; or --replay."""
    replay: Path | None = None
    """A recording that comes at its own speed, as if its camera were here."""
    speed: Annotated[float, Range(0.01, 100)] = 1.0
    """With --replay: so many times its own speed."""
    size: str | None = None
    """With --replay: resize frames to WIDTHxHEIGHT first, e.g. 320x240."""
    overwrite: bool = False
    """Replace the files of an existing RUN."""
    view: bool = True
    """Serve the page that shows the map growing."""
    host: str = "127.0.0.1"
    """Address to listen on. The default is reached from this machine only (or through SSH); 0.0.0.0 lets
    everybody in the network look who knows the whole address, its secret included."""
    port: Annotated[int, Range(1, 65_535)] = 8080
    """Port of the page; the next free one is taken if it is in use."""
    rerun: str | None = None
    """Show it in rerun, too: viewer, or an .rrd file to write."""
    spec: Annotated[SegmenterSpec, tyro.conf.arg(name="")] = field(default_factory=SegmenterSpec)
    map: Annotated[MapConfig, tyro.conf.arg(name="")] = field(
        default_factory=lambda: MapConfig(device="auto")
    )


def main(args: Args) -> int:
    """Map until the source ends, or until Ctrl-C or the page's Stop; returns the exit code."""
    source, about = open_live(args)
    config = args.map.resolved_for(about)
    check_new(args.out, args.overwrite)
    segmenter = make_segmenter(args.spec, torch_device(config.device), code=True)
    mapper, controls = Mapper(config, source.intrinsics, segmenter), Controls()
    command = MapArgs(
        Path(about.path), args.out, spec=args.spec, map=args.map, size=args.size, objects=False, refine="none"
    )
    state = RunState(mapper, lambda now: write_checkpoint(command, now))
    with contextlib.ExitStack() as held:
        held.enter_context(claimed(args.out))
        watch, said = _watchers(args, mapper, controls, held)
        asked_to_stop = held.enter_context(signals_noted())
        began = time.monotonic()

        def save() -> None:
            state.wall_s, state.done = time.monotonic() - began, mapper.time
            with all_that_fits(args.out) as attempt:
                attempt(write_run, command, state, about)
            said(f"saved after {mapper.time} frames")

        frames = source.newest() if isinstance(source, Replay) else NewestFrame(source.frames())
        state.pace = Pace(mapper)
        try:
            map_live(mapper, frames, controls, watch, save, asked_to_stop, state.pace)
        finally:
            frames.close()
            if mapper.time:
                save()
        report_run(state, args.out)
        stopped = asked_to_stop()
    return exit_code(stopped) if stopped else 0


def open_live(args: Args) -> tuple[LiveSource, Any]:
    """The source, and what the run says of it: a Sequence, or what stands for one.

    Raises:
        InputError: none or two are named, or it is not there.
    """
    if (args.source is None) == (args.replay is None):
        raise InputError(
            "expected one source: a camera (realsense, oak, record3d, module:factory), or --replay PATH"
        )
    if args.replay is not None:
        sequence = open_sequence(args.replay, size=parse_size(args.size))
        return Replay(sequence, args.speed), sequence
    assert args.source is not None
    if args.size is not None:
        raise InputError("--size is for --replay; a camera's frames have the size that it gives")
    if args.map.poses == "given" or args.spec.kind == "labels":
        raise InputError(
            "a camera gives neither poses nor labels; expected --poses track and another segmenter"
        )
    source = open_source(args.source)
    about = SimpleNamespace(
        path=args.source, intrinsics=source.intrinsics, intrinsics_source="the camera", depth_scale=1000.0,
        depth_max=getattr(source, "depth_max", None), readout_s=getattr(source, "readout_s", 0.0),
        frame_rate=None,
    )  # fmt: skip
    return source, about


def _watchers(
    args: Args, mapper: Mapper, controls: Controls, held: contextlib.ExitStack
) -> tuple[Callable[[Moment], None], Callable[[str], None]]:
    """What is shown every frame, and who is told what happens."""
    shows: list[Callable[[Mapper, Moment], None]] = []
    says: list[Callable[[str], None]] = [print]
    if args.view:
        from dsmap.tools.live.page import LivePage

        page = LivePage(args.host, args.port, args.out.resolve().name, controls)
        held.callback(page.close)
        shows.append(page.show)
        says.append(page.say)
        port = page.server.get_port()
        print(f"open {page.address}   (Ctrl-C ends and writes {args.out})")
        print(
            f"over SSH, first run on your own machine: ssh -L {port}:localhost:{port} <this host>", flush=True
        )
    if args.rerun is not None:
        from dsmap.tools.live.rerun_stream import RerunStream

        stream = RerunStream(args.rerun)
        held.callback(stream.close)
        shows.append(stream.show)

    def watch(moment: Moment) -> None:
        for show in shows:
            show(mapper, moment)

    def said(text: str) -> None:
        for say in says:
            say(text)

    return watch, said
