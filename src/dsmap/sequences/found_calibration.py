"""The camera of a recording in the files that recorders leave beside the images (`camera_files` reads them)."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.lens import coefficients
from dsmap.sequences.calibration import CALIBRATION_FILE, Calibration, known_default
from dsmap.sequences.calibration_checks import check_camera
from dsmap.sequences.camera_files import FileCamera, camera_in
from dsmap.sequences.formats.bundlefusion import read_info
from dsmap.sequences.formats.parts import two_cameras
from dsmap.sequences.names import COLOUR_FOLDERS, folder_of
from dsmap.sequences.text import read_text

_SCALES = {"tum": 5000.0}
"""Units per metre that are usual in a layout; 1000 in the others."""
_JSON = ("camera_intrinsic.json", "camera_intrinsics.json", "intrinsic.json", "intrinsics.json", "camera.json",
         "calibration.json", "transforms.json", "cam_params.json", "camera_info.json", "config.json")  # fmt: skip
_TEXT = ("calibration.txt", "intrinsics.txt", "intrinsic.txt", "camera-intrinsics.txt", "camera_intrinsics.txt",
         "camera_matrix.txt", "camera_matrix.csv", "camera.txt", "calib.txt", "k.txt", "k.csv", "cam_k.txt", "ost.txt",
         "intrinsics_color.txt", "intrinsic_color.txt", "cameras.txt", "intrinsics_depth.txt")  # fmt: skip
_SURELY = tuple(name for name in (*_JSON, *_TEXT) if "intrinsic" in name or name.startswith("cam_"))
"""Names of nothing but a camera: looked for in the folder above, too, and missed where they state none."""
_INFO = ("info.txt", "_info.txt")
_FOLDERS = (
    "intrinsic",
    "intrinsics",
    "calib",
    "calibration",
    "camera",
    "cam",
    "camera_info",
    "sparse/0",
    "sparse",
)
_SUFFIXES = (".yaml", ".yml", ".json", ".txt", ".xml", ".npy", ".npz", ".ini", ".cfg", ".conf", ".csv")
_ANY_NAME = (".yaml", ".yml", ".json", ".xml", ".ini", ".cfg", ".conf")
"""Suffixes of files that may state a camera whatever they are called; others must say so in their name."""
_NAMES_OF_CAMERAS = ("intrinsic", "camera", "calib", "cam_", "_cam", "color_metadata")
_MAX_LOOKED_AT = 40
_SAME_ASPECT = 0.01
_DIFFERENT = 0.01
"""Relative difference of the focal lengths of two files from which they contradict each other."""


def find_calibration(
    folder: Path, layout: str, size: tuple[int, int], depth_size: tuple[int, int] | None, notes: list[str]
) -> Calibration | None:
    """The camera that a file beside the images states, or None where there is no such file.

    Args:
        size, depth_size: (width, height) of the colour and the depth images.

    Raises:
        InputError: a file states a camera of another shape than the images.
    """
    if not folder.is_dir():
        return None
    for name in _INFO:
        if (folder / name).is_file() and "m_calibration" in read_text(folder / name):
            return read_info(folder / name)
    stated: list[tuple[str, FileCamera]] = []
    for file in _candidates(folder):
        found, source = camera_in(file, size), _relative(file, folder)
        if found is not None:
            stated.append((source, found))
        elif file.name.lower() in _SURELY:
            notes.append(
                f"{source}: found no camera in it, expected fx fy cx cy, a 3x3 matrix, or a mapping with these"
            )
    if not stated:
        stated = [(f"../{f.name}", c) for f in _above(folder) if (c := camera_in(f, size)) and _fits(c, size)]
    if not stated:
        return None
    source, found = stated[0]
    camera = _at_size(folder / source, found, size, notes)
    _say_contradictions(stated, camera, size, notes)
    scale = found.depth_scale or next((c.depth_scale for _, c in stated if c.depth_scale), None)
    if scale is None:
        scale = _SCALES.get(layout, 1000.0)
        notes.append(f"assumed: {scale:g} depth units per metre; {source} does not say, --depth-scale does")
    return _with_depth(folder, camera, size, depth_size, scale, source)


def _with_depth(
    folder: Path,
    camera: Intrinsics,
    size: tuple[int, int],
    depth_size: tuple[int, int] | None,
    scale: float,
    source: str,
) -> Calibration:
    """Depth of another size may have its own file."""
    calibration = Calibration(camera, scale, source)
    if depth_size is None or depth_size == size:
        return calibration
    own = next((f for f in _depth_files(folder) if f.is_file()), None)
    found = camera_in(own, depth_size) if own else None
    if found is None:
        return calibration
    return two_cameras(camera, _plain(found, depth_size), np.eye(4), scale, source)


def with_depth_of(
    calibration: Calibration,
    size: tuple[int, int],
    depth_size: tuple[int, int] | None,
    where: Path,
    notes: list[str],
) -> Calibration:
    """The calibration for depth images of another size than the colour images, which see what colour sees.

    Args:
        size, depth_size: (width, height) of the colour and the depth images as they are stored.
        where: the recording, for the error.

    Raises:
        InputError: their shapes say that depth is another camera's.
    """
    camera = calibration.intrinsics
    if depth_size is None or depth_size == (camera.width, camera.height):
        return calibration
    (w, h), (width, height) = depth_size, size
    if calibration.color_camera is not None or abs(w * height / (h * width) - 1) > _SAME_ASPECT:
        raise InputError(
            f"{where}: found depth images of {w}x{h}, expected {camera.width}x{camera.height} as the camera of "
            f"{calibration.source} has; a depth camera of its own is stated in {CALIBRATION_FILE} "
            "(T_color_depth, color_camera)"
        )
    notes.append(
        f"assumed: depth of {w}x{h} sees what colour of {width}x{height} sees; {CALIBRATION_FILE} states two "
        "cameras where it does not (T_color_depth, color_camera)"
    )
    frame = replace(camera, distortion=None).scaled(w, h)
    return replace(calibration, intrinsics=frame, color_camera=camera)


def _depth_files(folder: Path) -> list[Path]:
    places = (folder, *(folder / name for name in _FOLDERS))
    return [place / name for place in places for name in ("intrinsic_depth.txt", "intrinsics_depth.txt")]


def _candidates(folder: Path) -> Iterator[Path]:
    """Files that may state the camera, the likeliest first; of a folder of one file a frame the first."""
    files = _files(folder)
    known = {file.name.lower(): file for file in reversed(files)}
    yield from (known[name] for name in (*_JSON, *_TEXT) if name in known)
    images = folder_of(folder, COLOUR_FOLDERS)
    for place in (*(folder / name for name in _FOLDERS), *([images] if images else [])):
        named = [f for f in _files(place) if place != images or _says_camera(f)]
        named = [f for f in named if "extrinsic" not in f.name.lower()]
        # of the colour camera, and of none before the depth camera
        yield from sorted(named, key=lambda f: ("color" not in f.name, "depth" in f.name, f.name))[:1]
    rest = [
        f
        for f in files
        if f.name.lower() not in (*_JSON, *_TEXT) and f.name.lower() not in (CALIBRATION_FILE, *_INFO)
    ]
    yield from [f for f in rest if f.suffix.lower() in _ANY_NAME or _says_camera(f)][:_MAX_LOOKED_AT]


def _files(place: Path) -> list[Path]:
    """Files of a folder that may be a camera's, in order of name; hidden ones are none."""
    if not place.is_dir():
        return []
    found = (f for f in place.iterdir() if f.suffix.lower() in _SUFFIXES and not f.name.startswith("."))
    return sorted(f for f in found if f.is_file())


