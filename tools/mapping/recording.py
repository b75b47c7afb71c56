"""The recording that a run mapped, opened again as it was."""

from pathlib import Path
from typing import Any

from dsmap.errors import InputError
from dsmap.fusion.runs.read_run import SavedRun
from dsmap.sequences import Sequence, open_sequence
from dsmap.sequences.formats.protocol import Options
from dsmap.sequences.pose_conventions import with_convention


def recording_of(
    run: SavedRun,
    path: Path | None = None,
    label_map: str | None = None,
    intrinsics: Any = None,
    depth_scale: float | None = None,
    undistort: bool | None = None,
) -> Sequence:
    """The whole recording at its own size.

    Args:
        path: another one of the same frames; None: the one that config.yaml names.
        label_map, intrinsics, depth_scale: see `open_sequence`; None: as the run.
        undistort: None: as the run.

    Raises:
        InputError: no recording is named, or it cannot be read.
    """
    settings = run.settings.get("sequence", {})
    place = path or settings.get("path")
    if place is None:
        raise InputError(f"{run.path}: its config.yaml names no recording; expected --reference")
    recording = open_sequence(
        place,
        intrinsics=intrinsics,
        depth_scale=depth_scale,
        undistort=bool(settings.get("undistort", False)) if undistort is None else undistort,
        label_map=label_map or settings.get("label_map"),
        options=Options(settings.get("color_topic"), settings.get("depth_topic")),
    )
    if path is None and settings.get("pose_convention"):
        recording = with_convention(recording, settings["pose_convention"])
    return recording
