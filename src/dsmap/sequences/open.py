"""Opening a folder as a sequence: layout, calibration, choice of frames."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dsmap.errors import InputError
from dsmap.reading import check_plain, reading
from dsmap.sequences.base import Entry, Recording, Sequence
from dsmap.sequences.calibration import (
    CALIBRATION_FILE,
    Calibration,
    check_calibration,
    known_default,
    read_calibration,
    resolve,
)
from dsmap.sequences.formats.archive import is_archive, unpack
from dsmap.sequences.formats.protocol import OPTIONS, Options
from dsmap.sequences.formats.registry import find_reader
from dsmap.sequences.found_calibration import check_assumed, find_calibration, with_depth_of
from dsmap.sequences.images import asks_to_be_turned, image_size, is_depth, stored_depth
from dsmap.sequences.label_check import settle_labels
from dsmap.sequences.label_maps import load_label_map
from dsmap.sequences.own_depth_camera import with_own_depth_camera
from dsmap.sequences.redwood import is_redwood, read_redwood
from dsmap.sequences.seven_scenes import are_rigid, is_seven_scenes, read_seven_scenes
from dsmap.sequences.tum import is_tum, read_tum
from dsmap.sequences.turned_depth import is_turned, with_depth_turned_back

_LATEST_S = 1e11
"""No stamp is later: seconds since 1970 are 1e9 to 1e10."""
_ROOM_M = 30.0
"""A larger median of depth is not in metres."""
_FOLDERS, _MILLIMETRES = ("redwood", "folders"), 1000.0
"""Layouts of people's own programs, and the units a metre that are taken where they state none."""
_LISTED = 5
"""Entries of a folder that an error message names."""


def open_sequence(
    path: Path | str,
    *,
    intrinsics: tuple[float, float, float, float] | None = None,
    depth_scale: float | None = None,
    size: tuple[int, int] | None = None,
    start: int = 0,
    stop: int | None = None,
    stride: int = 1,
    undistort: bool = False,
    label_map: str | None = None,
    options: Options = OPTIONS,
) -> Sequence:
    """Open a recording; the layout is detected by looking at the folder or file.

    Args:
        path: folder in the TUM RGB-D, 7-Scenes or Redwood/Open3D layout, what a reader in `formats` takes, or
            an archive (.zip, .tgz, ...) of one of these.
        intrinsics: fx, fy, cx, cy of the recording's own images [px]; before calibration.yaml and defaults.
        depth_scale: stored depth units per metre; before calibration.yaml and defaults.
        size: (width, height) of the frames to yield; colour is averaged, depth and ids are nearest.
        start, stop, stride: which associated frames, as in a Python slice of non-negative numbers.
        undistort: remap all images to the pinhole camera of the same K (nothing to do without distortion).
        label_map: `nyu40`, `scannet` or a file: which of the 13 classes a stored id or colour is (see
            `label_maps.load_label_map`); None: label images hold the 13 classes.
        options: which parts of a container to read (topics, ...).

    Raises:
        InputError: no layout fits, the calibration is missing or wrong, or no frame is chosen.
    """
    if size is not None and min(size) < 1:
        raise InputError(
            f"size: found {size[0]}x{size[1]}, expected a width and height of at least one pixel"
        )
    inner, folder = _found(Path(path))
    stored = read_calibration(folder)
    recording = _sound(read_recording(folder, stored, options))
    if inner is not None:
        recording.notes.insert(0, f"{inner.name} is read, the only recording in {path}")
    if asks_to_be_turned(recording.entries[0].rgb):
        recording.notes.append(
            "colour images ask to be turned (EXIF); their pixels are taken as stored, as depth's are"
        )
    stored = stored or _calibration_of(recording)
    calibration = _calibrated(recording, folder, stored, intrinsics, depth_scale)
    settle_labels(recording, load_label_map(label_map, folder), calibration.intrinsics)
    return Sequence(recording, calibration, size, _chosen(recording, start, stop, stride), undistort)


def _found(path: Path) -> tuple[Path | None, Path]:
    """The file that a folder holds instead of being a recording itself, if so, and the folder or file to read.

    Of an archive that is the recording in it.
    """
    with reading(path, "a recording's folder or file"):
        if not path.exists():
            raise InputError(f"{path}: found nothing, expected a recording's folder or file")
        if not path.is_dir():
            check_plain(path, "a recording's folder or file")
        inner = only_file_in(path)
    found = inner or path
    return inner, unpack(found, is_recording) if is_archive(found) else found


