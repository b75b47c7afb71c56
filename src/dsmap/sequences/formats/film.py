"""Frames of a film (mp4, mkv) by their presentation time, through the library PyAV."""

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dsmap.errors import InputError
from dsmap.reading import check_plain
from dsmap.sequences.extra import optional_library

_READ_ON = 60
"""Frames that are decoded on the way to a later one before seeking is quicker."""


class Film:
    """One film, opened once a thread; frames are decoded in order where they are asked for in order."""

    def __init__(self, path: Path):
        """Open a film. Raises InputError: PyAV is not installed, or the file is damaged."""
        self.path = path
        self._av = optional_library("av", path, "a film")
        self._local = threading.local()
        with self._open() as container:
            self.metadata: dict[str, str] = dict(container.metadata)
            self.streams = [
                (s.index, dict(s.metadata), s.codec_context.pix_fmt or "", s.width, s.height)
                for s in container.streams.video
            ]
            self.attachments = {
                s.metadata.get("filename", str(s.index)): bytes(s.data or b"")
                for s in container.streams
                if s.type == "attachment"
            }

    def times(self, index: int) -> list[tuple[int, float]]:
        """Presentation times of a stream's frames as (ticks, seconds), in order, without decoding them."""
        with self._open() as container:
            stream = container.streams[index]
            try:
                ticks = sorted(p.pts for p in container.demux(stream) if p.pts is not None and p.size)
            except self._av.FFmpegError as error:
                raise self._damaged(error) from error
            return [(t, float(t * stream.time_base)) for t in ticks]

    def frame(self, index: int, ticks: int, format: str) -> np.ndarray:
        """One frame in a pixel format of FFmpeg. Raises InputError if it cannot be decoded."""
        try:
            for frame in self._from(index, ticks):
                if frame.pts is not None and frame.pts >= ticks:
                    return frame.to_ndarray(format=format)
        except self._av.FFmpegError as error:
            raise self._damaged(error) from error
        raise InputError(f"{self.path}: the film ends before its frame at tick {ticks}, expected one there")

    def _from(self, index: int, ticks: int) -> Iterator[Any]:
        """Frames from the one after the last that was asked for, or from the key frame before `ticks`."""
        readers = self._local.__dict__.setdefault("readers", {})
        reader = readers.get(index)
        if reader is None or not reader.last < ticks <= reader.last + _READ_ON * reader.step:
            if reader is not None:
                reader.container.close()
            reader = readers[index] = _Reader(self._open(), index, ticks)
        for frame in reader.frames:
            reader.saw(frame)
            yield frame

    def _open(self) -> Any:
        check_plain(self.path, "a film")
        try:
            return self._av.open(
                str(self.path), options={"ignore_editlist": "1"}
            )  # phones cut frames off by it
        except (self._av.FFmpegError, OSError) as error:
            raise self._damaged(error) from error

    def _damaged(self, error: Exception) -> InputError:
        return InputError(f"{self.path}: found a film that cannot be read ({error}), expected a whole one")


class _Reader:
    """A container in the middle of decoding one stream."""

    def __init__(self, container: Any, index: int, ticks: int):
        self.container = container
        stream = container.streams[index]
        stream.thread_type = "SLICE"  # decoding ahead on all cores would take them from mapping
        container.seek(ticks, stream=stream, backward=True)
        self.frames = container.decode(stream)
        self.last, self.step = -1 << 62, 0

    def saw(self, frame: Any) -> None:
        if frame.pts is not None:
            if self.last > -1 << 62:
                self.step = max(self.step, frame.pts - self.last)
            self.last, self.step = frame.pts, self.step or 1 << 40
