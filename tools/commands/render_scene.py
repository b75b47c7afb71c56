"""`dsmap render-scene OUT`: labelled RGB-D sequences of synthetic rooms, one or a data set of many."""

import shlex
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from tqdm import tqdm

from dsmap.cores import usable_cores
from dsmap.errors import InputError
from dsmap.folders import locked, remove_leftovers
from dsmap.ranges import Range, Seed
from dsmap.tools.support.parse import parse_intrinsics, parse_size

if TYPE_CHECKING:
    from dsmap.sim_scenes.recording.record import RenderedFrame, RenderOptions


@dataclass
class Args:
    """Options of `dsmap render-scene`."""

    out: tyro.conf.Positional[Path]
    """New folder for the sequence (TUM layout with labels, instances, poses and the ground-truth mesh)."""
    scene: str = "living_room"
    """Kind of room: living_room, bedroom, office, kitchen, bathroom, corridor, flat (several rooms joined by
    doors), flats:2 to flats:6 (flats in a row joined by bare corridors); with --count also `mix`, the kinds of a
    training set. Or a scene of your own: .glb, .gltf, .obj, .ply with labels, MuJoCo .xml."""
    class_map: Path | None = None
    """For a scene file: YAML or CSV that maps its names or ids to classes."""
    up: Literal["y", "z"] | None = None
    """For a scene file: which axis points up; default what its format says."""
    frames: Annotated[int | None, Range(1, 1_000_000)] = None
    """Number of frames; default 300, or with --path loop as many as the round trip takes."""
    size: str = "640x480"
    """Image size, WIDTHxHEIGHT."""
    fps: Annotated[float, Range(0, 1000, above=True)] = 30.0
    """Frames a second of the recording."""
    seed: Seed = 1
    """Layout, sizes, colours, textures, lights, camera path and noise all follow from it."""
    path: Literal["walk", "views", "loop", "fast", "shake", "cover", "jump"] = "walk"
    """walk = a hand-held video; views = unrelated viewpoints, for training; loop = a round trip. To try a
    tracker: fast = walk with bursts of fast rotation, shake = turned fast about all axes, cover = with a covered lens,
    jump = carried elsewhere."""
    moving: Literal["none", "chair", "door", "ball", "person"] = "none"
    """Something that moves while the camera watches: a pushed chair, a door (of a flat), a rolling ball, a person
    who walks. Its poses go to bodies.txt."""
    noise: Literal["none", "kinect", "d435", "azure"] = "none"
    """Depth sensor to imitate: Kinect v1, RealSense D435, Azure Kinect (colour and poses stay the same)."""
    effects: Literal["none", "mild", "strong"] = "none"
    """What a camera does to colour: exposure, white balance, motion blur, noise, vignetting, compression."""
    intrinsics: str | None = None
    """fx,fy,cx,cy [px], integer pixel centres; default those of the sensor."""
    distortion: bool = False
    """Give the lens a distortion (stated in calibration.yaml; renderer warp only)."""
    readout_s: Annotated[float, Range(-0.1, 0.1)] = 0.0
    """Rolling shutter: time from an image's first row to its last [s], negative from below (a Kinect: 0.026; renderer
    warp only)."""
    depth_readout_s: Annotated[float, Range(-0.1, 0.1)] | None = None
    """Rolling shutter of the depth camera [s]; default: the colour camera's."""
    depth_offset_s: Annotated[float, Range(-0.1, 0.1)] = 0.0
    """Depth images are taken so much later than their colour images [s]."""
    clean_copy: Path | None = None
    """With --noise: a second folder for the same recording without noise, rendered only once."""
    renderer: Literal["warp", "mujoco", "pyrender"] = "warp"
    """warp = ray tracer that needs no OpenGL; mujoco and pyrender need libEGL or a screen."""
    jobs: Annotated[int, Range(0, 1024)] = 0
    """Threads (or, with --count, processes) that render side by side; 0 = one for every core."""
    overwrite: bool = False
    """Replace a sequence that is already in OUT."""
    count: Annotated[int, Range(0, 1_000_000)] = 0
    """A data set: this many scenes of seeds SEED, SEED + 1, ... in folders of OUT, with a card. Goes on where an
    interrupted run stopped."""
    ray: str | None = None
    """With --count: render on the Ray cluster at this address (OUT on a disk that all nodes share), or `local`."""


def main(args: Args) -> None:
    """Render and say what was written."""
    if args.clean_copy and (args.noise == "none" or args.count):
        raise InputError("--clean-copy is given without --noise or with --count; expected one noisy sequence")
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
    from dsmap.sim_scenes.recording.record import RenderOptions

    width, height = parse_size(args.size) or (640, 480)
    frames = args.frames if args.frames is not None else 0 if args.path == "loop" else 300
    return RenderOptions(
        scene=args.scene, seed=args.seed, frames=frames, width=width, height=height, fps=args.fps,
        noise=args.noise, path=args.path, intrinsics=parse_intrinsics(args.intrinsics), effects=args.effects,
        distortion=args.distortion, class_map=str(args.class_map) if args.class_map else None, up=args.up,
        moving=args.moving, readout_s=args.readout_s, depth_readout_s=args.depth_readout_s,
        depth_offset_s=args.depth_offset_s, renderer=args.renderer, jobs=jobs,
    )  # fmt: skip


def _one(args: Args) -> None:
    from dsmap.sim_scenes.recording.record import render_sequence

    def progress(frames: "Iterable[RenderedFrame]", total: int) -> "Iterable[RenderedFrame]":
        print(
            "rendering (on a machine's first run its kernel is compiled before the first frame)",
            file=sys.stderr,
        )
        return tqdm(frames, total=total, unit="frame", disable=None)

    options = _options(args, args.jobs or usable_cores())
    out = render_sequence(
        args.out, options, clean_copy=args.clean_copy, overwrite=args.overwrite, progress=progress
    )
    count = sum(not line.startswith("#") for line in (out / "rgb.txt").read_text().splitlines())
    print(f"{out}: {count} frames of {args.scene} seed {args.seed}, {args.size}, depth noise: {args.noise}")


def _many(args: Args) -> None:
    from dsmap.sim_scenes.recording.dataset import plan, remove_partials, run_local, run_ray, unfinished
    from dsmap.sim_scenes.recording.dataset_card import write_card

    tasks = plan(args.out, _options(args, 1), args.count)
    command = "dsmap render-scene " + shlex.join(sys.argv[2:])
    with locked(args.out, "data set"):
        remove_partials(args.out)
        remove_leftovers(args.out)
        left = unfinished(tasks)
        try:
            with tqdm(total=len(tasks), initial=len(tasks) - len(left), unit="scene", disable=None) as bar:
                if args.ray:
                    run_ray(left, args.ray, lambda _: bar.update())
                else:
                    jobs = min(args.jobs or usable_cores(), max(len(left), 1))
                    run_local(left, jobs, lambda _: bar.update())
        finally:
            write_card(args.out, tasks, command)
    print(f"{args.out}: {len(tasks)} scenes ({len(tasks) - len(left)} were there); see CARD.md")


if __name__ == "__main__":
    from dsmap.tools.cli import run

    sys.exit(run("render-scene", sys.argv[1:]))
