"""What exports of images share."""

import warnings
from collections.abc import Iterable, Iterator
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


def labelled_frames(sequence: Sequence) -> Iterator[tuple[int, np.ndarray, Frame]]:
    """Number, labels and images of the frames that have labels; one that is damaged is named and left out.

    Raises:
        InputError: the recording has no labels, or none that can be read.
    """
    need_labels(sequence)
    for i, frame in _readable(sequence, range(len(sequence))):
        if frame.label is not None:
            yield i, frame.label, frame


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
    posed = [i for i in range(len(sequence)) if sequence.T_world_camera(i) is not None]
    for i, frame in _readable(sequence, posed):
        pose = sequence.T_world_camera(i)
        assert pose is not None
        yield i, pose, frame


def _readable(sequence: Sequence, chosen: Iterable[int]) -> Iterator[tuple[int, Frame]]:
    """The chosen frames that can be read. Raises InputError where none can."""
    found, reason = 0, "no frame was asked for"
    for i in chosen:
        try:
            frame = sequence.frame(i)
        except InputError as error:
            reason = str(error)
            warnings.warn(InputWarning(f"left out: {reason}"), stacklevel=2)
            continue
        found += 1
        yield i, frame
    if not found:
        raise InputError(f"{sequence.path}: found no frame that can be written ({reason}), expected some")
