"""A run in rerun: the map by colour and by class, the camera's path, and the frames beside the map's labels."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from dsmap.classes import CLASS_NAMES, PALETTE, colourise
from dsmap.files import atomic_path
from dsmap.frame import Frame, Intrinsics
from dsmap.sequences import Sequence

_JPEG_QUALITY = 80
_IMAGE_WIDTH = 320
"""Images are logged at this width, or smaller."""
TIMELINE = "frame"


def write_rerun(
    path: Path,
    sequence: Sequence,
    surfels: dict[str, np.ndarray],
    up: np.ndarray,
    max_points: int = 1_000_000,
) -> int:
    """Write an `.rrd`; returns the number of frames in it.

    Args:
        sequence: with poses and labels: a `RunFrames`.
        surfels: arrays by the names of `SurfelMap`.
        up: in the world's frame, shape (3,).
        max_points: a larger map is thinned out evenly.

    Raises:
        ModuleNotFoundError: rerun is not installed.
    """
    import rerun as rr

    from dsmap.fusion.exports.images import posed_frames

    stream = rr.RecordingStream("dsmap")
    with atomic_path(path) as temporary:
        stream.save(str(temporary))
        log_classes(stream)
        log_up(stream, up)
        log_map(stream, surfels, max_points)
        count, way = 0, []
        for _, pose, frame in posed_frames(sequence):
            log_frame(stream, frame, pose, sequence.intrinsics, frame.label)
            way.append(pose[:3, 3])
            count += 1
        stream.log(
            "world/path", rr.LineStrips3D([np.array(way)], colors=[(214, 39, 40)], radii=0.004), static=True
        )
        stream.disconnect()
    return count


def log_classes(stream: Any) -> None:
    """Names and colours of the classes."""
    import rerun as rr

    table = [(i, name, tuple(PALETTE[i].tolist())) for i, name in enumerate(CLASS_NAMES)]
    stream.log("/", rr.AnnotationContext(table), static=True)


def log_up(stream: Any, up: np.ndarray) -> None:
    """Say which axis of the world points up most."""
    import rerun as rr

    axis = int(np.argmax(np.abs(up)))
    name = f"RIGHT_HAND_{'XYZ'[axis]}_{'UP' if up[axis] > 0 else 'DOWN'}"
    stream.log("world", getattr(rr.ViewCoordinates, name), static=True)


def log_map(stream: Any, surfels: dict[str, np.ndarray], max_points: int, static: bool = True) -> None:
    """The living surfels as points in their colours, and in those of their classes."""
    import rerun as rr

    rows = np.flatnonzero(surfels["weight"] > 0)
    if len(rows) > max_points:
        rows = np.sort(np.random.default_rng(0).choice(rows, max_points, replace=False))
    position, radii = surfels["position"][rows], surfels["radius"][rows]
    rgb = np.rint(surfels["colour"][rows].clip(0, 1) * 255).astype(np.uint8)
    stream.log("world/map", rr.Points3D(position, colors=rgb, radii=radii), static=static)
    if (label := surfels["label"][rows]).any():
        points = rr.Points3D(
            position, colors=colourise(label), class_ids=label.astype(np.uint16), radii=radii
        )
        stream.log("world/labels", points, static=static)


def log_frame(
    stream: Any, frame: Frame, T_world_camera: np.ndarray, k: Intrinsics, label: np.ndarray | None
) -> None:
    """One frame at its number and stamp: the camera, its image as JPEG, its labels."""
    import rerun as rr

    stream.set_time(TIMELINE, sequence=frame.index)
    stream.set_time("time", duration=frame.time)
    place = rr.Transform3D(translation=T_world_camera[:3, 3], mat3x3=T_world_camera[:3, :3])
    stream.log("world/camera", place)
    width = min(_IMAGE_WIDTH, k.width)
    small = k.scaled(width, round(k.height * width / k.width))
    stream.log("world/camera", rr.Pinhole(image_from_camera=small.K, resolution=[small.width, small.height]))
    image = cv2.resize(frame.rgb, (small.width, small.height), interpolation=cv2.INTER_AREA)
    _, jpeg = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    stream.log("world/camera/image", rr.EncodedImage(contents=jpeg.tobytes(), media_type="image/jpeg"))
    if label is not None:
        ids: Any = cv2.resize(label, (small.width, small.height), interpolation=cv2.INTER_NEAREST)
        stream.log("world/camera/labels", rr.SegmentationImage(ids, opacity=0.5))
