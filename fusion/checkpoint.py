"""A map on disk: one safetensors file with the surfels, their label evidence, the trajectory, the configuration."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from dsmap.classes import CLASS_NAMES
from dsmap.errors import InputError
from dsmap.files import atomic_path
from dsmap.fusion.config import MapConfig
from dsmap.fusion.mapper import Mapper
from dsmap.kernels.types import ARRAYS, NUM_EVIDENCE, SurfelMap

FORMAT = "dsmap.map/1"
"""Marks our files; the number changes when older programs could not read them."""


def save_map(mapper: Mapper, path: Path | str) -> None:
    """Write everything of a run that a later run or an evaluation needs.

    Tensors: the surfel arrays by name (N rows each), `times` (M,), `poses` T_world_camera (M, 4, 4) and
    `tracked` (M,) of the M frames. Metadata: format, config, intrinsics, classes, frame number.
    """
    tensors = {name: np.ascontiguousarray(array) for name, array in mapper.surfels.numpy().items()}
    points = mapper.trajectory
    tensors["times"] = np.array([p.time for p in points], dtype=np.float64)
    tensors["poses"] = np.array([p.T_world_camera for p in points], dtype=np.float64).reshape(-1, 4, 4)
    tensors["tracked"] = np.array([p.tracked for p in points], dtype=np.uint8)
    metadata = {
        "format": FORMAT,
        "config": json.dumps(dataclasses.asdict(mapper.config)),
        "intrinsics": json.dumps(dataclasses.asdict(mapper.intrinsics)),
        "classes": json.dumps(CLASS_NAMES),
        "time": str(mapper.time),
    }
    with atomic_path(path) as temporary:
        save_file(tensors, temporary, metadata=metadata)


def load_map(path: Path | str, device: Any = "cpu") -> tuple[SurfelMap, dict[str, Any]]:
    """Read a checkpoint.

    Returns:
        The surfels, and a dict of `config` (MapConfig), `intrinsics` (dict), `time` (frame number),
        `times`, `poses`, `tracked` (arrays of the trajectory).

    Raises:
        InputError: there is no such file, it is damaged, or it is not a dsmap map.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(
            f"{path}: no such file; expected a dsmap checkpoint (checkpoint.safetensors of a run)"
        )
    try:
        with safe_open(path, framework="np") as file:
            metadata = file.metadata() or {}
            if metadata.get("format") != FORMAT:
                raise InputError(
                    f"{path}: format is {metadata.get('format', 'not stated')!r}; expected {FORMAT!r}, a dsmap map"
                )
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a dict)
    except (SafetensorError, OSError) as error:
        raise InputError(
            f"{path}: damaged or not a safetensors file ({error}); expected a dsmap checkpoint"
        ) from error
    missing = [name for name in (*ARRAYS, "times", "poses", "tracked") if name not in arrays]
    if missing:
        raise InputError(
            f"{path}: tensors {', '.join(missing)} are missing; expected a whole dsmap checkpoint"
        )
    surfels = _surfels(arrays, path, device)
    meta = {
        "config": config_from_dict(json.loads(metadata["config"])),
        "intrinsics": json.loads(metadata["intrinsics"]),
        "time": int(metadata["time"]),
    }
    return surfels, meta | {name: arrays[name] for name in ("times", "poses", "tracked")}


def config_from_dict(values: dict[str, Any]) -> MapConfig:
    """A MapConfig from the nested dict of `dataclasses.asdict`; absent fields keep their defaults."""
    return _fill(MapConfig(), values)


def _fill(config: Any, values: dict[str, Any]) -> Any:
    known = {field.name: getattr(config, field.name) for field in dataclasses.fields(config)}
    changes = {}
    for name, value in values.items():
        if name not in known:
            raise InputError(f"configuration: unknown parameter {name!r}; expected one of {', '.join(known)}")
        if dataclasses.is_dataclass(known[name]):
            changes[name] = _fill(known[name], value)
        else:
            changes[name] = tuple(value) if isinstance(known[name], tuple) else value
    return dataclasses.replace(config, **changes)


def _surfels(arrays: dict[str, np.ndarray], path: Path, device: Any) -> SurfelMap:
    count = len(arrays["position"])
    surfels = SurfelMap.empty(device, max(count, 1))
    for name in ARRAYS:
        ours, theirs = getattr(surfels, name), arrays[name]
        shape = (count, *ours.numpy().shape[1:])
        if theirs.shape != shape:
            raise InputError(f"{path}: tensor {name} has shape {theirs.shape}; expected {shape}")
        if count:
            wp.copy(
                ours,
                wp.array(theirs, dtype=ours.dtype, device=device),
                count=count * (NUM_EVIDENCE if name == "evidence" else 1),
            )
    surfels.count = count
    return surfels
