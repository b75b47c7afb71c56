"""`dsmap bench-render`: frames a second on one core, for every renderer that this machine can run."""

import time
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from dsmap.errors import InputError
from dsmap.ranges import Range, Seed
from dsmap.tools.support.parse import parse_size


@dataclass
class Args:
    """Options of `dsmap bench-render`."""

    scene: str = "living_room"
    """Kind of room."""
    seed: Seed = 1
    """Its seed."""
    sizes: tuple[str, ...] = ("320x240", "640x480")
    """Image sizes."""
    frames: Annotated[int, Range(1, 1_000_000)] = 12
    """Frames a measurement, after one that is not counted; the median is reported."""


def main(args: Args) -> None:
    """Time colour + depth + classes of one frame at a time and print a table."""
    import dsmap.kernels.runtime  # noqa: F401  (Warp's settings come before its first use)
    from dsmap.sim_scenes.camera_paths.paths import camera_path
    from dsmap.sim_scenes.render.open_renderer import open_renderer
    from dsmap.sim_scenes.render.renderer import RENDERERS, default_camera
    from dsmap.sim_scenes.rooms.build import build_scene

    scene = build_scene(args.scene, args.seed)
    poses = camera_path(scene, "views", args.frames + 1, 30.0, args.seed)
    print(f"{args.scene} seed {args.seed}: {len(scene.parts)} parts, {len(scene.lights)} lights; one thread")
    print(f"{'renderer':<10} {'size':<9} {'ms/frame':>9} {'frames/s':>9} {'of warp':>8}")
    for text in args.sizes:
        width, height = parse_size(text) or (320, 240)
        reference = None
        for name in RENDERERS:
            try:
                renderer = open_renderer(name, scene, default_camera(width, height))
            except InputError as error:
                print(f"{name:<10} {text:<9} not here: {error}")
                continue
            ms = 1e3 * float(np.median(_times(renderer, poses)))
            renderer.close()
            reference = reference or ms
            print(f"{name:<10} {text:<9} {ms:9.1f} {1e3 / ms:9.1f} {reference / ms:8.2f}")


def _times(renderer, poses: np.ndarray) -> list[float]:
    """Seconds of each frame but the first, which compiles and allocates."""
    renderer(poses[0])
    seconds = []
    for pose in poses[1:]:
        start = time.perf_counter()
        renderer(pose)
        seconds.append(time.perf_counter() - start)
    return seconds
