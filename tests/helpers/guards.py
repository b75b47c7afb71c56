"""What must not change when code only moves: hashes of maps, trajectories and rooms, and a RUN of an earlier dsmap.

`--write` states today's hashes in `kept/guards.json` (after a change that is meant to change results); `--write-run
FOLDER` makes the old RUN anew, which is only ever needed when its format ends. Hashes are of one kind of machine:
compilers and mathematical libraries round differently on others.
"""

import argparse
import dataclasses
import hashlib
import json
import lzma
import platform
import sys
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import loop_room
import moving_scene
import numpy as np
from corner_frames import config, frames

from dsmap.frame import Frame, Intrinsics
from dsmap.fusion.config import LabelConfig
from dsmap.fusion.labels.semantics import GroundTruthSegmenter
from dsmap.fusion.lie import exp_se3
from dsmap.fusion.mapper import Mapper
from dsmap.sequences import SequenceWriter
from dsmap.sim_scenes.rooms.build import SCENES, build_scene
from dsmap.sim_scenes.scene import Scene
from dsmap.tools.twins import corner as wall_corner
from dsmap.tools.twins.corner import INTRINSICS

KEPT = Path(__file__).parent / "kept"
STATED = KEPT / "guards.json"
OLD_RUN = KEPT / "old_run.tar.xz"
SEEDS = (3, 14, 159)
OLD_FRAMES, ALL_FRAMES = 12, 18
"""Frames of the old RUN, and those of its recording."""
_SMALL = Intrinsics(64, 48, 55.0, 55.0, 31.5, 23.5)


def machine() -> str:
    """What the hashes depend on besides the code."""
    info = Path("/proc/cpuinfo")
    flags: set[str] = set()
    if info.exists():
        line = next((x for x in info.read_text().splitlines() if x.startswith("flags")), "")
        flags = set(line.split()) & {"avx2", "fma", "avx512f", "avx512dq", "avx512bw", "avx512vl"}
    return f"{platform.machine()} {' '.join(sorted(flags))} numpy {np.__version__}"


def hash_of(*things: Any) -> str:
    """SHA-256 of arrays, dataclasses, lists, dicts and plain values by what they hold, not by their classes."""
    digest = hashlib.sha256()

    def add(thing: Any) -> None:
        if isinstance(thing, np.ndarray):
            digest.update(f"{thing.dtype.str}{thing.shape}".encode())
            digest.update(np.ascontiguousarray(thing).tobytes())
        elif dataclasses.is_dataclass(thing):
            for field in dataclasses.fields(thing):
                add(getattr(thing, field.name))
        elif isinstance(thing, dict):
            for key in sorted(thing):
                add(key)
                add(thing[key])
        elif isinstance(thing, list | tuple):
            digest.update(f"[{len(thing)}".encode())
            for one in thing:
                add(one)
        elif isinstance(thing, np.generic):
            add(thing.item())
        else:
            assert thing is None or isinstance(thing, str | int | float | bool), type(thing)
            digest.update(repr(thing).encode() + b";")

    for thing in things:
        add(thing)
    return digest.hexdigest()[:16]


def hash_of_map(mapper: Mapper) -> str:
    """Of surfels, trajectory and loops."""
    points = [(p.time, p.T_world_camera, p.tracked) for p in mapper.trajectory]
    loops = [(loop.kind, loop.frame) for loop in mapper.loops]
    surfels = {name: array for name, array in mapper.surfels.numpy().items() if name != "segment"}
    return hash_of(surfels, points, loops)


def labelled() -> Mapper:
    """Noisy labels on keyframes, dark and unreadable frames."""
    arc = frames(26)
    for i in (16, 17):
        arc[i] = Frame(i, arc[i].time, arc[i].rgb, 0 * arc[i].depth)
    labels = LabelConfig(rule="geometric", every=0, keyframe_distance=0.02)
    mapper = Mapper(config(labels=labels), INTRINSICS, GroundTruthSegmenter(0.3))
    for frame in arc:
        mapper.skip(frame.time) if frame.index == 9 else mapper.step(frame)
    return mapper


def loop() -> Mapper:
    """A turn through a room, drift, a way back, a loop."""
    mapper = loop_room.mapper()
    for step in range(loop_room.AWAY):
        mapper.step(loop_room.frame(step, step))
    loop_room.drift(mapper, loop_room.DRIFT, first=20)
    for k in range(46):
        mapper.step(loop_room.frame(loop_room.AWAY + k, loop_room.AWAY - 1 - k))
    return mapper


def moving() -> Mapper:
    """A box slides through the picture, in noisy depth."""
    rng = np.random.default_rng(3)
    mapper = Mapper(config(), moving_scene.INTRINSICS)
    for k in range(30, 62):
        mapper.step(moving_scene.frame(k, moving_scene.slide(k), rng))
    return mapper


