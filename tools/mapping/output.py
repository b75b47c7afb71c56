"""What `dsmap map` writes and says."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from dsmap.files import all_that_fits, write_json, write_yaml
from dsmap.fusion.config import CrfConfig, SegmentConfig
from dsmap.fusion.labels.segment import segment_later
from dsmap.fusion.objects.files import OBJECTS, read_boxes
from dsmap.fusion.runs.map_recording import RunState
from dsmap.fusion.runs.refine import by_crf, by_segments, refine_map
from dsmap.fusion.runs.run_folder import config_values, save_run, statistics
from dsmap.sequences import Sequence
from dsmap.tools.mapping.options import Args


def write_run(args: Args, state: RunState, sequence: Sequence) -> None:
    """Write everything but the pictures; the checkpoint last: where it is new, all else is.

    Raises:
        WriteError: after all that could be written was; names what was not.
    """
    if args.refine != "none" and args.spec.kind != "none" and not state.mapper.model.frozen:
        state.measured = refine_map(
            state.mapper, by_segments(SegmentConfig()) if args.refine == "segments" else by_crf(CrfConfig())
        )
    k = sequence.intrinsics
    values: dict[str, Any] = {
        "sequence": {
            "path": str(args.path), "start": args.start, "stop": args.stop, "stride": args.stride,
            "size": [k.width, k.height], "undistort": args.undistort, "depth_scale": sequence.depth_scale,
            "intrinsics": {"fx": k.fx, "fy": k.fy, "cx": k.cx, "cy": k.cy, "width": k.width, "height": k.height},
            "intrinsics_source": sequence.intrinsics_source,
            "pose_convention": args.pose_convention,
            "label_map": args.label_map, "color_topic": args.color_topic, "depth_topic": args.depth_topic,
        },
        "config": args.config,
        "localize_in": None if args.localize_in is None else str(args.localize_in),
        "map": config_values(state.mapper),
        "segmenter": dataclasses.asdict(args.spec),
        "refine": args.refine,
    }  # fmt: skip
    stats = statistics(state.mapper, len(state.skipped), state.wall_s)
    if state.pace is not None:
        stats["realtime"] = state.pace.report()
    with all_that_fits(args.out) as attempt:
        attempt(write_yaml, args.out / "config.yaml", values)
        attempt(write_json, args.out / "stats.json", stats, indent=2)
        attempt(
            save_run,
            state.mapper,
            args.out,
            with_probabilities=args.save_probabilities,
            objects=args.objects,
            checkpoint=False,
        )
        attempt(state.save, state)


def draw_pictures(out: Path, state: RunState, sequence: Sequence) -> None:
    """Draw the pictures of a run."""
    from dsmap.fusion.pictures.pictures import StripFrame, write_pictures

    mapper, strip = state.mapper, []
    for position, result in state.shown:
        frame = sequence.frame(position)
        probabilities = None
        if mapper.segmenter and result.tracked:
            probabilities = segment_later(
                mapper.segmenter,
                frame,
                result.T_world_camera,
                mapper.labeller.gravity,
                mapper.intrinsics,
                mapper.config,
            )
        predicted = (
            None if probabilities is None else (probabilities[..., 1:].argmax(-1) + 1).astype(np.uint8)
        )
        strip.append(StripFrame(frame, result.T_world_camera, predicted))
    reference = [sequence.T_world_camera(i) for i in range(len(sequence))]
    points = mapper.trajectory[mapper.first_frame :]
    write_pictures(
        out,
        mapper.surfels,
        points,
        sequence.intrinsics,
        strip,
        reference,
        up=mapper.up,
        boxes=read_boxes(out),
    )


def remove_pictures(out: Path) -> None:
    """Remove the pictures of an earlier run: they show another map than the one that is there now."""
    for picture in (out / "pictures").glob("*.png"):
        picture.unlink()
    if (out / "pictures").is_dir() and not any((out / "pictures").iterdir()):
        (out / "pictures").rmdir()


def report_run(state: RunState, out: Path, whole: bool = True) -> None:
    """Say in a few lines what came out, and where it is, if the whole of it could be written."""
    stats = statistics(state.mapper, len(state.skipped), 0.0)
    tracking, speed, found = stats["tracking"], stats["speed"], stats["map"]
    lost, skipped = tracking["lost_frames"], tracking["skipped_frames"]
    print(
        f"{tracking['tracked_frames']} of {found['frames']} frames tracked, {lost} lost, {skipped} skipped; "
        f"{found['local_loops']} local and {found['global_loops']} global loops"
    )
    for index, reason in state.skipped[:5]:
        print(f"skipped frame {index}: {reason}")
    fps = f"{speed['fps']:.1f} frames/s" if speed["fps"] else "no frame mapped"
    print(f"{found['surfels']:,} surfels, {fps}, {speed['peak_rss_bytes'] / 2**20:.0f} MiB at most")
    if state.pace is not None:
        print(state.pace.summary())
    if not whole:
        return
    pictures = " pictures/" if (out / "pictures").is_dir() else ""
    objects = " objects.json scene_graph.json" if (out / OBJECTS).is_file() else ""
    print(
        f"written to {out}: map.ply labels.ply trajectory.txt trajectory_status.txt stats.json "
        f"checkpoint.safetensors{objects}{pictures}"
    )
