"""`dsmap bench-scale`: what a frame costs in maps of different sizes, of which the camera sees the same part.

The frames go through all maps in turn, so that whatever else the machine does falls on all of them alike.
"""

import gc
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from dsmap.errors import InputError
from dsmap.files import write_json
from dsmap.frame import Frame, Intrinsics
from dsmap.fusion.config import MapConfig
from dsmap.fusion.labels.semantics import GroundTruthSegmenter
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.stage_clock import WARM_UP
from dsmap.kernels.launch import all_blocks
from dsmap.kernels.types import SurfelMap
from dsmap.ranges import Range
from dsmap.tools.support.parse import parse_size

ROOM = np.array([4.0, 4.0, 2.6])
"""Inner size of a room [m]; the rooms of a large map stand wall to wall, four storeys high."""
STILL = 15
"""Frames that map the part in view before anything is timed."""


@dataclass
class Args:
    surfels: str = "0.1,1,5,10"
    """Sizes of the maps [million surfels], comma-separated; the first is what the others are compared with."""
    frames: Annotated[int, Range(1, 1_000_000)] = 60
    """Frames that are timed, after the first five."""
    size: str = "320x240"
    """WxH of the camera."""
    walk: bool = False
    """Walk every surfel in every kernel, for comparison."""
    device: str = "cpu"
    """Where the kernels run: cpu or cuda:0."""
    out: Path = Path("bench_scale.json")
    """File for all figures."""


_MOST = 100_000_000
"""Surfels of a map."""


def main(args: Args) -> int:
    """Build the maps, time the frames, print the table, write the file."""
    try:
        counts = [int(1e6 * float(text)) for text in args.surfels.split(",")]
    except (ValueError, OverflowError):
        counts = []
    if not counts or not 1 <= min(counts) <= max(counts) <= _MOST:
        raise InputError(
            f"--surfels is {args.surfels!r}; expected positive numbers (millions, at most 100) with commas between"
        )
    if args.frames < 1:
        raise InputError(f"--frames is {args.frames}; expected at least 1")
    report = measure(counts, args.frames, parse_size(args.size) or (320, 240), args.device, args.walk)
    write_json(args.out, report)
    print(scale_table(report))
    print(f"written to {args.out}")
    return 0


def measure(counts: list[int], frames: int, size: tuple[int, int], device: str, walk: bool) -> dict[str, Any]:
    """Time `frames` frames in maps of about `counts` surfels; plain numbers."""
    width, height = size
    intrinsics = Intrinsics(width, height, 0.85 * width, 0.85 * width, width / 2 - 0.5, height / 2 - 0.5)
    seen = [room_frame(intrinsics, number) for number in range(STILL + WARM_UP + frames)]
    mappers = [Mapper(MapConfig(device=device), intrinsics, GroundTruthSegmenter()) for _ in counts]
    for mapper in mappers:
        for frame in seen[:STILL]:
            mapper.step(frame)
    rooms = whole_room(intrinsics, device)
    mappers = [in_larger_map(m, surround(m.surfels, rooms, n)) for m, n in zip(mappers, counts, strict=True)]
    for mapper in mappers if walk else ():
        walk_everything(mapper)
    gc.collect()
    frame_ms: list[list[float]] = [[] for _ in counts]
    stages_ms: list[dict[str, list[float]]] = [{} for _ in counts]
    for frame in seen[STILL:]:
        for mapper, times, stages in zip(mappers, frame_ms, stages_ms, strict=True):
            start = time.perf_counter()
            result = mapper.step(frame)
            times.append(1000 * (time.perf_counter() - start))
            for name, ms in result.stages_ms.items():
                stages.setdefault(name, []).append(ms)
    measured = zip(mappers, frame_ms, stages_ms, strict=True)
    maps = [_figures(mapper, ms[WARM_UP:], stages) for mapper, ms, stages in measured]
    return {"size": list(size), "frames": frames, "walk": walk, "device": device, "maps": maps}


def in_larger_map(mapper: Mapper, surfels: SurfelMap) -> Mapper:
    """A mapper that goes on where another is, in a larger map around the same surfels."""
    other = Mapper(mapper.config, mapper.intrinsics, mapper.segmenter, surfels=surfels)
    other.load_state(mapper.state() | {"sweep": [0, 0]}, mapper.trajectory)
    return other


def walk_everything(mapper: Mapper) -> None:
    """Make a mapper take every surfel for visible, in every kernel."""
    model = mapper.model
    model.views.visible = lambda T_world_camera, t_max=None: all_blocks(model.surfels.count, model.device)


