"""`dsmap bench`: how fast, stage by stage, and against a peer on the same frames in the same run."""

import dataclasses
import json
import os
import platform
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Annotated, Any, Literal

import tyro

from dsmap.cores import usable_cores
from dsmap.errors import InputError
from dsmap.files import write_json
from dsmap.ranges import Every, Range, Scale
from dsmap.sequences import Sequence
from dsmap.tools.support.bench_worker import Request, map_args, opened
from dsmap.tools.support.parse import parse_intrinsics, parse_size

_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "DSMAP_THREADS")


@dataclass
class Args:
    path: tyro.conf.Positional[Path]
    """The recording: a folder, or a file as cameras leave it (docs/guide/recordings.md)."""
    peer: Literal["none", "open3d"] = "none"
    """Run this system as well, turn by turn: Open3D's dense SLAM on the CPU."""
    size: str | None = None
    """WxH: resize frames first, e.g. 320x240."""
    frames: Annotated[int | None, Range(1, 1_000_000)] = None
    """Use the first N frames only; all frames are held in memory."""
    stride: Every = 1
    """Take every n-th frame."""
    runs: Annotated[int, Range(1, 1000)] = 3
    """Runs of each system; the median counts."""
    threads: str | None = None
    """CPU threads of each system; several numbers, as 1,2,4, show how speed grows with them; default: all cores."""
    config: str | None = None
    """Parameters of dsmap as `dsmap map --config` takes them: a YAML file, or a name; default: its defaults."""
    segmenter: str = "none"
    """What labels dsmap's frames: none, dsnet (the network) or labels (the recording's own)."""
    depth_max: Annotated[float | None, Range(0, 1000, above=True)] = None
    """Ignore farther depth [m], in both systems; default: the configuration's, else the calibration's depth_max, else
    that of `dsmap map`, or beside Open3D 3, its own."""
    undistort: bool = True
    """Remove lens distortion, where the calibration has one, for both systems, as `dsmap map` does."""
    intrinsics: str | None = None
    """fx,fy,cx,cy of the recording's own images [px]."""
    depth_scale: Scale | None = None
    """Stored depth units per metre."""
    device: Literal["cpu", "cuda:0"] = "cpu"
    """Where dsmap's kernels run."""
    out: Path = Path("bench.json")
    """File for all figures."""


def main(args: Args) -> int:
    """Run the benchmark, print its tables, write its file."""
    for name in ("runs", "frames", "stride"):
        value = getattr(args, name)
        if value is not None and value < 1:
            raise InputError(f"--{name} is {value}; expected at least 1")
    counts = thread_counts(args.threads)
    request = make_request(args)
    sequence = opened(request)
    request = dataclasses.replace(request, depth_max=depth_limit(args, request, sequence))
    systems = ["dsmap"]
    if args.peer == "open3d":
        from dsmap.tools.support.bench_peer import check_open3d

        check_open3d()
        systems.append("open3d")
    reports = []
    for threads in counts:
        request = dataclasses.replace(request, threads=threads)
        results: dict[str, list[dict]] = {system: [] for system in systems}
        for turn in range(args.runs):
            for system in systems:
                print(
                    f"run {turn + 1} of {args.runs}: {system}, {threads} threads ...",
                    file=sys.stderr,
                    flush=True,
                )
                results[system].append(run_worker(dataclasses.replace(request, system=system)))
        report = {"setup": setup(request, sequence), "runs": results, "summary": summarise(results)}
        reports.append(report)
        print(tables(report))
    written = reports[-1] | ({"scaling": _scaling(reports)} if len(reports) > 1 else {})
    write_json(args.out, written)
    if len(reports) > 1:
        print(scaling_table(written["scaling"]))
    print(f"written to {args.out}")
    return 0


def thread_counts(words: str | None) -> list[int]:
    """The numbers of threads that a benchmark is run with.

    Raises:
        InputError: something that is no number, or no number of threads.
    """
    if words is None:
        return [usable_cores()]
    counts = [int(word) if word.strip().isdecimal() else 0 for word in str(words).split(",")]
    if not all(1 <= count <= 1024 for count in counts):
        raise InputError(f"--threads is {words}; expected numbers from 1 to 1024 such as 2, or 1,2,4")
    return counts


def make_request(args: Args) -> Request:
    """The run that the command line asks for; its depth_max is yet to be filled in."""
    return Request(
        system="dsmap",
        path=str(args.path),
        size=parse_size(args.size),
        frames=args.frames,
        stride=args.stride,
        intrinsics=parse_intrinsics(args.intrinsics),
        depth_scale=args.depth_scale,
        depth_max=0.0,
        threads=1,
        device=args.device,
        config=args.config,
        segmenter=args.segmenter,
        undistort=args.undistort,
    )


def depth_limit(args: Args, request: Request, sequence: Sequence) -> float:
    """Depth beyond which both systems see nothing [m]."""
    configured = map_args(request).map
    if args.peer == "open3d" and configured.depth_max is None:
        configured = dataclasses.replace(configured, depth_max=sequence.depth_max or 3.0)
    return args.depth_max or configured.resolved_for(sequence).depth_range[1]