def rolling() -> Mapper:
    """A rolling shutter, every frame its own predicted view, labels of each third frame."""
    labels = LabelConfig(rule="bayes", every=3)
    mapper = Mapper(config(readout_s=0.02, labels=labels), INTRINSICS, GroundTruthSegmenter(0.1, "blobs"))
    for frame in frames(20, 0.01):
        mapper.step(frame)
    return mapper


def given() -> Mapper:
    """Poses that are given, one of them missing."""
    mapper = Mapper(config(poses="given"), INTRINSICS)
    for frame in frames(12):
        mapper.step(dataclasses.replace(frame, T_world_camera=None) if frame.index == 5 else frame)
    return mapper


def lost() -> Mapper:
    """A leap out of the map and back into it: keyframes find the camera."""
    mapper = loop_room.mapper(window=200)
    for i, step in enumerate([*range(30), *np.arange(80, 84), *np.arange(20.4, 8, -0.9)]):
        mapper.step(loop_room.frame(i, float(step)))
    return mapper


MAPS: dict[str, Callable[[], Mapper]] = {
    "labelled": labelled, "loop": loop, "moving": moving, "rolling": rolling, "given": given, "lost": lost,
}  # fmt: skip


def hash_of_scene(scene: Scene) -> str:
    """Of all that is rendered and of where it stands."""
    parts = [(p.shape, p.material, p.label, p.instance, p.body) for p in scene.parts]
    pieces = [(p.name, p.room, p.instance, p.T_world_piece) for p in scene.pieces]
    rest = (
        scene.materials,
        scene.lights,
        scene.ambient,
        scene.targets,
        scene.rooms,
        scene.doors,
        scene.bodies,
    )
    return hash_of(parts, pieces, *rest)


def hash_of_room(kind: str, seed: int) -> str:
    return hash_of_scene(build_scene(kind, seed))


def stated() -> dict[str, Any]:
    return json.loads(STATED.read_text())


def small_frame(index: int) -> Frame:
    """A frame of the old RUN's recording: a slow arc along the textured corner, 64x48."""
    T = exp_se3(np.array([0.008 * index, 0.002 * index, 0, 0, -0.006 * index, 0]))
    rgb, depth = wall_corner.room(T)
    rows, columns = np.linspace(0, 71, 48).astype(int), np.linspace(0, 95, 64).astype(int)
    label = np.where(np.arange(48)[:, None] < 26, 12, 5) * np.ones((48, 64))
    return Frame(index, index / 30, rgb[rows][:, columns], depth[rows][:, columns], T, label.astype(np.uint8))


def record_small(path: Path) -> Path:
    """The recording of the old RUN."""
    with SequenceWriter(path, _SMALL, depth_max=6.0) as writer:
        for i in range(ALL_FRAMES):
            f = small_frame(i)
            writer.write(f.time, f.rgb, f.depth, T_world_camera=f.T_world_camera, label=f.label)
    return path


def write_old_run(folder: Path) -> None:
    """Map the first frames of the small recording and pack the RUN."""
    from dsmap.tools.cli import run

    argv = [str(record_small(folder / "recording")), "--out", str(folder / "run"), "--stop", str(OLD_FRAMES)]
    flags = ["--segmenter", "labels", "--label-noise", "0.2", "--device", "cpu", "--no-pictures"]
    assert run("map", [*argv, *flags]) == 0
    with lzma.open(OLD_RUN, "wb", preset=9) as out, tarfile.open(fileobj=out, mode="w") as tar:
        tar.add(folder / "run", "run")


def unpack_old_run(folder: Path) -> Path:
    with lzma.open(OLD_RUN, "rb") as file, tarfile.open(fileobj=file) as tar:
        tar.extractall(folder, filter="data")
    return folder / "run"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--write-run", type=Path)
    args = parser.parse_args()
    if args.write_run:
        write_old_run(args.write_run)
        return 0
    found = {
        "machine": machine(),
        "maps": {name: hash_of_map(make()) for name, make in MAPS.items()},
        "rooms": {f"{kind} {seed}": hash_of_room(kind, seed) for kind in SCENES for seed in SEEDS},
    }
    if args.write:
        STATED.write_text(json.dumps(found, indent=1) + "\n")
    old = stated()
    for group in ("maps", "rooms"):
        for name, value in found[group].items():
            if old[group].get(name) != value:
                print(f"{group} {name}: {value}, stated {old[group].get(name)}")
    print("same" if found == old else "different")
    return int(found != old)


if __name__ == "__main__":
    sys.exit(main())
