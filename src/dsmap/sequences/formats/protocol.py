"""What a reader of a format is, and what all readers share."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from dsmap.sequences.base import Recording


@dataclass(frozen=True)
class Options:
    """Which part of a container to read, where it holds several. None: found by looking."""

    color_topic: str | None = None
    """Topic of the colour images of a bag."""
    depth_topic: str | None = None
    """Topic of the depth images of a bag."""


OPTIONS = Options()


@dataclass(frozen=True)
class Reader:
    """One format: how to know it, and how to read it."""

    name: str
    """As `dsmap info` shows it."""
    detect: Callable[[Path], bool]
    """Whether a path (file or folder) is of this format, by names and first bytes; quick, and never raises."""
    read: Callable[[Path, Options], Recording]
    """Lists the frames. Raises InputError: damaged, or without colour, depth or a common stamp."""