def _says_camera(file: Path) -> bool:
    name = file.stem.lower()
    return any(word in name for word in _NAMES_OF_CAMERAS) or name == "k"


def _above(folder: Path) -> list[Path]:
    """Files of the folder above that can be nothing but the camera's of all recordings in it."""
    known = {file.name.lower(): file for file in _files(folder.resolve().parent)}
    return [known[name] for name in _SURELY if name in known]


def _relative(file: Path, folder: Path) -> str:
    return file.relative_to(folder).as_posix()


def _say_contradictions(
    stated: list[tuple[str, FileCamera]], camera: Intrinsics, size: tuple[int, int], notes: list[str]
) -> None:
    """Which other files state another camera of these images."""
    source = stated[0][0]
    for other, found in stated[1:]:
        if "depth" in other.lower() or not _fits(found, size):
            continue
        scale = size[0] / found.size[0] if found.size else 1.0
        if abs(found.values[0] * scale / camera.fx - 1) > _DIFFERENT:
            notes.append(f"{other} states another camera (fx {found.values[0]:g}): {source} is taken")
            return


def _fits(found: FileCamera, size: tuple[int, int]) -> bool:
    """Whether a camera may be that of images of a size."""
    if found.size is not None:
        return abs(found.size[0] * size[1] / (found.size[1] * size[0]) - 1) <= _SAME_ASPECT
    return 0.25 < found.values[2] / size[0] < 0.75 and 0.25 < found.values[3] / size[1] < 0.75


def _plain(found: FileCamera, size: tuple[int, int]) -> Intrinsics:
    return Intrinsics(*size, *found.values, coefficients(found.model, found.distortion))


def _at_size(file: Path, found: FileCamera, size: tuple[int, int], notes: list[str]) -> Intrinsics:
    """The camera at the size of the images. Raises InputError where it cannot be theirs."""
    camera = _plain(found, found.size or size)
    if not _fits(found, size):
        if found.size is not None:
            (w, h), (width, height) = found.size, size
            raise InputError(
                f"{file}: found a camera of {w}x{h}, expected {width}x{height} as the images have"
            )
        raise InputError(
            f"{file}: found cx {camera.cx:g} and cy {camera.cy:g}, expected values near the middle of the images, "
            f"which have {size[0]}x{size[1]}"
        )
    check_camera(file, camera)
    if found.size is not None and found.size != size:
        (w, h), (width, height) = found.size, size
        notes.append(f"{file.name} speaks of {w}x{h}, the images have {width}x{height}: scaled")
        return camera.scaled(*size)
    return camera


def check_assumed(layout: str, folder: Path, size: tuple[int, int], notes: list[str]) -> None:
    """Say which camera is taken where nothing states one.

    Raises:
        InputError: the images' shape says that it is another one.
    """
    names = {
        "redwood": "PrimeSense's camera (fx = fy = 525 at 640x480)",
        "7-scenes": "the Kinect of 7-Scenes",
    }
    width, height = size
    if layout == "tum" and known_default("tum", folder, 640, 480) is not None:
        names["tum"] = "the camera of TUM's recording of this name"
    if layout not in names:
        return
    if abs(width * 3 / (height * 4) - 1) > _SAME_ASPECT:
        raise InputError(
            f"{folder}: found images of {width}x{height} and no file that states their camera, which is not "
            f"{names[layout]}; write {folder / CALIBRATION_FILE} (width, height, fx, fy, cx, cy, depth_scale) or give "
            "--intrinsics fx,fy,cx,cy and --depth-scale"
        )
    if layout != "tum":
        notes.append(f"assumed: {names[layout]}; no file states another, --intrinsics fx,fy,cx,cy does")
