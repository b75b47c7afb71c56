"""Reading a RUN folder back, and pairing its frames with a reference recording."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.fusion.config import MapConfig
from dsmap.fusion.labels.gravity import MapGravity
from dsmap.fusion.runs.checkpoint import load_map
from dsmap.fusion.state import part_of
from dsmap.kernels.types import SurfelMap
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
    tracked: np.ndarray
    """bool, shape (M,)."""
    gravity: MapGravity
    """Up and the floor of the map."""
    settings: dict[str, Any]
    """config.yaml: `sequence`, `map`, `segmenter`; empty if there is none."""
    stats: dict[str, Any]
    """stats.json; empty if there is none."""
    loops: list[dict[str, Any]] | None
    """loops.json: every loop that was closed (see `fusion.evaluate.loops`); None if there is none."""


def load_run(path: Path | str, device: Any = "cpu") -> SavedRun:
    """Read a RUN folder.

    Raises:
        InputError: no checkpoint of dsmap is there, or a file is damaged.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; expected a RUN folder that `dsmap map` wrote")
    surfels, meta = load_map(folder / "checkpoint.safetensors", device)
    first = meta["plain"]["first_frame"]  # frames before belong to an earlier recording
    times, poses, tracked = (meta[name][first:] for name in ("times", "poses", "tracked"))
    gravity = MapGravity(Intrinsics(**meta["intrinsics"]), meta["config"].camera_up)
    gravity.load_state(part_of(meta["arrays"], "gravity."))
    return SavedRun(
        folder, surfels, meta["config"], times, poses, tracked.astype(bool), gravity,
        settings=_read(folder / "config.yaml", yaml.safe_load, yaml.YAMLError),
        stats=_read(folder / "stats.json", json.loads, json.JSONDecodeError),
        loops=_read(folder / "loops.json", json.loads, json.JSONDecodeError).get("loops"),
    )  # fmt: skip


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


def _read(path: Path, parse: Any, failure: type[Exception]) -> dict[str, Any]:
    if not path.exists():
        return {}
    try:
        content = parse(path.read_text())
    except (OSError, UnicodeDecodeError, failure) as error:
        raise InputError(
            f"{path}: damaged ({str(error).splitlines()[0]}), expected what `dsmap map` wrote"
        ) from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: found {type(content).__name__}, expected what `dsmap map` wrote")
    return content
