"""What a mapper carries from one frame to the next besides the surfels and the trajectory."""

import dataclasses
from typing import Any

import numpy as np
import warp as wp

from dsmap.errors import InputError
from dsmap.fusion.loops.record import LoopRecord
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.places.ferns import FernDatabase
from dsmap.fusion.trajectory import TrajectoryPoint
from dsmap.kernels.types import SurfelMap

METADATA = "state"
"""Key of the plain values in a checkpoint's metadata."""
_VIEW = ("vertex", "normal", "colour")
_FERNS, _STAGE, _MOVING, _MOTION, GRAVITY = "ferns.", "stage.", "moving.", "motion.", "gravity."


def mapper_state(mapper: Mapper) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """The state as (arrays by name, plain values that JSON can hold)."""
    arrays: dict[str, np.ndarray] = {"T_world_camera": mapper.T_world_camera}
    plain: dict[str, Any] = {
        "time": mapper.time,
        "first_frame": mapper.first_frame,
        "last_fused": mapper.last_fused,
        "view_t_active": mapper.view_t_active,
        "schedule_frames": mapper.schedule.frames,
        "sweep": list(mapper.sweep.cursor),
    }
    if mapper.view is not None:
        arrays["view.T_world_camera"] = mapper.view.T_world_camera
        arrays |= {f"view.{name}": getattr(mapper.maps, name).numpy() for name in _VIEW}
    if mapper.tracker.last_coarse is not None:
        arrays["tracker.intensity"] = mapper.tracker.last_coarse[0][0].numpy()
    if mapper.schedule.last is not None:
        arrays["schedule.last"] = mapper.schedule.last
    arrays |= {_MOVING + name: array for name, array in mapper.moving.state().items()}
    arrays |= {_MOTION + name: array for name, array in mapper.motion.state().items()}
    arrays |= {GRAVITY + name: array for name, array in mapper.gravity.state().items()}
    arrays |= {_STAGE + name: np.array(ms, dtype=np.float64) for name, ms in mapper.stages_ms.items()}
    closer = mapper.closer
    if closer is not None:
        arrays |= {_FERNS + name: array for name, array in closer.ferns.state().items()}
        arrays |= {"closed.points": closer.closed.points, "closed.times": closer.closed.times}
        plain |= {"verified": closer.verified, "refused": closer.refused}
        plain["sightings"] = [[time, T.tolist()] for time, T in closer.sightings.seen]
        plain["loops"] = [record_values(record) for record in closer.records]
    return arrays, plain


def record_values(record: LoopRecord) -> dict[str, Any]:
    """A loop as plain values: an entry of loops.json."""
    values = dataclasses.asdict(record)
    return {name: v.tolist() if isinstance(v, np.ndarray | np.generic) else v for name, v in values.items()}


def restore(mapper: Mapper, surfels: SurfelMap, meta: dict[str, Any], where: str) -> None:
    """Put a fresh mapper of the same configuration and camera where the saved one stopped, bit for bit.

    Args:
        surfels, meta: of `checkpoint.load_map`.
        where: the file, for messages.

    Raises:
        InputError: the checkpoint lacks a part of the state, or its images have another size.
    """
    arrays, plain = meta["arrays"], meta["plain"]
    try:
        _restore_map(mapper, surfels, meta)
        mapper.first_frame = plain["first_frame"]
        mapper.last_fused, mapper.view_t_active = plain["last_fused"], plain["view_t_active"]
        mapper.sweep.cursor = tuple(plain["sweep"])
        mapper.schedule.frames = plain["schedule_frames"]
        mapper.schedule.last = arrays.get("schedule.last")
        for name, array in part_of(arrays, _STAGE).items():
            mapper.stages_ms[name] = array.tolist()
        if "view.T_world_camera" in arrays:
            for name in _VIEW:
                getattr(mapper.maps, name).assign(arrays[f"view.{name}"])
            mapper.view = mapper.views.pyramid(arrays["view.T_world_camera"], mapper.maps)
        if "tracker.intensity" in arrays:
            intensity = wp.array(arrays["tracker.intensity"], dtype=wp.float32, device=mapper.device)
            mapper.tracker.remember(intensity)
        mapper.moving.set_state(part_of(arrays, _MOVING))
        mapper.motion.set_state(part_of(arrays, _MOTION))
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise InputError(f"{where}: does not fit ({error}); expected a whole dsmap checkpoint") from error


def enter(mapper: Mapper, surfels: SurfelMap, meta: dict[str, Any], where: str) -> None:
    """Let a fresh mapper start in a saved map: its first frame has to be found there by the keyframes.

    The saved frames keep their numbers; `mapper.first_frame` is the first of the new recording.

    Raises:
        InputError: the map has no keyframes, or they were taken with a camera of another shape.
    """
    if mapper.closer is None or not len(meta["arrays"].get(_FERNS + "codes", ())):
        raise InputError(f"{where}: this map has no keyframes; expected one that was made with --loops on")
    theirs = meta["arrays"][_FERNS + "rgb"].shape[1:3]
    if theirs != mapper.closer.ferns.size:
        ours = mapper.closer.ferns.size
        raise InputError(
            f"{where}: its keyframes are {theirs[1]}x{theirs[0]}, those of this recording {ours[1]}x{ours[0]}; "
            "expected images of the same aspect ratio"
        )
    try:
        _restore_map(mapper, surfels, meta)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise InputError(f"{where}: does not fit ({error}); expected a whole dsmap checkpoint") from error
    mapper.first_frame, mapper.last_fused = mapper.time, meta["plain"]["last_fused"]


def _restore_map(mapper: Mapper, surfels: SurfelMap, meta: dict[str, Any]) -> None:
    """Surfels, keyframes, loops, trajectory, frame number."""
    arrays, plain = meta["arrays"], meta["plain"]
    mapper.adopt(surfels)
    mapper.gravity.load_state(part_of(arrays, GRAVITY))
    points = zip(meta["times"], meta["poses"], meta["tracked"], meta["depth_times"], strict=True)
    mapper.trajectory[:] = [
        TrajectoryPoint(float(time), T, bool(tracked), None if np.isnan(depth_time) else float(depth_time))
        for time, T, tracked, depth_time in points
    ]
    mapper.time, mapper.T_world_camera = plain["time"], arrays["T_world_camera"]
    closer = mapper.closer
    if closer is None:
        return
    closer.ferns = FernDatabase.from_state(mapper.config.ferns, closer.ferns.size, part_of(arrays, _FERNS))
    closer.closed.points, closer.closed.times = arrays["closed.points"], arrays["closed.times"]
    closer.verified, closer.refused = plain["verified"], plain["refused"]
    closer.sightings.seen = [(time, np.array(T)) for time, T in plain.get("sightings", [])]
    closer.records[:] = [
        LoopRecord(**values | {"T_destination_frame": np.array(values["T_destination_frame"])})
        for values in plain["loops"]
    ]


def part_of(arrays: dict[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    """The arrays whose names begin with a prefix, without it."""
    return {name.removeprefix(prefix): a for name, a in arrays.items() if name.startswith(prefix)}