def _calibrated(
    recording: Recording,
    folder: Path,
    stored: Calibration | None,
    intrinsics: tuple[float, float, float, float] | None,
    depth_scale: float | None,
) -> Calibration:
    """The calibration that counts: what was given, is stored, or is assumed. Depth that is turned is turned back."""
    found = _image_size(recording, stored)
    samples = _depth_samples(recording)
    depth_size = _common_size(samples)
    if stored is None:
        stored = _stated_or_assumed(recording, found, depth_size, intrinsics is not None)
    calibration = resolve(recording.layout, folder, found, stored, intrinsics, depth_scale)
    if calibration.source != CALIBRATION_FILE:
        check_calibration(f"{folder}, {calibration.source}", calibration)
    stored_size = (calibration.stored_colour.width, calibration.stored_colour.height)
    calibration = with_depth_of(calibration, stored_size, depth_size, folder, recording.notes)
    if depth_scale is None and recording.calibration is None and calibration.source != CALIBRATION_FILE:
        calibration = _in_metres(calibration, samples, recording.notes)
        if recording.layout in _FOLDERS and calibration.depth_scale == _MILLIMETRES and is_turned(samples):
            recording.notes.append(
                "assumed: depth is turned by three bits, as SUN3D's is; --depth-scale 8000 if not"
            )
            recording.entries = [with_depth_turned_back(entry) for entry in recording.entries]
    return calibration


def read_recording(folder: Path, stored: Calibration | None = None, options: Options = OPTIONS) -> Recording:
    """Detect the layout of a folder or file and list its associated frames, without opening an image.

    Raises:
        InputError: it is none of the layouts; names what was looked for and what was found.
    """
    with reading(folder, "a recording"):
        return _read(folder, stored, options)


def _read(folder: Path, stored: Calibration | None, options: Options) -> Recording:
    if is_tum(folder):
        known = stored or known_default("tum", folder, 640, 480)  # of whatever size: the stamps are the same
        return read_tum(folder, known.depth_time_offset_s if known else 0.0)
    if (reader := find_reader(folder)) is not None:
        return reader.read(folder, options)
    if not folder.is_dir():
        raise InputError(f"{folder}: found a file of no known format, expected a recording's folder or file")
    if is_seven_scenes(folder):
        return read_seven_scenes(folder)
    if is_redwood(folder):
        return read_redwood(folder, stored.depth_time_offset_s if stored else 0.0)
    names = sorted(entry.name + ("/" if entry.is_dir() else "") for entry in folder.iterdir())
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    found = ", ".join(names[:_LISTED]) + more if names else "an empty folder"
    inner = [child for child in sorted(folder.iterdir()) if is_archive(child) or is_recording(child)]
    hint = f"; {inner[0]} is a recording" if inner else ""
    raise InputError(
        f"{folder}: not a recording; looked for rgb.txt and depth.txt (TUM), frame-*.depth.png (7-Scenes), "
        f"depth/ beside image/ or color/ (Redwood), and the formats of docs/guide/recordings.md; found {found}{hint}"
    )


def only_file_in(folder: Path) -> Path | None:
    """The one file of a folder that is a recording or an archive; None where the folder is itself a recording."""
    if not folder.is_dir() or is_recording(folder):
        return None
    files = [f for f in sorted(folder.iterdir()) if f.is_file() and not f.name.startswith(".")]
    found = [f for f in files if is_archive(f) or is_recording(f)]
    return found[0] if len(found) == 1 else None


def is_recording(path: Path) -> bool:
    """Whether a folder or file is a recording of any layout or format."""
    return is_tum(path) or find_reader(path) is not None or is_seven_scenes(path) or is_redwood(path)


def _sound(recording: Recording) -> Recording:
    """The recording without frames whose stamp cannot be one, and without poses that are none."""
    times = np.array([entry.time for entry in recording.entries], np.float64)
    sound = np.abs(times) < _LATEST_S  # not so for NaN
    if not sound.all():
        recording.notes.append(
            f"{int((~sound).sum())} of {len(sound)} frames have no possible time stamp and are left out"
        )
    entries = [entry for entry, kept in zip(recording.entries, sound, strict=True) if kept]
    if not entries:
        raise InputError(f"{recording.path}: found no frame with a time stamp that can be one, expected some")
    posed = [k for k, entry in enumerate(entries) if entry.T_world_camera is not None]
    poses: list[Any] = [entries[k].T_world_camera for k in posed]
    odd = [k for k, T in zip(posed, poses, strict=True) if np.shape(T) != (4, 4)]
    if posed and not odd:
        odd = [posed[i] for i in np.flatnonzero(~are_rigid(np.array(poses, np.float64)))]
    if odd:
        recording.notes.append(f"{len(odd)} of {len(posed)} poses are no rigid transforms and are left out")
        for k in odd:
            entries[k] = replace(entries[k], T_world_camera=None)
    return replace(recording, entries=entries)


