"""Frames of a recording without labels, for a teacher to label (`dsmap train --teacher`)."""

import functools
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dsmap.classes import CLASS_NAMES
from dsmap.dsnet.datasets.base import Example, LabelledSet, guarded
from dsmap.dsnet.datasets.geometry import DepthView
from dsmap.sequences import Sequence, open_sequence

SPLIT = "unlabelled"
MOST = 150
"""Frames of one recording that are taken, spread over it evenly: neighbours show the same."""


def load_unlabelled(path: Path) -> LabelledSet:
    """Frames of any recording that `dsmap map` reads, all their pixels void.

    Raises:
        InputError: no recording.
    """
    count = len(open_sequence(path))
    chosen = np.unique(np.linspace(0, count - 1, min(count, MOST)).astype(int))
    return LabelledSet([FrameItem(path, int(i)) for i in chosen], CLASS_NAMES, has_depth=True)


@dataclass(frozen=True)
class FrameItem:
    """One frame of a recording."""

    path: Path
    index: int

    @property
    def name(self) -> str:
        return f"{self.path}:{self.index}"

    @guarded
    def read(self, with_geometry: bool = True) -> Example:
        sequence = _opened(self.path, os.getpid())
        frame = sequence.frame(self.index)
        label = np.zeros(frame.rgb.shape[:2], np.uint8)
        if not with_geometry:
            return Example(frame.rgb, label)
        return Example(frame.rgb, label, DepthView(sequence.intrinsics).geometry(frame.depth, label.shape))


@functools.lru_cache(maxsize=8)
def _opened(path: Path, process: int) -> Sequence:
    return open_sequence(path)
