"""`dsmap doctor`: does dsmap compute on this machine what it should? A report to paste into an issue."""

import importlib.metadata
import platform
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import warp as wp
from scipy.spatial import KDTree

from dsmap.cores import usable_cores
from dsmap.files import write_json
from dsmap.frame import Frame
from dsmap.fusion.config import MapConfig
from dsmap.fusion.lie import exp_se3
from dsmap.fusion.mapper import Mapper
from dsmap.kernels.runtime import chosen_device
from dsmap.ranges import Range
from dsmap.tools.twins import corner
from dsmap.tools.twins.checks import CHECKS

_PACKAGES = (
    "warp-lang",
    "numpy",
    "opencv-python-headless",
    "scipy",
    "torch",
    "onnxruntime",
    "mujoco",
    "open3d",
)
_APART_M, _COUNT, _SURFACE_M = 2e-3, 0.02, 1e-3
"""How far CUDA may be from the CPU: the camera anywhere [m], the number of surfels (share), the surface [m]."""


@dataclass
class Args:
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """What is examined; auto: CUDA where there is one, else the CPU."""
    frames: Annotated[int, Range(10, 100_000)] = 60
    """A room of this many frames is mapped on the CPU and on the device; on the CPU alone, twice."""
    out: Path | None = None
    """File for the report, as JSON."""


def main(args: Args) -> int:
    """Examine the machine, print and write the report; 1 if something is not as it should be.

    Raises:
        InputError: CUDA was asked for and there is none.
    """
    device = chosen_device("cuda:0" if args.device == "cuda" else args.device).alias
    report: dict[str, Any] = {
        "versions": versions(),
        "devices": devices(),
        "opengl": opengl(),
        "device": device,
    }
    failed: list[str] = []
    for line in _lines(report):
        print(line)
    report["kernels"] = examine_kernels(device, failed)
    report |= examine_mapping(device, args.frames, failed)
    report["failed"] = failed
    if args.out is not None:
        write_json(args.out, report)
        print(f"written to {args.out}")
    print(f"failed: {', '.join(failed)}" if failed else "all is as it should be")
    return 1 if failed else 0


def versions() -> dict[str, str]:
    """Of dsmap, Python, the system and what dsmap computes with; absent packages are left out."""
    found = {"python": platform.python_version(), "system": platform.platform()}
    for name in ("dsmap", *_PACKAGES):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def devices() -> list[str]:
    """The processor, and every CUDA device with its memory and compute capability."""
    found = [f"cpu: {_processor()}, {usable_cores()} cores"]
    for device in wp.get_cuda_devices():
        memory = device.total_memory / 2**30
        found.append(f"{device.alias}: {device.name}, {memory:.0f} GiB, sm_{device.arch}")
    return found


def _processor() -> str:
    cpus = Path("/proc/cpuinfo")
    lines = cpus.read_text().splitlines() if cpus.exists() else []
    named = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or platform.machine())


def opengl() -> str:
    """Whether rooms can be rendered with OpenGL: `yes`, or why not. dsmap's own renderer needs none."""
    try:
        from dsmap.sim_scenes.render.egl import use_egl

        use_egl()
        import mujoco

        mujoco.GLContext(16, 16).free()
    except Exception as error:  # whatever a driver or a missing package raises is the answer
        return f"no: {str(error).splitlines()[0] if str(error) else type(error).__name__}"
    return "yes"


def examine_kernels(device: str, failed: list[str]) -> dict[str, float | None]:
    """Largest difference of every kernel from its twin, in its own unit; None where it cannot run."""
    differences: dict[str, float | None] = {}
    for name, check in CHECKS.items():
        try:
            difference, note = check.run(device), ""
        except Exception as error:  # a kernel that does not run is what doctor is there to find
            difference, note = (
                None,
                f" {type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}",
            )
        differences[name] = difference
        fine = difference is not None and difference <= check.limit
        if not fine:
            failed.append(f"kernel {name}")
        told = "-" if difference is None else f"{difference:.1e}"
        print(f"  {name:<30} {told:>8}  (at most {check.limit:.0e}) {'ok' if fine else 'FAILED'}{note}")
    return differences


def _room(frames: int) -> Iterator[Frame]:
    """A slow arc through a ray-cast corner with a ball in it."""
    for i in range(frames):
        T = exp_se3(np.array([0.004 * i, 0.0012 * i, 0.0, 0.0, -0.0032 * i, 0.0]))
        rgb, depth = corner.room(T)
        yield Frame(i, i / 30, rgb, depth, T)


def mapped(device: str, frames: int) -> Mapper:
    """The room, mapped on a device."""
    mapper = Mapper(MapConfig(device=device, depth_max=6.0), corner.INTRINSICS)
    for frame in _room(frames):
        mapper.step(frame)
    return mapper


def examine_mapping(device: str, frames: int, failed: list[str]) -> dict[str, Any]:
    """Trajectory and map on the device beside those on the CPU; on the CPU itself, beside those of a second run."""
    first, second = mapped("cpu", frames), mapped(device, frames)
    poses = [np.array([T for T in mapper.trajectory.poses]) for mapper in (first, second)]
    apart = np.linalg.norm(poses[0][:, :3, 3] - poses[1][:, :3, 3], axis=1)
    truth = np.array([frame.T_world_camera for frame in _room(frames)])[:, :3, 3]
    off = np.linalg.norm(poses[1][:, :3, 3] - truth, axis=1)
    tracked = second.tracked_frames
    trajectory = {
        "largest_difference_m": float(apart.max()),
        "largest_error_m": float(off.max()),
        "tracked": tracked,
        "frames": frames,
    }
    counts = [mapper.surfels.count for mapper in (first, second)]
    positions = [mapper.surfels.numpy()["position"] for mapper in (first, second)]
    distance = float(np.median(KDTree(positions[0]).query(positions[1])[0])) if min(counts) else float("inf")
    surfels = {"surfels": counts[1], "surfels_cpu": counts[0], "median_difference_m": distance}
    exact = device == "cpu"
    limits = (0.0, 0.0, 0.0) if exact else (_APART_M, _COUNT, _SURFACE_M)
    if not (apart.max() <= limits[0] and tracked == frames):
        failed.append("trajectory")
    if not (abs(counts[1] - counts[0]) <= limits[1] * counts[0] and distance <= limits[2]):
        failed.append("map")
    beside = "a second run" if exact else "the CPU's"
    print(f"trajectory: {tracked}/{frames} tracked, at most {1e3 * apart.max():.3f} mm from {beside}")
    print(f"map: {counts[1]} surfels, {beside} {counts[0]}, median difference {1e3 * distance:.3f} mm")
    stages = {
        m.model.device.alias: {n: s.mean_ms for n, s in m.stages.items() if s.mean_ms}
        for m in (first, second)
    }
    for name, ms in stages.items():
        print(f"stages on {name} [ms]: " + ", ".join(f"{stage} {mean:.1f}" for stage, mean in ms.items()))
    return {"trajectory": trajectory, "map": surfels, "stages_ms": stages}


def _lines(report: dict[str, Any]) -> list[str]:
    told = ", ".join(f"{name} {version}" for name, version in report["versions"].items())
    return [
        f"versions: {told}",
        *report["devices"],
        f"OpenGL: {report['opengl']}",
        f"kernels on {report['device']}:",
    ]
