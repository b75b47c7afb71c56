"""`dsmap render-scene OUT`: labelled RGB-D sequences of synthetic rooms, one or a data set of many."""

import os
import shlex
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro
from tqdm import tqdm

from dsmap.errors import InputError
from dsmap.tools.parse import parse_size

if TYPE_CHECKING:
    from dsmap.sim_scenes.record import RenderedFrame, RenderOptions


@dataclass
class Args:
    """Options of `dsmap render-scene`."""

    out: tyro.conf.Positional[Path]
    """New folder for the sequence (TUM layout with labels, instances, poses and the ground-truth mesh)."""
    scene: str = "living_room"
    """Kind of room: living_room, bedroom, ...; `mix` (with --count) draws the kinds of a training set."""
    frames: int = 300
    """Number of frames; more frames continue the tour."""
    size: str = "640x480"
    """Image size, WIDTHxHEIGHT."""
    fps: float = 30.0
    """Frames a second of the recording."""
    seed: int = 1
    """Layout, sizes, colours, textures, lights, camera path and noise all follow from it."""
    noise: Literal["none", "kinect"] = "none"
    """Depth noise: none, or like a Kinect v1 (colour and poses stay the same)."""
    clean_copy: Path | None = None
    """With --noise: a second folder for the same recording without noise, rendered only once."""
    path: Literal["walk", "views"] = "walk"
    """walk = a hand-held video; views = unrelated viewpoints, for training."""
    renderer: Literal["warp", "mujoco", "pyrender"] = "warp"
    """warp = ray tracer that needs no OpenGL; mujoco and pyrender need libEGL or a screen."""
    jobs: int = 0
    """Threads (or, with --count, processes) that render side by side; 0 = one for every core."""
    overwrite: bool = False
    """Replace a sequence that is already in OUT."""
    count: int = 0
    """A data set: this many scenes of seeds SEED, SEED + 1, ... in folders of OUT, with a card. Goes on where an
    interrupted run stopped."""
    ray: str | None = None
    """With --count: render on the Ray cluster at this address (OUT on a disk that all nodes share), or `local`."""


def main(args: Args) -> None:
    """Render and say what was written."""
    if args.clean_copy and (args.noise == "none" or args.count):
        raise InputError("--clean-copy is for one sequence with --noise; expected it without --count")
    if args.ray and not args.count:
        raise InputError("--ray is given without --count; expected the number of scenes")
    if args.scene == "mix" and not args.count:
        raise InputError("--scene mix is given without --count; expected the number of scenes")
    import dsmap.kernels.runtime  # noqa: F401  (Warp starts without its remark on a missing GPU; not for --help)

    if args.count:
        _many(args)
    else:
        _one(args)


def _options(args: Args, jobs: int) -> "RenderOptions":
    from dsmap.sim_scenes.record import RenderOptions

    width, height = parse_size(args.size) or (640, 480)
    return RenderOptions(
        scene=args.scene, seed=args.seed, frames=args.frames, width=width, height=height, fps=args.fps,
        noise=args.noise, path=args.path, renderer=args.renderer, jobs=jobs,
    )  # fmt: skip


def _one(args: Args) -> None:
    from dsmap.sim_scenes.record import render_sequence

    def progress(frames: "Iterable[RenderedFrame]", total: int) -> "Iterable[RenderedFrame]":
        print(
            "rendering (on a machine's first run its kernel is compiled before the first frame)",
            file=sys.stderr,
        )
        return tqdm(frames, total=total, unit="frame", disable=None)

    options = _options(args, args.jobs or _cores())
    out = render_sequence(
        args.out, options, clean_copy=args.clean_copy, overwrite=args.overwrite, progress=progress
    )
    print(
        f"{out}: {args.frames} frames of {args.scene} seed {args.seed}, {args.size}, depth noise: {args.noise}"
    )


def _many(args: Args) -> None:
    from dsmap.sim_scenes.card import write_card
    from dsmap.sim_scenes.dataset import plan, run_local, run_ray, unfinished

    tasks = plan(args.out, _options(args, 1), args.count)
    left = unfinished(tasks)
    command = "dsmap render-scene " + shlex.join(sys.argv[2:])
    args.out.mkdir(parents=True, exist_ok=True)
    try:
        with tqdm(total=len(tasks), initial=len(tasks) - len(left), unit="scene", disable=None) as bar:
            if args.ray:
                run_ray(left, args.ray, lambda _: bar.update() and None)
            else:
                run_local(
                    left, min(args.jobs or _cores(), max(len(left), 1)), lambda _: bar.update() and None
                )
    finally:
        write_card(args.out, tasks, command)
    print(f"{args.out}: {len(tasks)} scenes ({len(tasks) - len(left)} were there); see CARD.md")


def _cores() -> int:
    return len(os.sched_getaffinity(0))


if __name__ == "__main__":
    from dsmap.tools.cli import run

    sys.exit(run("render-scene", sys.argv[1:]))
