"""What every layout is read into, and the sequence that mapping walks through."""

import queue
import threading
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from dsmap.errors import InputError, InputWarning
from dsmap.frame import Frame, Intrinsics
from dsmap.reading import reading
from dsmap.sequences.calibration import Calibration
from dsmap.sequences.images import (
    Source,
    Undistorter,
    check_size,
    read_colour,
    read_depth,
    read_ids,
    resize_colour,
    resize_depth,
    resize_nearest,
)
from dsmap.sequences.label_images import LabelMap, fit
from dsmap.sequences.registration import register_colour, register_depth

_PREFETCH = 4
"""Frames decoded ahead of the consumer."""


@dataclass(frozen=True)
class Entry:
    """The images of one associated frame."""

    index: int
    time: float
    rgb: Source
    depth: Source
    label: Source | None = None
    instance: Source | None = None
    T_world_camera: np.ndarray | None = None
    """Given pose at the time of the depth image, shape (4, 4)."""
    depth_time: float | None = None
    """Stamp of the depth image on the colour's clock [s]; None: that of the colour."""

    @property
    def pose_time(self) -> float:
        """When the camera was at the given pose [s]."""
        return self.time if self.depth_time is None else self.depth_time


@dataclass
class Recording:
    """What a layout reader found in a folder, before any image is opened."""

    layout: str
    """`tum`, `7-scenes`, `redwood`, or the name of a reader in `formats`."""
    path: Path
    entries: list[Entry]
    """Associated frames in order of time."""
    num_rgb: int
    num_depth: int
    notes: list[str] = field(default_factory=list)
    """What was put right while reading (stamps out of order, ...), one sentence each."""
    calibration: Calibration | None = None
    """The camera, where the recording's own format holds it; calibration.yaml goes before it."""
    label_map: LabelMap = field(default_factory=LabelMap)
    """How label images are read."""
    labels_unused: str | None = None
    """Why the recording's label images are left out, one sentence; None: they are not."""