def run_worker(request: Request) -> dict:
    """One run in a process of its own.

    Raises:
        InputError: the recording cannot be read, or the process died (its last words are in the message).
    """
    environment = {**os.environ, **dict.fromkeys(_THREAD_VARIABLES, str(request.threads))}
    with tempfile.TemporaryDirectory() as folder:
        ask, answer = Path(folder) / "request.json", Path(folder) / "result.json"
        write_json(ask, dataclasses.asdict(request))
        command = [sys.executable, "-m", "dsmap.tools.support.bench_worker", str(ask), str(answer)]
        process = subprocess.run(command, env=environment, capture_output=True, text=True)
        if not answer.is_file():
            words = (process.stderr.strip().splitlines() or ["no message"])[-1]
            raise InputError(f"the run of {request.system} ended with code {process.returncode}: {words}")
        result = json.loads(answer.read_text())
    if "error" in result:
        raise InputError(result["error"])
    return result


def setup(request: Request, sequence: Sequence) -> dict[str, Any]:
    """What the figures were measured on."""
    k = sequence.intrinsics
    return {
        "path": request.path,
        "size": [k.width, k.height],
        "threads": request.threads,
        "depth_max": request.depth_max,
        "device": request.device,
        "config": request.config,
        "segmenter": request.segmenter,
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
    }


def summarise(results: dict[str, list[dict]]) -> dict[str, Any]:
    """Medians over the runs, and how many times faster dsmap is than its peer."""
    values: dict[str, Any] = {}
    for system, runs in results.items():
        names = ("fps", "wall_fps", "peak_rss_bytes", "ate_rmse_m", "latency_ms")
        known = {name: [run[name] for run in runs if run.get(name) is not None] for name in names}
        values[system] = {name: median(column) if column else None for name, column in known.items()}
    if "open3d" in values:
        values["speed_ratio"] = values["dsmap"]["fps"] / values["open3d"]["fps"]
    return values


def _has_latency(system: Any) -> bool:
    return isinstance(system, dict) and system.get("latency_ms") is not None


def tables(report: dict[str, Any]) -> str:
    """The report as text."""
    made, summary, runs = report["setup"], report["summary"], report["runs"]
    first = runs["dsmap"][0]
    lines = [
        f"{made['path']}: {first['frames']} frames of {made['size'][0]}x{made['size'][1]}, "
        f"{made['threads']} threads, depth to {made['depth_max']:g} m, labels: {made['segmenter']}",
        "frames/s leave out decoding, resizing, compilation and the first five frames; wall frames/s do not",
        "",
        f"{'':8} {'frames/s':>9}  {'of each run':<20} {'wall frames/s':>13} {'ATE [cm]':>9} {'tracked':>9} "
        f"{'memory [MiB]':>13}",
    ]
    for system, results in runs.items():
        mid = summary[system]
        each = " ".join(f"{run['fps']:.2f}" for run in results)
        ate = "-" if mid["ate_rmse_m"] is None else f"{100 * mid['ate_rmse_m']:.2f}"
        tracked = f"{results[0]['tracked_frames']}/{results[0]['frames']}"
        lines.append(
            f"{system:8} {mid['fps']:9.2f}  {each:<20} {mid['wall_fps']:13.2f} {ate:>9} {tracked:>9} "
            f"{mid['peak_rss_bytes'] / 2**20:13.0f}"
        )
    if "speed_ratio" in summary:
        lines.append(f"dsmap runs at {summary['speed_ratio']:.2f} times Open3D's frames per second (medians)")
    latency = [f"{name} {mid['latency_ms']:.0f} ms" for name, mid in summary.items() if _has_latency(mid)]
    if latency:
        lines.append(
            f"latency, from the start of a frame's preparation to its map: {', '.join(latency)} (medians)"
        )
    lines += ["", f"{'stage of dsmap':<16} {'mean [ms]':>10} {'median [ms]':>12}"]
    for name in first["stages_ms"]:
        mean = median(run["stages_ms"][name]["mean"] for run in runs["dsmap"])
        middle = median(run["stages_ms"][name]["median"] for run in runs["dsmap"])
        if mean >= 0.005:  # stages that are off
            lines.append(f"{name:<16} {mean:10.2f} {middle:12.2f}")
    total = median(1000 / run["fps"] for run in runs["dsmap"])
    lines.append(f"{'whole frame':<16} {total:10.2f}")
    lines.append("preprocess: the wait for it; the work is done beside the frame before, within its time")
    return "\n".join(lines)


def _scaling(reports: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Speed by number of threads, with what it was reached with: a row a report."""
    rows = []
    for report in reports:
        mid, first = report["summary"]["dsmap"], report["runs"]["dsmap"][0]
        row = {"threads": report["setup"]["threads"], "fps": mid["fps"], "ate_rmse_m": mid["ate_rmse_m"]}
        row |= {"tracked_frames": first["tracked_frames"], "frames": first["frames"]}
        row["times_the_first"] = mid["fps"] / reports[0]["summary"]["dsmap"]["fps"]
        if "speed_ratio" in report["summary"]:
            row["speed_ratio"] = report["summary"]["speed_ratio"]
        rows.append(row)
    return rows


def scaling_table(rows: list[dict[str, Any]]) -> str:
    """The rows of `_scaling` as text."""
    lines = ["", f"{'threads':>7} {'frames/s':>9} {'times the first':>16} {'ATE [cm]':>9} {'tracked':>9}"]
    for row in rows:
        ate = "-" if row["ate_rmse_m"] is None else f"{100 * row['ate_rmse_m']:.2f}"
        tracked = f"{row['tracked_frames']}/{row['frames']}"
        lines.append(
            f"{row['threads']:7} {row['fps']:9.2f} {row['times_the_first']:16.2f} {ate:>9} {tracked:>9}"
        )
    return "\n".join(lines)
