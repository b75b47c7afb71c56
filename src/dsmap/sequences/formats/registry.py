"""The list of readers."""

from pathlib import Path

from dsmap.reading import DECODER_ERRORS
from dsmap.sequences.formats import (
    arkitscenes,
    azure_kinect,
    bundlefusion,
    icl_nuim,
    klg,
    nerfstudio,
    nyu_raw,
    realsense,
    record3d,
    replica,
    ros,
    rtabmap,
    scannet_folder,
    scannet_sens,
    stray_scanner,
    sun3d,
)
from dsmap.sequences.formats.protocol import Reader

READERS: tuple[Reader, ...] = (
    realsense.READER,
    ros.READER,
    scannet_sens.READER,
    klg.READER,
    azure_kinect.READER,
    record3d.READER,
    stray_scanner.READER,
    arkitscenes.READER,
    nerfstudio.READER,
    scannet_folder.READER,
    replica.READER,
    rtabmap.READER,
    sun3d.READER,
    icl_nuim.READER,
    bundlefusion.READER,
    nyu_raw.READER,
)
"""In the order in which they are asked."""


def find_reader(path: Path) -> Reader | None:
    """The first reader that knows a path as its own, or None."""
    return next((reader for reader in READERS if _detects(reader, path)), None)


def _detects(reader: Reader, path: Path) -> bool:
    try:
        return reader.detect(path)
    except DECODER_ERRORS:  # a folder that may not be listed is nobody's; the next reader says so
        return False