def room_frame(intrinsics: Intrinsics, number: int, turn: float | None = None) -> Frame:
    """Frame of a camera that sways in front of a wall, with a Kinect's depth noise; `turn` [rad] looks elsewhere."""
    T = np.eye(4)
    angle = 0.02 * np.sin(number / 9) if turn is None else turn
    forward, down = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([0.0, 0.0, -1.0])
    T[:3, :3] = np.stack([np.cross(down, forward), down, forward], axis=1)
    T[:3, 3] = [0.02 * np.sin(number / 7), 0.02 * np.cos(number / 11), 1.3]
    y, x = np.mgrid[: intrinsics.height, : intrinsics.width]
    view = np.stack(
        [(x - intrinsics.cx) / intrinsics.fx, (y - intrinsics.cy) / intrinsics.fy, np.ones(x.shape)], axis=-1
    )
    d = view @ T[:3, :3].T
    low, high = np.array([-ROOM[0] / 2, -ROOM[1] / 2, 0.0]), np.array([ROOM[0] / 2, ROOM[1] / 2, ROOM[2]])
    with np.errstate(divide="ignore"):
        exits = np.where(d > 0, (high - T[:3, 3]) / d, (low - T[:3, 3]) / d)
    depth = exits.min(axis=-1)
    p = T[:3, 3] + depth[..., None] * d
    light = 0.5 + 0.2 * np.sin(9 * p[..., 0] + 1) * np.cos(8 * p[..., 1]) + 0.15 * np.sin(11 * p[..., 2])
    rgb = np.repeat((255 * light)[..., None], 3, axis=-1).astype(np.uint8)
    depth += np.random.default_rng(number).normal(0, 0.0012, depth.shape) * depth**2
    label = np.where(exits.argmin(axis=-1) == 2, 5, 12).astype(np.uint8)
    return Frame(number, number / 30, rgb, depth.astype(np.float32), T, label)


def whole_room(intrinsics: Intrinsics, device: str) -> dict[str, np.ndarray]:
    """Stable surfels of a whole room, as a turn of the camera maps it, by array name."""
    mapper = Mapper(MapConfig(device=device, poses="given"), intrinsics)
    for number, turn in enumerate(np.linspace(0, 2 * np.pi, 24, endpoint=False)):
        mapper.step(room_frame(intrinsics, number, turn))
    arrays = mapper.surfels.numpy()
    alive = arrays["weight"] > 0
    arrays = {name: array[alive] for name, array in arrays.items()}
    arrays["weight"][:] = 30.0
    return arrays


def surround(seen: SurfelMap, room: dict[str, np.ndarray], count: int) -> SurfelMap:
    """The part in view amid other rooms, mapped before and after it, `count` surfels in all."""
    size = len(room["weight"])
    extra = max(count - seen.count, 0)
    result = SurfelMap.empty(seen.device)
    result.reserve(int(1.05 * (seen.count + extra)))
    result.count = seen.count + extra
    side = int(np.ceil(np.sqrt(extra / size / 4))) + 1
    arrays = {name: array.copy() for name, array in result.numpy().items()}
    for name, array in seen.numpy().items():
        arrays[name][extra // 2 : extra // 2 + seen.count] = array
    spaces = [(0, extra // 2), (extra // 2 + seen.count, result.count)]
    places = iter([(x, y, z) for x in range(-side, side) for y in range(-side, side) for z in range(4)
                   if (x, y, z) != (0, 0, 0)])  # fmt: skip
    for first, last in spaces:
        for at in range(first, last, size):
            rows = slice(at, min(at + size, last))
            for name, array in room.items():
                arrays[name][rows] = array[: rows.stop - at]
            arrays["position"][rows] += (ROOM * next(places)).astype(np.float32)
    for name, array in arrays.items():
        source = getattr(result, name)
        source.assign(
            np.concatenate([array, np.zeros((source.shape[0] - len(array), *array.shape[1:]), array.dtype)])
        )
    return result


def _figures(mapper: Mapper, frame_ms: list[float], stages_ms: dict[str, list[float]]) -> dict[str, Any]:
    m = mapper.surfels
    arrays = m.numpy()
    start = time.perf_counter()
    m.reserve(m.capacity + 1)
    grown_ms = 1000 * (time.perf_counter() - start)
    return {
        "surfels": m.count,
        "in_view_blocks": len(mapper.model.views.visible(mapper.T_world_camera))
        / len(all_blocks(m.count, "cpu")),
        "median_ms": float(np.median(frame_ms)),
        "p95_ms": float(np.percentile(frame_ms, 95)),
        "max_ms": float(np.max(frame_ms)),
        "growth_ms": grown_ms,
        "bytes_per_surfel": sum(array.nbytes for array in arrays.values()) / m.count,
        "culling_bytes_per_surfel": mapper.model.blocks.nbytes / m.capacity,
        "tracked": int(mapper.trajectory.tracked[-len(frame_ms) :].sum()),
        "stages_ms": {name: float(np.median(ms[WARM_UP:])) for name, ms in stages_ms.items()},
    }


def scale_table(report: dict[str, Any]) -> str:
    """The report as text."""
    maps = report["maps"]
    first = maps[0]["median_ms"]
    lines = [
        f"{report['frames']} frames of {report['size'][0]}x{report['size'][1]}, the same view in every map, "
        + ("every surfel walked" if report["walk"] else "culled"),
        f"{'surfels':>10} {'walked':>8} {'median [ms]':>12} {'p95':>8} {'max':>8} {'ratio':>6} {'growing [ms]':>13} "
        f"{'B/surfel':>9}",
    ]
    for row in maps:
        size = row["bytes_per_surfel"] + row["culling_bytes_per_surfel"]
        lines.append(
            f"{row['surfels']:10} {row['in_view_blocks']:8.1%} {row['median_ms']:12.2f} {row['p95_ms']:8.2f} "
            f"{row['max_ms']:8.2f} {row['median_ms'] / first:6.2f} {row['growth_ms']:13.0f} {size:9.1f}"
        )
    lines += ["", f"{'stage [ms]':<12}" + "".join(f"{row['surfels'] / 1e6:9.2f}M" for row in maps)]
    for name in maps[0]["stages_ms"]:
        lines.append(f"{name:<12}" + "".join(f"{row['stages_ms'].get(name, 0.0):10.2f}" for row in maps))
    return "\n".join(lines)
