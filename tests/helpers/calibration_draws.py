"""Rendered recordings with known calibrations, calibrated from wrong ones: `python tests/helpers/calibration_draws.py
FOLDER` renders into FOLDER what is not there yet and prints how far off each draw is.
"""

import argparse
import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dsmap.fusion.calibration.calibrate import calibrate
from dsmap.sequences import SequenceWriter, open_sequence
from dsmap.sequences.calibration import Calibration, read_calibration, write_calibration
from dsmap.sim_scenes.recording.open_scene import open_scene
from dsmap.sim_scenes.recording.options import RenderOptions, Take, plan_take
from dsmap.sim_scenes.recording.record import iter_frames
from dsmap.sim_scenes.render.renderer import Image, Renderer

BARS = {"focal_percent": 0.5, "offset_ms": 2.0, "readout_ms": 3.0, "place_mm": 2.0, "place_deg": 0.2}


@dataclass(frozen=True)
class TwoCameras(Take):
    """A take whose depth is measured from beside the colour camera."""

    T_color_depth: np.ndarray | None = None

    def shot(self, renderer: Renderer, frame: int) -> Image:
        assert self.rows is not None and self.T_color_depth is not None
        path, colour_s, depth_s, offset_s = self.rows
        height = self.camera.height
        colour = renderer(path.rows(frame, height, colour_s))
        depth = renderer(path.rows(frame, height, depth_s, offset_s) @ self.T_color_depth)
        return replace(depth, rgb=colour.rgb)


RECORDINGS = {
    "registered_living_room": RenderOptions(
        scene="living_room", seed=11, readout_s=0.026, depth_offset_s=0.012, distortion=True
    ),
    "registered_office": RenderOptions(
        scene="office", seed=12, readout_s=0.018, depth_offset_s=-0.008, distortion=True, path="fast"
    ),
    "beside_kitchen": RenderOptions(
        scene="kitchen", seed=13, readout_s=0.022, depth_offset_s=0.006, path="fast"
    ),
    "beside_bedroom": RenderOptions(scene="bedroom", seed=14, readout_s=0.03, depth_offset_s=-0.01),
}


def render(folder: Path, options: RenderOptions, T_color_depth: np.ndarray | None) -> Calibration:
    """Render a recording unless it is there; returns its true calibration."""
    if not (folder / "whole").exists():
        scene = open_scene(options)
        take = plan_take(scene, options)
        if T_color_depth is not None:
            own = {name: getattr(take, name) for name in Take.__dataclass_fields__}
            take = TwoCameras(**own, T_color_depth=T_color_depth)
        with SequenceWriter(
            folder, take.camera, overwrite=True, readout_s=options.readout_s, depth_time_offset_s=options.depth_offset_s
        ) as writer:  # fmt: skip
            for frame in iter_frames(scene, options, take):
                writer.write(frame.time, frame.rgb, frame.depth)
        true = read_calibration(folder)
        assert true is not None
        write_calibration(folder, replace(true, T_color_depth=T_color_depth))
        (folder / "whole").touch()
    true = read_calibration(folder)
    assert true is not None
    return true


def place(seed: int) -> np.ndarray:
    """Where a depth camera is before its colour camera: as in a Kinect, about."""
    rng = np.random.default_rng(seed)
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(np.deg2rad(rng.uniform(-1, 1, 3))).as_matrix()
    T[:3, 3] = (-0.025, *rng.uniform(-0.005, 0.005, 2))
    return T


def wrong(true: Calibration, seed: int) -> Calibration:
    """A calibration as people have it: focal length, lens, times and places off."""
    rng = np.random.default_rng([seed, 99])
    factor = 1 + rng.uniform(-0.04, 0.04)
    k, lens = true.intrinsics, true.intrinsics.distortion
    if lens is not None:
        lens = (lens[0] + rng.uniform(-0.03, 0.03), *lens[1:])
    T = true.T_color_depth
    if T is not None:
        off = np.eye(4)
        off[:3, :3] = Rotation.from_rotvec(np.deg2rad(rng.uniform(-1, 1, 3))).as_matrix()
        off[:3, 3] = rng.uniform(-0.015, 0.015, 3)
        T = T @ off
    return replace(
        true,
        intrinsics=replace(k, fx=k.fx * factor, fy=k.fy * factor, distortion=lens),
        readout_s=float(np.clip(true.readout_s + rng.uniform(-0.02, 0.02), 0, None)),
        depth_time_offset_s=true.depth_time_offset_s + rng.uniform(-0.015, 0.015),
        T_color_depth=T,
    )


def linked(recording: Path, folder: Path, given: Calibration) -> Path:
    """The same recording under another calibration."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("rgb", "depth", "rgb.txt", "depth.txt"):
        if not os.path.lexists(folder / name):
            (folder / name).symlink_to((recording / name).resolve())
    write_calibration(folder, given)
    return folder


def errors(found: Calibration, true: Calibration) -> dict[str, float]:
    """How far off a calibration is, by the names of `BARS`."""
    out = {
        "focal_percent": 100 * abs(found.intrinsics.fx / true.intrinsics.fx - 1),
        "offset_ms": 1000 * abs(found.depth_time_offset_s - true.depth_time_offset_s),
        "readout_ms": 1000 * abs(found.readout_s - true.readout_s),
    }
    if true.T_color_depth is not None:
        T = np.eye(4) if found.T_color_depth is None else found.T_color_depth
        between = Rotation.from_matrix(true.T_color_depth[:3, :3].T @ T[:3, :3])
        out["place_mm"] = 1000 * float(np.linalg.norm(T[:3, 3] - true.T_color_depth[:3, 3]))
        out["place_deg"] = float(np.rad2deg(between.magnitude()))
    return out


def draw(folder: Path, name: str, seed: int, options: RenderOptions) -> tuple[dict[str, float], Calibration]:
    """Errors of one draw, and what was found."""
    T = place(options.seed) if name.startswith("beside") else None
    true = render(folder / name, options, T)
    given = linked(folder / name, folder / f"{name}_{seed}", wrong(true, seed))
    found = calibrate(open_sequence(given), options.frames).calibration
    return errors(found, true), found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--draws", type=int, default=5, help="of every recording")
    parser.add_argument("--only", default="", help="recordings whose names hold this")
    parser.add_argument("--frames", type=int, default=90)
    args = parser.parse_args()
    worst = dict.fromkeys(BARS, 0.0)
    for name, what in RECORDINGS.items():
        if args.only not in name:
            continue
        options = replace(what, frames=args.frames, width=320, height=240, noise="kinect")
        for seed in range(args.draws):
            off, found = draw(args.folder, name, seed, options)
            worst |= {key: max(worst[key], value) for key, value in off.items()}
            print(
                name,
                seed,
                {key: round(value, 3) for key, value in off.items()},
                found.undetermined,
                flush=True,
            )
    print("worst", {key: round(value, 3) for key, value in worst.items()}, "bars", BARS)


if __name__ == "__main__":
    main()