class Sequence:
    """An RGB-D recording as a list of frames. Use `open_sequence`.

    Iterating decodes ahead on a thread; a damaged frame is left out and counted in `skipped`.
    """

    def __init__(
        self,
        recording: Recording,
        calibration: Calibration,
        size: tuple[int, int] | None,
        entries: list[Entry],
        undistort: bool,
    ):
        self.recording = recording
        self.calibration = calibration
        self.entries = entries
        self.undistort = undistort
        self.skipped: list[tuple[int, str]] = []
        self._warned_of_labels = False
        source = calibration.intrinsics
        self._undistorter = Undistorter(source) if undistort and source.distortion else None
        if self._undistorter:
            source = replace(source, distortion=None)
        self.intrinsics: Intrinsics = source.scaled(*size) if size else source

    @property
    def layout(self) -> str:
        return self.recording.layout

    @property
    def path(self) -> Path:
        return self.recording.path

    @property
    def notes(self) -> list[str]:
        """What was put right while opening, one sentence each."""
        return self.recording.notes

    @property
    def depth_scale(self) -> float:
        """Stored depth units per metre."""
        return self.calibration.depth_scale

    @property
    def depth_max(self) -> float | None:
        """Depth beyond which the calibration does not trust the sensor [m]; None where it does not say."""
        return self.calibration.depth_max

    @property
    def readout_s(self) -> float:
        """Rolling shutter: time from an image's first row to its last [s]; 0: all rows at once."""
        return self.calibration.readout_s

    @property
    def intrinsics_source(self) -> str:
        """Where intrinsics and depth scale came from, for people."""
        return self.calibration.source

    @property
    def times(self) -> np.ndarray:
        """Colour stamps [s], shape (N,)."""
        return np.array([entry.time for entry in self.entries])

    @property
    def frame_rate(self) -> float | None:
        """Frames a second, by the median distance of the stamps; None where they tell nothing."""
        steps = np.diff(self.times)
        step = float(np.median(steps)) if len(steps) else 0.0
        return 1 / step if step > 0 else None

    @property
    def has_labels(self) -> bool:
        return any(entry.label is not None for entry in self.entries)

    @property
    def has_poses(self) -> bool:
        return any(entry.T_world_camera is not None for entry in self.entries)

    def __len__(self) -> int:
        return len(self.entries)

    def T_world_camera(self, i: int) -> np.ndarray | None:
        """Given pose of frame `i`, float64, shape (4, 4); None where there is none."""
        return self.entries[i].T_world_camera

    def frame(self, i: int) -> Frame:
        """Decode frame `i` of this sequence.

        Raises:
            InputError: an image is missing, damaged, of the wrong size, or the depth is all zero.
        """
        entry, size = self.entries[i], (self.intrinsics.width, self.intrinsics.height)
        with reading(entry.rgb, "a whole frame"):
            depth = self._depth(entry)
            return Frame(
                index=entry.index,
                time=entry.time,
                rgb=resize_colour(self._colour(entry, depth), *size),
                depth=resize_depth(depth, *size),
                T_world_camera=entry.T_world_camera,
                label=self._label(entry),
                instance=self._ids(entry.instance, np.uint16),
                depth_time=entry.depth_time,
            )

    def resized(self, size: tuple[int, int]) -> "Sequence":
        """The same frames at another (width, height), from the recording's own images."""
        return Sequence(self.recording, self.calibration, size, self.entries, self.undistort)

    def rest(self, first: int) -> "Sequence":
        """The frames from position `first` on; may be none."""
        entries = self.entries[first:]
        own = self.intrinsics
        return Sequence(self.recording, self.calibration, (own.width, own.height), entries, self.undistort)

    def labelled(self) -> list[int]:
        """Positions of the frames that have ground-truth labels."""
        return [i for i, entry in enumerate(self.entries) if entry.label is not None]

    def depth(self, i: int) -> np.ndarray:
        """Depth of frame `i` [m], float32, shape (H, W), without decoding its other images."""
        with reading(self.entries[i].depth, "a depth image"):
            return resize_depth(self._depth(self.entries[i]), self.intrinsics.width, self.intrinsics.height)

    def label(self, i: int) -> np.ndarray | None:
        """Ground-truth class ids of frame `i`, uint8, shape (H, W), without decoding its other images.

        None where there are none, or (after a warning) where they cannot be read.
        """
        return self._label(self.entries[i])

    def __iter__(self) -> Iterator[Frame]:
        self.skipped = []
        stop = threading.Event()
        ready: queue.Queue[Frame | BaseException | None] = queue.Queue(_PREFETCH)
        worker = threading.Thread(
            target=self._decode_all, args=(ready, stop), name="dsmap-decode", daemon=True
        )
        worker.start()
        try:
            while (item := ready.get()) is not None:
                if isinstance(item, BaseException):
                    raise item
                yield item
        finally:
            stop.set()
            _drain(ready)
            worker.join()

    def _decode_all(self, ready: queue.Queue, stop: threading.Event) -> None:
        try:
            for i, entry in enumerate(self.entries):
                if stop.is_set():
                    return
                try:
                    ready.put(self.frame(i))
                except InputError as error:
                    self.skipped.append((entry.index, str(error)))
        except BaseException as error:  # the consumer raises it: a thread's traceback would be lost
            ready.put(error)
        ready.put(None)

    def _colour(self, entry: Entry, depth: np.ndarray) -> np.ndarray:
        rgb, calibration = read_colour(entry.rgb), self.calibration
        if (own := calibration.color_camera) is not None:
            check_size(entry.rgb, rgb, own.width, own.height)
            return register_colour(rgb, depth, calibration.intrinsics, own, calibration.T_color_frame)
        self._check_size(entry.rgb, rgb)
        return self._undistorter.colour(rgb) if self._undistorter else rgb

    def _depth(self, entry: Entry) -> np.ndarray:
        depth = read_depth(entry.depth, self.depth_scale)
        self._check_size(entry.depth, depth)
        if not depth.any():
            raise InputError(f"{entry.depth}: found no valid depth in the whole image, expected some")
        if self.calibration.T_color_depth is not None and self.calibration.color_camera is None:
            depth = register_depth(depth, self.calibration.intrinsics, self.calibration.T_color_depth)
        return self._undistorter.nearest(depth) if self._undistorter else depth

    def _label(self, entry: Entry) -> np.ndarray | None:
        """A frame is worth mapping without its labels: what cannot be read is said once, and left out."""
        if entry.label is None:
            return None
        camera = self.calibration.intrinsics
        try:
            with reading(entry.label, "a label image"):
                label = fit(
                    self.recording.label_map.read(entry.label), camera.width, camera.height, str(entry.label)
                )
        except InputError as error:
            if not self._warned_of_labels:
                warnings.warn(InputWarning(f"frame {entry.index} has no labels: {error}"), stacklevel=2)
            self._warned_of_labels = True
            return None
        if self._undistorter:
            label = self._undistorter.nearest(label)
        return resize_nearest(label, self.intrinsics.width, self.intrinsics.height)

    def _ids(self, path: Source | None, dtype: type) -> np.ndarray | None:
        if path is None:
            return None
        ids = read_ids(path).astype(dtype)
        self._check_size(path, ids)
        if self._undistorter:
            ids = self._undistorter.nearest(ids)
        return resize_nearest(ids, self.intrinsics.width, self.intrinsics.height)

    def _check_size(self, path: Source, image: np.ndarray) -> None:
        check_size(path, image, self.calibration.intrinsics.width, self.calibration.intrinsics.height)


def _drain(ready: queue.Queue) -> None:
    """Empty the queue, so that a worker blocked on a full one sees the stop signal."""
    while True:
        try:
            ready.get_nowait()
        except queue.Empty:
            return
