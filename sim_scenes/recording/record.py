"""Recording: a scene and a camera path become a sequence on disk, or a stream of frames in memory."""

import contextlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from queue import SimpleQueue

import numpy as np

from dsmap.files import write_json
from dsmap.sequences import SequenceWriter
from dsmap.sequences.bodies import write_bodies
from dsmap.sequences.mesh import LabelledMesh, write_mesh
from dsmap.sim_scenes.recording.open_scene import open_scene
from dsmap.sim_scenes.recording.options import RenderOptions, Take, plan_take
from dsmap.sim_scenes.render.open_renderer import open_renderer
from dsmap.sim_scenes.render.renderer import Image, Renderer, part_tables
from dsmap.sim_scenes.scene import Scene
from dsmap.sim_scenes.sensors.colour_camera import apply, exposure_flow, frame_tremor
from dsmap.sim_scenes.sensors.registry import SENSORS


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
    """Class ids, uint8; 0 while the lens is covered."""
    instance: np.ndarray
    T_world_camera: np.ndarray
    T_world_body: np.ndarray | None = None
    """Poses of the moving bodies, shape (bodies, 4, 4); None where nothing moves."""


def iter_frames(scene: Scene, options: RenderOptions, take: Take | None = None) -> Iterator[RenderedFrame]:
    """Render a scene along its camera path, frame by frame, without touching the disk.

    `take`: what `plan_take` gave for the same scene and options, if the caller has it already.
    """
    take = take or plan_take(scene, options)
    finish = _Finish(options, take)
    frames = len(take.poses)
    jobs = max(1, min(options.jobs, frames)) if options.renderer == "warp" else 1

    def make() -> Renderer:
        return open_renderer(options.renderer, take.scene, take.camera, rolling=take.rows is not None)

    if jobs == 1:  # OpenGL contexts belong to the thread that made them, so no pool here.
        renderer = make()
        try:
            for index in range(frames):
                yield finish(index, take.shot(renderer, index))
        finally:
            renderer.close()
        return
    yield from _in_threads(jobs, make, finish, take)


class _Finish:
    """From a rendered image to a frame: labels, the sensor's depth, the camera's colours."""

    def __init__(self, options: RenderOptions, take: Take) -> None:
        self.options, self.take = options, take
        self.tables, self.sensor = part_tables(take.scene), SENSORS[options.noise]

    def __call__(self, index: int, image: Image) -> RenderedFrame:
        options, take = self.options, self.take
        label, instance, glass = (table[image.part] for table in self.tables)
        rgb, true = self._colours(index, image), image.depth
        depth = self.sensor.measure(true, take.camera, glass, image.rgb, options.seed, index)
        if take.covered[index]:
            rgb, depth, true, label, instance = map(np.zeros_like, (rgb, depth, true, label, instance))
        bodies = None if take.T_world_body is None else take.T_world_body[index]
        return RenderedFrame(
            index / options.fps, rgb, depth, true, label, instance, take.true_pose(index), bodies
        )

    def _colours(self, index: int, image: Image) -> np.ndarray:
        """The picture with the camera's effects; it is smeared by the motion since the frame before."""
        take, effects = self.take, self.take.effects
        if effects.idle:
            return image.rgb
        pose = take.poses[index]
        if self.options.path == "views":
            neighbour = pose @ frame_tremor(effects, index)
        else:
            neighbour = take.poses[index - 1] if index else take.poses[min(1, len(take.poses) - 1)]
        flow = exposure_flow(image.depth, take.camera, pose, neighbour, effects)
        return apply(image.rgb, effects, index, flow)


def _in_threads(
    jobs: int, make: Callable[[], Renderer], finish: Callable[[int, Image], RenderedFrame], take: Take
) -> Iterator[RenderedFrame]:
    """Render frames on `jobs` threads, each with a renderer of its own, and yield them in order."""
    idle: SimpleQueue[Renderer] = SimpleQueue()
    renderers = [make() for _ in range(jobs)]
    for renderer in renderers:
        idle.put(renderer)

    def one(index: int) -> RenderedFrame:
        renderer = idle.get()
        try:
            return finish(index, take.shot(renderer, index))
        finally:
            idle.put(renderer)

    waiting: deque[Future[RenderedFrame]] = deque()
    with ThreadPoolExecutor(jobs) as pool:
        try:
            for index in range(len(take.poses)):
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
            (surface with the class of every face, without what moves), `bodies.txt` where something moves
            (`dsmap.sequences.bodies`) and `scene.json` (options and version).
        clean_copy: a second new folder for the same recording with noise `none`, without rendering twice.
        overwrite: replace a sequence that is there.
        progress: wraps the frames (called with their number), as tqdm does.

    Raises:
        InputError: bad options, an existing sequence, or a folder that cannot be written.
    """
    options.check()
    scene = open_scene(options)
    take = plan_take(scene, options)
    targets = [(out, options)] + ([(clean_copy, replace(options, noise="none"))] if clean_copy else [])
    with contextlib.ExitStack() as stack:
        writers = [
            stack.enter_context(
                SequenceWriter(
                    path,
                    take.camera,
                    overwrite=overwrite,
                    depth_max=SENSORS[what.noise].depth_max,
                    readout_s=options.rows_s,
                    depth_time_offset_s=options.depth_offset_s,
                )
            )
            for path, what in targets
        ]
        frames: Iterable[RenderedFrame] = iter_frames(scene, options, take)
        for frame in progress(frames, len(take.poses)) if progress else frames:
            for writer, (_, what) in zip(writers, targets, strict=True):
                depth = frame.true_depth if what.noise == "none" else frame.depth
                writer.write(
                    frame.time,
                    frame.rgb,
                    depth,
                    T_world_camera=frame.T_world_camera,
                    pose_time=frame.time + options.depth_offset_s,
                    label=frame.label,
                    instance=frame.instance,
                )
    for path, what in targets:
        _write_truth(Path(path), what, take)
    return Path(out)


def _write_truth(path: Path, options: RenderOptions, take: Take) -> None:
    """What belongs to the recording as a whole: its surface, what moves in it, how it was made."""
    write_mesh(path / "mesh.ply", LabelledMesh(*take.scene.surface(moving=False)))
    if take.T_world_body is not None:
        bodies, times = take.scene.bodies, np.arange(len(take.poses)) / options.fps
        names, instances = [b.name for b in bodies], [b.instance for b in bodies]
        write_bodies(path, times, names, instances, take.T_world_body)
    record = {k: v for k, v in asdict(options).items() if k != "jobs"}
    write_json(path / "scene.json", {"dsmap": version("dsmap"), "options": record}, indent=2)
