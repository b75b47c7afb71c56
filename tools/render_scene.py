"""`dsmap render-scene OUT`: a labelled RGB-D sequence of a synthetic room."""

import os
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro
from tqdm import tqdm

from dsmap.errors import InputError
from dsmap.sim_scenes.record import RenderedFrame, RenderOptions, render_sequence
from dsmap.tools.parse import parse_size


@dataclass
class Args:
    """Options of `dsmap render-scene`."""

    out: tyro.conf.Positional[Path]
    """New folder for the sequence (TUM layout with labels, instances, poses and the ground-truth mesh)."""
    scene: Literal["living_room", "bedroom"] = "living_room"
    """Kind of room."""
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
    """With --noise kinect: a second folder for the same recording without noise, rendered only once."""
    path: Literal["walk", "views"] = "walk"
    """walk = a hand-held video; views = unrelated viewpoints, for training a network."""
    renderer: Literal["warp", "mujoco", "pyrender"] = "warp"
    """warp = ray tracer that needs no OpenGL; mujoco and pyrender need libEGL or a screen."""
    jobs: int = 0
    """Threads that render side by side; 0 = one for every core."""
    overwrite: bool = False
    """Replace a sequence that is already in OUT."""


def main(args: Args) -> None:
    """Render and say what was written."""
    if args.clean_copy and args.noise == "none":
        raise InputError("--clean-copy is given without --noise kinect: both folders would hold the same")
    import dsmap.kernels.runtime  # noqa: F401  (Warp starts without its remark on a missing GPU; not for --help)

    width, height = parse_size(args.size) or (640, 480)
    options = RenderOptions(
        scene=args.scene,
        seed=args.seed,
        frames=args.frames,
        width=width,
        height=height,
        fps=args.fps,
        noise=args.noise,
        path=args.path,
        renderer=args.renderer,
        jobs=args.jobs or len(os.sched_getaffinity(0)),
    )

    def progress(frames: Iterable[RenderedFrame], total: int) -> Iterable[RenderedFrame]:
        print(
            "rendering (on a machine's first run its kernel is compiled before the first frame)",
            file=sys.stderr,
        )
        return tqdm(frames, total=total, unit="frame", disable=None)

    out = render_sequence(
        args.out, options, clean_copy=args.clean_copy, overwrite=args.overwrite, progress=progress
    )
    print(
        f"{out}: {args.frames} frames of {args.scene} seed {args.seed}, {width}x{height}, depth noise: {args.noise}"
    )


if __name__ == "__main__":
    from dsmap.tools.cli import run

    sys.exit(run("render-scene", sys.argv[1:]))