def _calibration_of(recording: Recording) -> Calibration | None:
    """The format's own camera; where it has none that is measured, a calibration.yaml beside a recording's file."""
    own = recording.calibration
    if recording.path.is_file() and (own is None or own.source.startswith("assumed")):
        return read_calibration(recording.path.parent) or own
    return own


def _stated_or_assumed(
    recording: Recording, size: tuple[int, int], depth_size: tuple[int, int] | None, is_given: bool
) -> Calibration | None:
    """The camera that a file beside the images states; None, and a note on what is assumed, where there is none."""
    try:
        with reading(recording.path, "a camera in the files beside the images"):
            found = find_calibration(recording.path, recording.layout, size, depth_size, recording.notes)
            if found is not None:
                found = with_own_depth_camera(found, recording, depth_size)
    except InputError:
        if not is_given:
            raise
        found = None
    if found is None and not is_given:
        check_assumed(recording.layout, recording.path, size, recording.notes)
    return found


def _depth_samples(recording: Recording) -> list[np.ndarray]:
    """Depth images as stored: the first, the middle and the last that decode.

    Raises:
        InputError: all of them are of a kind that cannot be depth.
    """
    entries = recording.entries
    images = [entries[i].depth for i in dict.fromkeys((0, len(entries) // 2, len(entries) - 1))]
    found = [(image, stored) for image in images if (stored := stored_depth(image)) is not None]
    if found and not any(is_depth(stored) for _, stored in found):
        image, stored = found[0]
        channels = 1 if stored.ndim == 2 else stored.shape[2]
        raise InputError(
            f"{image}: found {channels} channel(s) of {stored.dtype} here and in the other depth images, expected "
            "depth of one channel and 16 bits or more; such images are drawings of depth"
        )
    return [stored for _, stored in found if is_depth(stored)]


def _common_size(samples: list[np.ndarray]) -> tuple[int, int] | None:
    """(width, height) of most of the depth images; None where none decodes."""
    sizes = [(stored.shape[1], stored.shape[0]) for stored in samples]
    return max(sizes, key=sizes.count) if sizes else None


def _in_metres(calibration: Calibration, samples: list[np.ndarray], notes: list[str]) -> Calibration:
    """The calibration for depth stored as floats, which are metres where they are as small as a room."""
    floats = [stored for stored in samples if stored.dtype.kind == "f"]
    valid = np.concatenate([f[np.isfinite(f) & (f > 0)].ravel() for f in floats]) if floats else np.empty(0)
    if (
        calibration.depth_scale == 1.0
        or len(floats) < len(samples)
        or not len(valid)
        or np.median(valid) > _ROOM_M
    ):
        return calibration
    notes.append("assumed: depth stored as floats is in metres; --depth-scale says otherwise")
    return replace(calibration, depth_scale=1.0)


def _chosen(recording: Recording, start: int, stop: int | None, stride: int) -> list[Entry]:
    entries = recording.entries[_slice(start, stop, stride)]
    if not entries:
        raise InputError(
            f"{recording.path}: no frame between start {start} and stop {stop}, "
            f"expected a part of 0..{len(recording.entries)}"
        )
    return entries


def _slice(start: int, stop: int | None, stride: int) -> slice:
    if start < 0 or stride < 1 or (stop is not None and stop < 0):
        raise InputError(
            f"start {start}, stop {stop}, stride {stride}: expected start, stop >= 0 and stride >= 1"
        )
    return slice(start, stop, stride)


def _image_size(recording: Recording, stored: Calibration | None) -> tuple[int, int]:
    """(width, height) of the colour images: the calibration's if one of three looked at has it.

    One damaged or odd image must not decide, hence the three.
    """
    entries = recording.entries
    looked_at = [entries[i].rgb for i in dict.fromkeys((0, len(entries) // 2, len(entries) - 1))]
    sizes = [size for size in map(image_size, looked_at) if size is not None]
    if not sizes:
        raise InputError(f"{looked_at[0]}: neither this nor the middle and last colour image can be decoded")
    if stored is None:
        return max(sizes, key=sizes.count)
    camera = stored.stored_colour
    if (camera.width, camera.height) not in sizes:
        said = (
            recording.path / CALIBRATION_FILE
            if stored.source == CALIBRATION_FILE
            else f"{recording.path}, {stored.source}"
        )
        raise InputError(
            f"{said}: found width and height {camera.width}x{camera.height}, "
            f"expected {sizes[0][0]}x{sizes[0][1]} as the images have"
        )
    return stored.intrinsics.width, stored.intrinsics.height
