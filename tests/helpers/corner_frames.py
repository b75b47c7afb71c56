"""A small recording of the textured corner with labels, in memory and on disk."""

from pathlib import Path

import numpy as np

from dsmap.classes import CLASS_NAMES
from dsmap.frame import Frame
from dsmap.fusion.config import MapConfig
from dsmap.fusion.lie import exp_se3
from dsmap.sequences import SequenceWriter
from dsmap.tools.twins.corner import INTRINSICS, room

WALL, FLOOR = CLASS_NAMES.index("wall"), CLASS_NAMES.index("floor")


def frames(count: int, step: float = 0.006) -> list[Frame]:
    """A slow arc through the room."""
    out = []
    for i in range(count):
        T = exp_se3(np.array([step * i, 0.3 * step * i, 0, 0, -0.8 * step * i, 0]))
        rgb, depth = room(T)
        label = np.where(np.arange(72)[:, None] < 40, WALL, FLOOR) * np.ones((72, 96))
        out.append(Frame(i, i / 30, rgb, depth, T, label.astype(np.uint8)))
    return out


FRAMES = frames(14)


def config(**changes) -> MapConfig:
    return MapConfig(depth_max=6.0, **changes)


def record(path: Path, repeat: int = 1) -> Path:
    """The frames of the ray-cast room as a recording on disk."""
    with SequenceWriter(path, INTRINSICS, depth_max=6.0) as writer:
        frames = (FRAMES + FRAMES[::-1]) * repeat if repeat > 1 else FRAMES
        for i, f in enumerate(frames):
            writer.write(i / 30, f.rgb, f.depth, T_world_camera=f.T_world_camera, label=f.label)
    return path
