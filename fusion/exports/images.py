"""What exports of images share."""

import warnings
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from dsmap.errors import InputError, InputWarning
from dsmap.files import atomic_path
from dsmap.frame import Frame
from dsmap.sequences import Sequence


def need_labels(sequence: Sequence) -> None:
    """Raises InputError where a recording has no labels."""
    if not sequence.has_labels:
        why = sequence.recording.labels_unused or "found no label images, expected some (label.txt)"
        raise InputError(f"{sequence.path}: {why}")


def write_png(path: Path, image: np.ndarray) -> None:
    """Write an image, channels in OpenCV's order, as PNG."""
    with atomic_path(path) as file:
        _, data = cv2.imencode(".png", np.ascontiguousarray(image))
        file.write_bytes(data.tobytes())


def posed_frames(sequence: Sequence) -> Iterator[tuple[int, np.ndarray, Frame]]:
    """Number, T_world_camera and images of the frames that have a pose; one that is damaged is named and left out.

    Raises:
        InputError: the recording has no poses.
    """
    if not sequence.has_poses:
        raise InputError(f"{sequence.path}: found no poses (groundtruth.txt), expected some")
    for i in range(len(sequence)):
        pose = sequence.T_world_camera(i)
        if pose is None:
            continue
        try:
            frame = sequence.frame(i)
        except InputError as error:
            warnings.warn(InputWarning(f"left out: {error}"), stacklevel=2)
            continue
        yield i, pose, frame
