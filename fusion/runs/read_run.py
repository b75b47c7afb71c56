"""Reading a RUN folder back, and pairing its frames with a reference recording."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.fusion.config import MapConfig
from dsmap.fusion.labels.gravity import MapGravity
from dsmap.fusion.runs.checkpoint import load_map
from dsmap.fusion.runs.checkpoint_schema import saved_camera
from dsmap.fusion.state import part_of
from dsmap.fusion.trajectory import Trajectory, at_colour_stamps
from dsmap.kernels.label import posterior
from dsmap.kernels.types import SurfelMap
from dsmap.plain import brief, read_json, read_yaml
from dsmap.reading import reading
from dsmap.sequences import Sequence
from dsmap.sequences.associate import associate


@dataclass
class SavedRun:
    """What `dsmap map` left behind."""

    path: Path
    surfels: SurfelMap
    config: MapConfig
    times: np.ndarray
    """Stamps of the frames [s], shape (M,)."""
    poses: np.ndarray
    """Estimated T_world_camera, shape (M, 4, 4); a lost frame carries the last pose."""
    colour_poses: np.ndarray
    """The same at the stamps of the colour images (see `at_colour_stamps`), shape (M, 4, 4)."""
    tracked: np.ndarray
    """bool, shape (M,)."""
    intrinsics: Intrinsics
    """The camera of the frames that were mapped."""
    gravity: MapGravity
    """Up and the floor of the map."""
    settings: dict[str, Any]
    """config.yaml: `sequence`, `map`, `segmenter`; empty if there is none."""
    stats: dict[str, Any]
    """stats.json; empty if there is none."""
    loops: list[dict[str, Any]] | None
    """loops.json: every loop that was closed (see `fusion.evaluate.loops`); None if there is none."""

    def probabilities(self) -> np.ndarray:
        """Class probabilities of every surfel as the run fused them, shape (N, 13), uniform if unlabelled."""
        labels = self.config.labels
        return posterior(self.surfels, labels.rule, temperature=labels.posterior_temperature)


def load_run(path: Path | str, device: Any = "cpu", measured: bool = False) -> SavedRun:
    """Read a RUN folder.

    Args:
        measured: labels as fusion left them, not as refined (see `load_map`).

    Raises:
        InputError: no checkpoint of dsmap is there, or a file is damaged.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; expected a RUN folder that `dsmap map` wrote")
    surfels, meta = load_map(folder / "checkpoint.safetensors", device, measured)
    first = meta["plain"]["first_frame"]  # frames before belong to an earlier recording
    times, poses, tracked = (meta[name][first:] for name in ("times", "poses", "tracked"))
    points = Trajectory.of_arrays(times, poses, tracked, meta["depth_times"][first:])
    intrinsics = saved_camera(folder, meta["intrinsics"])
    gravity = MapGravity(intrinsics, meta["config"].camera_up)
    with reading(folder / "checkpoint.safetensors", _EXPECTED):
        gravity.load_state(part_of(meta["arrays"], "gravity."))
    settings = _read(folder / "config.yaml", read_yaml)
    for part in ("sequence", "map", "segmenter"):
        if not isinstance(settings.get(part, {}), dict):
            raise InputError(
                f"{folder / 'config.yaml'}: found {part} {brief(settings[part])}, expected {_EXPECTED}"
            )
    recording = settings.get("sequence", {})
    odd = next((key for key in _TEXTS if not isinstance(recording.get(key), str | None)), None)
    if odd is not None:
        raise InputError(
            f"{folder / 'config.yaml'}: found {odd} {brief(recording[odd])}, expected {_EXPECTED}"
        )
    loops = _read(folder / "loops.json", read_json).get("loops")
    if loops is not None and not (isinstance(loops, list) and all(map(_is_loop, loops))):
        raise InputError(f"{folder / 'loops.json'}: found {brief(loops)}, expected {_EXPECTED}")
    stats = _read(folder / "stats.json", read_json)
    return SavedRun(
        folder, surfels, meta["config"], times, poses, at_colour_stamps(points), tracked.astype(bool), intrinsics,
        gravity, settings, stats, loops,
    )  # fmt: skip


_EXPECTED = "what `dsmap map` wrote"
_TEXTS = ("path", "pose_convention", "label_map", "color_topic", "depth_topic")
"""What config.yaml says of the recording in words."""


def _is_loop(loop: Any) -> bool:
    if not isinstance(loop, dict) or not isinstance(loop.get("kind", ""), str):
        return False
    return isinstance(loop.get("nodes", 1), int | float)


def pair_frames(run: SavedRun, reference: Sequence) -> list[tuple[int, int]]:
    """Pairs (frame of the run, frame of the reference) by stamp, one-to-one.

    Raises:
        InputError: no two stamps are within 20 ms, so the reference is another recording.
    """
    order = np.argsort(run.times, kind="stable")
    pairs = [(int(order[i]), j) for i, j in associate(run.times[order], reference.times)]
    if not pairs:
        raise InputError(
            f"{reference.path}: none of its {len(reference)} stamps is within 20 ms of the {len(run.times)} "
            f"stamps of {run.path}, expected the recording that was mapped"
        )
    return pairs


def evenly_spread(count: int, most: int) -> list[int]:
    """`most` of the numbers 0 .. count - 1 with even distances, or all of them if there are no more."""
    return [int(i) for i in np.unique(np.linspace(0, count - 1, min(count, most)).astype(int))]


def _read(path: Path, read: Callable[[Path], Any]) -> dict[str, Any]:
    if not os.path.lexists(path):
        return {}
    content = read(path)
    if not isinstance(content, dict):
        raise InputError(f"{path}: found {type(content).__name__}, expected {_EXPECTED}")
    return content
