"""From a recording to windows of frames for bundle adjustment."""

from collections.abc import Iterator

import cv2
import numpy as np

from dsmap.errors import InputError
from dsmap.fusion.calibration.bundle import Window
from dsmap.fusion.calibration.depth_planes import depth_planes
from dsmap.fusion.calibration.features import follow
from dsmap.fusion.calibration.rig import Cameras
from dsmap.fusion.calibration.start import start_window
from dsmap.sequences import Sequence
from dsmap.sequences.base import Entry
from dsmap.sequences.images import check_size, read_colour, read_depth

LENGTH = 45
"""Frames of a window."""
_GAP = 2.5
"""A window ends where the next frame comes later than this many usual intervals."""


def stretches(times: np.ndarray, frames: int) -> list[range]:
    """Runs of frames that follow one another, evenly spread over the recording, about `frames` in all.

    Args:
        times: stamps [s], shape (N,).
    """
    steps = np.diff(times)
    usual = float(np.median(steps)) if len(steps) else 0.0
    holes = np.flatnonzero((steps > _GAP * usual) | (steps <= 0)) + 1
    whole: list[range] = []
    for first, end in zip([0, *holes], [*holes, len(times)], strict=True):
        pieces = max(round((end - first) / LENGTH), 1)
        edges = np.linspace(first, end, pieces + 1).astype(int)
        whole += [range(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True) if b - a >= LENGTH // 3]
    count = max(round(frames / LENGTH), 1)
    if len(whole) <= count:
        return whole
    return [whole[i] for i in np.linspace(0, len(whole) - 1, count).round().astype(int)]


def windows_of(sequence: Sequence, cameras: Cameras, frames: int) -> Iterator[Window]:
    """Windows of a recording that could be started; frames that do not decode end theirs."""
    for stretch in stretches(sequence.times, frames):
        if (window := _window(sequence, stretch, cameras)) is not None:
            yield window


def _window(sequence: Sequence, stretch: range, cameras: Cameras) -> Window | None:
    greys, planes = [], []
    camera, calibration = cameras.colour, sequence.calibration
    for i in stretch:
        entry = sequence.entries[i]
        try:
            rgb = read_colour(entry.rgb)
            check_size(entry.rgb, rgb, camera.width, camera.height)
            depth = read_depth(entry.depth, sequence.depth_scale)
            check_size(entry.depth, depth, cameras.depth.width, cameras.depth.height)
        except InputError:
            break  # what follows is a hole's length later
        greys.append(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY))
        planes.append(depth_planes(depth, calibration.depth_max))
    if len(greys) < LENGTH // 3:
        return None
    entries = [sequence.entries[i] for i in stretch[: len(greys)]]
    times = np.array([entry.time for entry in entries])
    depth_after = np.array([entry.pose_time for entry in entries]) - times
    return start_window(times, depth_after, np.array(planes), follow(greys), cameras, _centres(entries))


def _centres(entries: list[Entry]) -> np.ndarray | None:
    """Where given poses have the camera, shape (F, 3), NaN where a frame has none; None where no frame has one."""
    nowhere = np.full(3, np.nan)
    found = [nowhere if e.T_world_camera is None else e.T_world_camera[:3, 3] for e in entries]
    return None if np.isnan(found).all() else np.array(found)
