"""A map on disk: one safetensors file with all that a run needs to go on bit for bit where it stopped."""

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError, safe_open

from dsmap.classes import CLASS_NAMES
from dsmap.config_file import fill
from dsmap.errors import InputError
from dsmap.fusion.config import MapConfig
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.runs.checkpoint_schema import check_arrays, check_words
from dsmap.kernels.types import ARRAYS, SurfelMap
from dsmap.plain import parse_json
from dsmap.reading import reading
from dsmap.sealed import read_words
from dsmap.tensor_files import write_tensors

FORMAT = "dsmap.map/3"
"""Marks our files; the number changes when older programs could not read them, or we theirs."""
_OLDER = ("dsmap.map/2",)
"""The same without a checksum."""
_EXPECTED = "a whole dsmap checkpoint (checkpoint.safetensors of a run)"
_TRAJECTORY = ("times", "poses", "tracked")
MEASURED = "measured."
"""Prefix of label arrays as fusion left them, where those of the surfels are refined."""
_METADATA = ("config", "intrinsics", "time", "state", "run")


def save_map(
    mapper: Mapper,
    path: Path | str,
    run: dict[str, Any] | None = None,
    measured: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Write everything of a run that a later run or an evaluation needs; the file is whole or absent.

    Tensors: the surfel arrays by name (N rows each), `times` (M,), `depth_times` (M,), NaN where they
    are the same, `poses` T_world_camera (M, 4, 4) and `tracked` (M,) of the M frames, and `state.*` of
    `Mapper.state`. Metadata: format, config, intrinsics, classes, frame number `time`, the state's plain values,
    and `run`: whatever the caller wants back.

    Args:
        measured: of `refine.refine_map`, if the labels are refined: who goes on mapping goes on with these.
    """
    points = mapper.trajectory
    state = mapper.state()
    arrays = {name: value for name, value in state.items() if isinstance(value, np.ndarray)}
    plain = {name: value for name, value in state.items() if name not in arrays}
    tensors = dict(mapper.surfels.numpy()) | {
        "times": points.times,
        "poses": points.poses,
        "tracked": points.tracked.astype(np.uint8),
        "depth_times": points.depth_times,
    }
    tensors |= {f"state.{name}": array for name, array in arrays.items()}
    tensors |= {MEASURED + name: array for name, array in (measured or {}).items()}
    metadata = {
        "format": FORMAT,
        "config": json.dumps(dataclasses.asdict(mapper.config)),
        "intrinsics": json.dumps(dataclasses.asdict(mapper.intrinsics)),
        "classes": json.dumps(CLASS_NAMES),
        "time": str(mapper.time),
        "state": json.dumps(plain),
        "run": json.dumps(run or {}),
    }
    write_tensors(path, tensors, metadata, durable=True)


def rewrite_map(
    source: Path | str, target: Path | str, surfels: SurfelMap, measured: Mapping[str, np.ndarray]
) -> None:
    """Write a checkpoint again with the surfels as they are now; the rest of it stays, byte for byte.

    Args:
        measured: as in `save_map`.

    Raises:
        InputError: the source is missing, damaged or not a dsmap map of this version.
        WriteError: the target cannot be written.
    """
    arrays, metadata = _read_text(Path(source), with_arrays=True)
    kept = {MEASURED + name: array for name, array in measured.items()}
    write_tensors(target, arrays | dict(surfels.numpy()) | kept, metadata | {"format": FORMAT}, durable=True)


def read_metadata(path: Path | str) -> dict[str, Any]:
    """The plain values of a checkpoint: `config`, `intrinsics`, `time`, `state`, `run`; reads no arrays.

    Raises:
        InputError: there is no such file, it is damaged, or it is not a dsmap map of this version.
    """
    return _read(Path(path), with_arrays=False)[1]


def load_map(
    path: Path | str, device: Any = "cpu", measured: bool = False
) -> tuple[SurfelMap, dict[str, Any]]:
    """Read a checkpoint.

    Args:
        measured: give the labels as fusion left them, for who goes on mapping; else as refined, if they are.

    Returns:
        The surfels, and a dict of `config` (MapConfig), `intrinsics` (dict), `time` (frame number),
        `times`, `poses`, `tracked`, `depth_times` (arrays of the trajectory), `arrays` and `plain` (the state for
        `resume.resumed_mapper`), `run` and `measured` (what was given to `save_map`; empty without).

    Raises:
        InputError: there is no such file, it is damaged, or it is not a dsmap map of this version.
    """
    arrays, meta = _read(Path(path), with_arrays=True)
    arrays.setdefault("segment", np.zeros(len(arrays.get("weight", ())), np.int32))  # older files
    missing = [name for name in (*ARRAYS, *_TRAJECTORY) if name not in arrays]
    if missing:
        raise InputError(
            f"{path}: tensors {', '.join(missing)} are missing; expected a whole dsmap checkpoint"
        )
    arrays.setdefault("depth_times", np.full(len(arrays["times"]), np.nan))  # older files
    check_arrays(path, arrays)
    check_words(path, meta, len(arrays["times"]), len(arrays["position"]))
    meta["measured"] = {n.removeprefix(MEASURED): a for n, a in arrays.items() if n.startswith(MEASURED)}
    arrays |= meta["measured"] if measured else {}
    meta["config"] = fill(MapConfig(), meta["config"], f"{path}: config", strict=False)
    meta["plain"] = meta.pop("state")
    meta["arrays"] = {n.removeprefix("state."): a for n, a in arrays.items() if n.startswith("state.")}
    return surfels_from(arrays, path, device), meta | {
        name: arrays[name] for name in (*_TRAJECTORY, "depth_times")
    }


def _read(path: Path, with_arrays: bool) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Tensors by name, and the metadata as plain values."""
    arrays, words = _read_text(path, with_arrays)
    missing = [name for name in _METADATA if name not in words]
    if missing:
        raise InputError(f"{path}: damaged metadata: no {', '.join(missing)}; expected {_EXPECTED}")
    meta = {
        name: parse_json(words[name], f"{path}: damaged metadata {name}", _EXPECTED) for name in _METADATA
    }
    if not all(isinstance(meta[name], dict) for name in ("config", "run")):
        raise InputError(f"{path}: damaged metadata; expected {_EXPECTED}")
    return arrays, meta


def _read_text(path: Path, with_arrays: bool) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Tensors by name, and the metadata as it is stored."""
    if not path.is_file():
        raise InputError(f"{path}: no such file; expected {_EXPECTED}")
    words = read_words(path, _EXPECTED, (FORMAT, *_OLDER), with_tensors=with_arrays)
    if not with_arrays:
        return {}, words
    with reading(path, _EXPECTED, SafetensorError), safe_open(path, framework="np") as file:
        return {name: file.get_tensor(name) for name in file.keys()}, words  # noqa: SIM118


def surfels_from(arrays: dict[str, np.ndarray], path: Path | str, device: Any) -> SurfelMap:
    """A SurfelMap on a device from arrays by name.

    Raises:
        InputError: an array is not of the type or length that its name promises.
    """
    count = arrays["position"].shape[0] if arrays["position"].ndim else 0
    surfels = SurfelMap.empty(device, max(count, 1))
    for name in ARRAYS:
        ours, theirs = getattr(surfels, name), arrays[name]
        like = ours.numpy()
        if theirs.shape != (count, *like.shape[1:]) or theirs.dtype != like.dtype:
            raise InputError(
                f"{path}: tensor {name} has {theirs.dtype} of shape {theirs.shape}; "
                f"expected {like.dtype} of {(count, *like.shape[1:])}"
            )
        if count:
            ours[:count].assign(theirs)
    surfels.count = count
    return surfels
