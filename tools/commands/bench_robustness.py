"""`dsmap bench-robustness`: tries to lose the camera in rendered rooms, and counts how often it is found again."""

import dataclasses
import statistics
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from dsmap.errors import InputError
from dsmap.files import write_json
from dsmap.fusion.config import MapConfig
from dsmap.plain import read_json
from dsmap.ranges import Range, Seed
from dsmap.tools.support.parse import parse_size

_PATHS = ("fast", "shake", "cover", "jump")
_USUAL = ("fast", "cover", "jump")


@dataclass
class Args:
    """Options of `dsmap bench-robustness`."""

    out: Path | None = None
    """Write every trial's score to this JSON file; trials that it already holds are not run again."""
    paths: tuple[str, ...] = _USUAL
    """fast = turned at over 120 deg/s for half a second; shake = turned about all axes by up to 250 deg/s; cover = a
    second without depth and colour; jump = put down where it has been before."""
    trials: Annotated[int, Range(1, 100_000)] = 10
    """Trials of each; they go through the kinds of rooms in turn, each with a seed of its own."""
    scenes: tuple[str, ...] = ("living_room", "bedroom", "office", "kitchen")
    """Kinds of rooms."""
    first_seed: Seed = 101
    """Seed of the first trial."""
    frames: Annotated[int, Range(1, 1_000_000)] = 300
    """Frames a trial, at 30 a second."""
    size: str = "320x240"
    """Image size."""
    noise: str = "kinect"
    """Depth sensor to imitate, or none."""
    effects: str = "none"
    """What the colour camera does to its pictures: none, mild, strong (exposure, blur, noise)."""
    readout_s: Annotated[float, Range(-0.1, 0.1)] = 0.0
    """Rolling shutter of colour and depth: time from an image's first row to its last [s] (a Kinect: 0.026). It is
    modelled, unless --config.readout-s says otherwise."""
    config: MapConfig = field(default_factory=lambda: MapConfig(depth_max=8.0))
    """Parameters of the mapper."""


def main(args: Args) -> int:
    """Run the trials, print a line each and the totals; exit code 1 if a kind has fewer than 9 of 10 passed."""
    unknown = [path for path in args.paths if path not in _PATHS]
    if unknown:
        raise InputError(f"unknown path {unknown[0]!r}; expected one of: {', '.join(_PATHS)}")
    done = _read(args.out)
    print(
        f"{'trial':<28} {'lost':>5} {'longest':>8} {'relocalised':>12} {'wrong':>6} {'worst':>8} {'ATE':>8}"
    )
    results: dict[str, Any] = {}
    for path in args.paths:
        for trial in range(args.trials):
            seed = args.first_seed + trial
            name = f"{path} {args.scenes[trial % len(args.scenes)]} {seed}"
            row = done.get(name) or _run(args, path, args.scenes[trial % len(args.scenes)], seed)
            results[name] = row
            print(
                f"{name:<28} {row['lost']:5d} {row['longest_lost_s']:6.2f} s {row['relocalised']:12d} "
                f"{row['wrong']:6d} {100 * row['worst_m']:5.1f} cm {_ate(row)}{_remark(row)}",
                flush=True,
            )
            _write(args.out, done | results)
    return _totals(args, results)


def _run(args: Args, path: str, scene_name: str, seed: int) -> dict[str, Any]:
    import numpy as np

    from dsmap.frame import Frame
    from dsmap.fusion.evaluate.robustness import score_trial, share_in_view
    from dsmap.fusion.mapper import Mapper
    from dsmap.sim_scenes.recording.open_scene import open_scene
    from dsmap.sim_scenes.recording.options import RenderOptions, plan_take
    from dsmap.sim_scenes.recording.record import iter_frames

    width, height = parse_size(args.size) or (320, 240)
    options = RenderOptions(
        scene=scene_name, seed=seed, frames=args.frames, width=width, height=height, noise=args.noise,
        path=path, effects=args.effects, readout_s=args.readout_s,
    )  # fmt: skip
    scene = open_scene(options)
    take = plan_take(scene, options)
    readout = args.readout_s if args.config.readout_s is None else args.config.readout_s
    mapper = Mapper(dataclasses.replace(args.config, readout_s=readout), take.camera)
    true, estimated, tracked, relocalised, blind, in_view = [], [], [], [], [], []
    for index, image in enumerate(iter_frames(scene, options, take)):
        frame = Frame(index, image.time, image.rgb, image.depth)
        result = mapper.step(frame)
        true.append(image.T_world_camera)
        tracked.append(result.tracked)
        relocalised.append(result.relocalised)
        blind.append(not image.rgb.any())
        estimated.append(result.T_world_camera)
        T_true = estimated[0] @ np.linalg.inv(true[0]) @ image.T_world_camera
        lost = not (result.tracked or blind[-1])
        in_view.append(share_in_view(mapper, frame, T_true) if lost else 1.0)
    score = score_trial(
        np.array(true),
        np.array(estimated),
        tracked,
        relocalised,
        np.array(blind),
        options.fps,
        np.array(in_view),
    )
    return dataclasses.asdict(score) | {"passed": score.passed, "hopeless": score.hopeless}


def _ate(row: dict[str, Any]) -> str:
    ate = row.get("ate_m")
    return "       -" if ate is None else f"{100 * ate:5.2f} cm"


def _remark(row: dict[str, Any]) -> str:
    if row["passed"]:
        return ""
    saw = f" (at most {row['in_view']:.0%} of its view was mapped)" if row.get("hopeless") else ""
    return f"  FAILED{saw}"


def _totals(args: Args, results: dict[str, Any]) -> int:
    short = 0
    for path in args.paths:
        rows = [row for name, row in results.items() if name.startswith(f"{path} ")]
        passed = sum(row["passed"] for row in rows)
        wrong = sum(row["wrong_relocalised"] for row in rows)
        found = sum(row["relocalised"] for row in rows)
        hopeless = sum(row.get("hopeless", False) for row in rows)
        print(
            f"{path}: {passed} of {len(rows)} tracked or found within 1 s; {wrong} of {found} relocalisations wrong"
            + (f"; {hopeless} of the failed ones saw too little of the map to be found" if hopeless else "")
        )
        frames, lost = (sum(row[key] for row in rows) for key in ("frames", "lost"))
        ates = [row["ate_m"] for row in rows if row.get("ate_m") is not None]
        middle = f"; median ATE {100 * statistics.median(ates):.2f} cm" if ates else ""
        print(f"{path}: {lost} of {frames} frames lost ({lost / max(frames, 1):.2%}){middle}")
        short += passed < 0.9 * len(rows) or wrong > 0
    return int(short > 0)


def _read(path: Path | None) -> dict[str, Any]:
    if path is None or not path.exists():
        return {}
    found = read_json(path, "JSON of trials")
    if not isinstance(found, dict):
        raise InputError(f"{path}: found {type(found).__name__}; expected JSON of trials")
    return found


def _write(path: Path | None, rows: dict[str, Any]) -> None:
    if path is None:
        return
    write_json(path, rows)
