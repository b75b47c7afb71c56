"""What a checkpoint of a map holds, checked before anything is built from it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from dsmap.classes import NUM_CLASSES
from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.plain import brief

_POSE = (4, 4)
_ARRAYS: dict[str, tuple[str, tuple[int | str, ...]]] = {
    "times": ("f", ("frames",)), "depth_times": ("f", ("frames",)), "tracked": ("u", ("frames",)),
    "poses": ("f", ("frames", *_POSE)), "label": ("u", ("surfels",)),
    "state.T_world_camera": ("f", _POSE), "state.schedule.last": ("f", _POSE),
    "state.view.T_world_camera": ("f", _POSE), "state.view.vertex": ("f", ("rows", "columns", 3)),
    "state.view.normal": ("f", ("rows", "columns", 3)), "state.view.colour": ("f", ("rows", "columns", 3)),
    "measured.label": ("u", ("surfels",)), "measured.observations": ("f", ("surfels",)),
    "measured.evidence": ("f", ("surfels", "classes")),
    "state.closed.points": ("f", ("loops", 2, 3)), "state.closed.times": ("i", ("loops", 2)),
    "state.step_covariances": ("f", ("steps", 6, 6)),
    "state.ferns.codes": ("u", ("keyframes", "ferns")), "state.ferns.pixels": ("i", ("ferns", 2)),
    "state.ferns.colour_thresholds": ("f", ("ferns", 3)), "state.ferns.depth_thresholds": ("f", ("ferns",)),
    "state.ferns.rgb": ("u", ("keyframes", "fern rows", "fern columns", 3)),
    "state.ferns.depth_mm": ("u", ("keyframes", "fern rows", "fern columns")),
    "state.ferns.poses": ("f", ("keyframes", *_POSE)), "state.ferns.times": ("i", ("keyframes",)),
    "state.motion.velocity": ("f", (6,)), "state.motion.covariance": ("f", (6, 6)),
    "state.motion.acceleration": ("f", (2,)), "state.motion.learnt": ("i", (1,)),
    "state.moving.rows": ("i", ("remembered",)),
    "state.moving.depths": ("f", ("remembered", "moving rows", "moving columns")),
}  # fmt: skip
"""Name -> kind of number and shape; a word stands for the same number wherever it is."""
_FINITE = ("poses", "times", "state.T_world_camera", "state.view.T_world_camera", "state.ferns.poses",
           "state.closed.points", "state.motion.velocity", "state.motion.covariance")  # fmt: skip
_PLAIN: dict[str, type] = {
    "first_frame": int, "last_fused": int, "view_t_active": int, "schedule_frames": int, "schedule_taken": int,
    "verified": int, "refused": int, "sweep": list, "sightings": list, "loops": list,
}  # fmt: skip
_CAMERA = ("width", "height", "fx", "fy", "cx", "cy")


def check_arrays(path: Path | str, arrays: dict[str, np.ndarray]) -> None:
    """Refuse arrays of other shapes or kinds than their names promise, and numbers that lead beyond what is there.

    Raises:
        InputError: names the tensor.
    """
    sizes: dict[str, tuple[int, str]] = {}
    for name, (kind, shape) in _ARRAYS.items():
        if (array := arrays.get(name)) is None:
            continue
        known = tuple(sizes.get(n, (n, ""))[0] if isinstance(n, str) else n for n in shape)
        fits = array.ndim == len(shape) and all(
            isinstance(n, str) or n == m for n, m in zip(known, array.shape, strict=True)
        )
        if array.dtype.kind != kind or not fits:
            raise InputError(
                f"{path}: tensor {name} has {array.dtype} of shape {array.shape}; expected {_KINDS[kind]} of shape "
                f"({', '.join(map(str, known))}), as a whole dsmap checkpoint has"
            )
        sizes |= {n: (m, name) for n, m in zip(shape, array.shape, strict=True) if isinstance(n, str)}
    _check_numbers(path, arrays)


_KINDS = {"f": "floats", "u": "counts", "i": "whole numbers"}


def _check_numbers(path: Path | str, arrays: dict[str, np.ndarray]) -> None:
    for name in _FINITE:
        if name in arrays and not np.isfinite(arrays[name]).all():
            raise InputError(f"{path}: tensor {name} holds numbers that are none; expected finite ones")
    living = arrays["weight"] > 0 if arrays["weight"].ndim == 1 else np.zeros(0, bool)
    for name in ("position", "normal", "radius"):
        array = arrays[name]
        if len(array) == len(living) and not np.isfinite(array[living]).all():
            raise InputError(f"{path}: tensor {name} holds numbers that are none; expected finite ones")
    frames = len(arrays["times"])
    most: dict[str, Any] = {"label": NUM_CLASSES, "state.moving.rows": frames}
    if "state.ferns.rgb" in arrays:
        rows, columns = arrays["state.ferns.rgb"].shape[1:3]
        most["state.ferns.pixels"] = np.array([rows, columns])
    for name, limit in most.items():
        found = arrays.get(name)
        if found is not None and found.size and ((found < 0) | (found >= limit)).any():
            raise InputError(
                f"{path}: tensor {name} holds {found.max()}; expected numbers below {np.max(limit)}"
            )


def check_words(path: Path | str, meta: dict[str, Any], frames: int, surfels: int) -> None:
    """Refuse plain values of other kinds than their names promise.

    Args:
        meta: `config`, `intrinsics`, `time`, `state`, `run`.
        frames, surfels: how many of each the arrays hold.

    Raises:
        InputError: names the value.
    """

    def need(ok: bool, name: str, value: Any, expected: str) -> None:
        if not ok:
            raise InputError(f"{path}: damaged metadata: {name} is {brief(value)}; expected {expected}")

    for name in ("config", "intrinsics", "state", "run"):
        need(isinstance(meta[name], dict), name, meta[name], "names and values")
    need(_is_whole(meta["time"]) and meta["time"] >= 0, "time", meta["time"], "a number of frames")
    saved_camera(path, meta["intrinsics"])
    state = meta["state"]
    for name, kind in _PLAIN.items():
        value = state.get(name)
        ok = value is None or (_is_whole(value) if kind is int else isinstance(value, kind))
        need(ok, name, value, "a whole number" if kind is int else "a list")
    need("first_frame" in state, "state", state, "first_frame in it")
    first, sweep = state["first_frame"], state.get("sweep", [0, 0])
    need(0 <= first <= frames, "first_frame", first, f"one of {frames} frames")
    need(
        len(sweep) == 2 and all(map(_is_whole, sweep)) and min(sweep) >= 0 and max(sweep) <= surfels,
        "sweep", sweep, f"two rows of {surfels} surfels",
    )  # fmt: skip
    _check_run(need, meta["run"], frames - first)


def _check_run(need: Callable[[bool, str, Any, str], None], run: dict[str, Any], frames: int) -> None:
    if not run:  # written by a Python user
        return
    command, done, skipped = run.get("command", {}), run.get("done", 0), run.get("skipped", [])
    need(isinstance(command, dict), "command", command, "names and values")
    need(_is_whole(done) and done >= 0, "done", done, "a number of frames")
    pairs = isinstance(skipped, list) and all(
        isinstance(s, list) and len(s) == 2 and _is_whole(s[0]) for s in skipped
    )
    need(pairs, "skipped", skipped, "pairs of a frame and a reason")
    wall = run.get("wall_s", 0.0)
    need(
        isinstance(wall, int | float) and not isinstance(wall, bool) and np.isfinite(wall),
        "wall_s",
        wall,
        "seconds",
    )


def saved_camera(path: Path | str, values: dict[str, Any]) -> Intrinsics:
    """The camera of a checkpoint. Raises InputError: it is none."""
    numbers = [values.get(name) for name in _CAMERA]
    distortion = values.get("distortion")
    every = [*numbers, *(distortion if isinstance(distortion, list) else [])]
    if (
        set(values) - {*_CAMERA, "distortion"}
        or not all(isinstance(n, int | float) and not isinstance(n, bool) and np.isfinite(n) for n in every)
        or not all(_is_whole(n) for n in numbers[:2])
        or not (distortion is None or (isinstance(distortion, list) and len(distortion) in (4, 5, 8)))
        or min(numbers[:4]) <= 0  # type: ignore[type-var]
    ):
        raise InputError(
            f"{path}: damaged metadata: intrinsics is {brief(values)}; expected a pinhole camera"
        )
    return Intrinsics(**{**values, "distortion": None if distortion is None else tuple(distortion)})


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) < 1 << 53
