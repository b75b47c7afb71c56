"""The list of readers."""

from pathlib import Path

from dsmap.sequences.formats.protocol import Reader

READERS: tuple[Reader, ...] = ()
"""In the order in which they are asked."""


def find_reader(path: Path) -> Reader | None:
    """The first reader that knows a path as its own, or None."""
    return next((reader for reader in READERS if reader.detect(path)), None)
