"""A recording may be larger than the memory: what is held while it is read does not grow with its length."""

import tracemalloc
from dataclasses import replace
from pathlib import Path

import pytest
from format_cases import CASES
from recording_shots import CAMERA, COUNT, Shot, shots

from dsmap.sequences import open_sequence

SHORT, LONG = 4 * COUNT, 10 * COUNT
"""Frames; the shorter is longer than a chunk of any bag."""
FRAME_BYTES = CAMERA.width * CAMERA.height * (3 + 4)
"""Of a decoded frame."""
QUICK = ("ros2-db3", "scannet-sens", "record3d")


def long_recording(count: int) -> list[Shot]:
    """The recording forwards and backwards, over and over."""
    once = shots()
    there_and_back = [*once, *once[::-1]]
    return [
        replace(there_and_back[k % (2 * COUNT)], time=round(once[0].time + k / 30, 6)) for k in range(count)
    ]


def peak(path: Path) -> int:
    """Bytes held at most while all frames are read, above what is held at the beginning."""
    sequence = open_sequence(path)
    tracemalloc.start()
    try:
        assert sum(1 for _ in sequence) == len(sequence)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in CASES]
)
def test_memory_does_not_grow_with_the_length(name: str, tmp_path: Path):
    pytest.importorskip("rosbags")
    peaks = []
    for count in (SHORT, LONG):
        folder = tmp_path / str(count)
        folder.mkdir()
        peaks.append(peak(CASES[name].write(folder, long_recording(count))))
    assert peaks[1] - peaks[0] < 0.3 * (LONG - SHORT) * FRAME_BYTES
