"""Recording: a scene and a camera path become a sequence on disk, or a stream of frames in memory."""

import contextlib
import json
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from queue import SimpleQueue

import numpy as np

from dsmap.errors import InputError
from dsmap.files import atomic_path
from dsmap.sequences import SequenceWriter
from dsmap.sequences.mesh import LabelledMesh, write_mesh
from dsmap.sim_scenes.render import RENDERERS, Image, Renderer, default_camera, open_renderer, part_tables
from dsmap.sim_scenes.rooms import build_scene
from dsmap.sim_scenes.scene import Scene
from dsmap.sim_scenes.sensor_noise import NOISES, kinect_depth
from dsmap.sim_scenes.trajectories import camera_path

MAX_DEPTH_M = 8.0
"""Default depth range of a rendered room, written into its calibration [m]."""


@dataclass(frozen=True)
class RenderOptions:
    """What to render. Everything but `renderer` and `jobs` follows from these values to the byte."""

    scene: str = "living_room"
    seed: int = 1
    frames: int = 300
    width: int = 640
    height: int = 480
    fps: float = 30.0
    noise: str = "none"
    path: str = "walk"
    """`walk` = a hand-held video; `views` = unrelated viewpoints, for training."""
    renderer: str = "warp"
    jobs: int = 1
    """Frames rendered side by side (threads); the result does not depend on it."""

    def check(self) -> None:
        """Raises InputError for values out of range."""
        for name, value, least in (
            ("frames", self.frames, 1),
            ("width", self.width, 16),
            ("height", self.height, 16),
        ):
            if value < least:
                raise InputError(f"{name} is {value}; expected at least {least}")
        if not self.fps > 0:
            raise InputError(f"fps is {self.fps}; expected a positive number")
        if self.seed < 0:
            raise InputError(f"seed is {self.seed}; expected 0 or more")
        if self.noise not in NOISES:
            raise InputError(f"unknown noise {self.noise!r}; expected one of: {', '.join(NOISES)}")
        if self.renderer not in RENDERERS:
            raise InputError(f"unknown renderer {self.renderer!r}; expected one of: {', '.join(RENDERERS)}")


@dataclass(frozen=True)
class RenderedFrame:
    """One frame with its ground truth; images are (H, W)."""

    time: float
    """[s]"""
    rgb: np.ndarray
    depth: np.ndarray
    """Planar depth [m], float32, with the noise asked for; 0 where there is none."""
    true_depth: np.ndarray
    """Planar depth [m] without noise."""
    label: np.ndarray
    instance: np.ndarray
    T_world_camera: np.ndarray


def iter_frames(scene: Scene, options: RenderOptions) -> Iterator[RenderedFrame]:
    """Render a scene along its camera path, frame by frame, without touching the disk."""
    options.check()
    camera = default_camera(options.width, options.height)
    poses = camera_path(scene, options.path, options.frames, options.fps, options.seed)
    tables = part_tables(scene)
    jobs = max(1, min(options.jobs, options.frames)) if options.renderer == "warp" else 1

    def finish(index: int, image: Image) -> RenderedFrame:
        label, instance, glass = (table[image.part] for table in tables)
        depth = image.depth
        if options.noise == "kinect":
            depth = kinect_depth(depth, camera, glass, seed=options.seed, frame=index)
        return RenderedFrame(
            index / options.fps, image.rgb, depth, image.depth, label, instance, poses[index]
        )

    if jobs == 1:  # OpenGL contexts belong to the thread that made them, so no pool here.
        renderer = open_renderer(options.renderer, scene, camera)
        try:
            for index, pose in enumerate(poses):
                yield finish(index, renderer(pose))
        finally:
            renderer.close()
        return
    yield from _in_threads(jobs, lambda: open_renderer(options.renderer, scene, camera), finish, poses)


def _in_threads(
    jobs: int, make: Callable[[], Renderer], finish: Callable[[int, Image], RenderedFrame], poses: np.ndarray
) -> Iterator[RenderedFrame]:
    """Render frames on `jobs` threads, each with a renderer of its own, and yield them in order."""
    idle: SimpleQueue[Renderer] = SimpleQueue()
    renderers = [make() for _ in range(jobs)]
    for renderer in renderers:
        idle.put(renderer)

    def one(index: int) -> RenderedFrame:
        renderer = idle.get()
        try:
            return finish(index, renderer(poses[index]))
        finally:
            idle.put(renderer)

    waiting: deque[Future[RenderedFrame]] = deque()
    with ThreadPoolExecutor(jobs) as pool:
        try:
            for index in range(len(poses)):
                waiting.append(pool.submit(one, index))
                if len(waiting) > 2 * jobs:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()
    for renderer in renderers:
        renderer.close()


def render_sequence(
    out: Path | str,
    options: RenderOptions,
    *,
    clean_copy: Path | str | None = None,
    overwrite: bool = False,
    progress: Callable[[Iterable[RenderedFrame], int], Iterable[RenderedFrame]] | None = None,
) -> Path:
    """Render a sequence with all its ground truth into the folder `out`; returns it.

    Args:
        out: new folder, in the TUM layout with labels (docs of `dsmap.sequences.writer`), plus `mesh.ply`
            (surface with the class of every face) and `scene.json` (options and version).
        clean_copy: a second new folder for the same recording with noise `none`, without rendering twice.
        overwrite: replace a sequence that is there.
        progress: wraps the frames (called with their number), as tqdm does.

    Raises:
        InputError: bad options, an existing sequence, or a folder that cannot be written.
    """
    options.check()
    scene = build_scene(options.scene, options.seed)
    camera = default_camera(options.width, options.height)
    targets = [(out, options)] + ([(clean_copy, replace(options, noise="none"))] if clean_copy else [])
    with contextlib.ExitStack() as stack:
        writers = [
            stack.enter_context(SequenceWriter(path, camera, overwrite=overwrite, depth_max=MAX_DEPTH_M))
            for path, _ in targets
        ]
        frames: Iterable[RenderedFrame] = iter_frames(scene, options)
        for frame in progress(frames, options.frames) if progress else frames:
            for writer, (_, what) in zip(writers, targets, strict=True):
                depth = frame.true_depth if what.noise == "none" else frame.depth
                writer.write(
                    frame.time,
                    frame.rgb,
                    depth,
                    T_world_camera=frame.T_world_camera,
                    label=frame.label,
                    instance=frame.instance,
                )
    for path, what in targets:
        write_mesh(Path(path) / "mesh.ply", LabelledMesh(*scene.surface()))
        record = {k: v for k, v in asdict(what).items() if k != "jobs"}
        with atomic_path(Path(path) / "scene.json") as file:
            file.write_text(json.dumps({"dsmap": version("dsmap"), "options": record}, indent=2) + "\n")
    return Path(out)
