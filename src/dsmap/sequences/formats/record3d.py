"""Record3D's `.r3d`: a zip of `metadata` (JSON) and `rgbd/N.jpg`, `rgbd/N.depth` (LZFSE), `rgbd/N.conf`."""

import zipfile
from functools import partial
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.limits import MAX_TEXT_BYTES
from dsmap.plain import parse_json
from dsmap.reading import DECODER_ERRORS, read_bytes
from dsmap.sequences.associate import pose_matrix
from dsmap.sequences.base import Recording
from dsmap.sequences.calibration import Calibration
from dsmap.sequences.extra import optional_library
from dsmap.sequences.formats.parts import OPENGL_AXES, confident, recording_by_number, two_cameras
from dsmap.sequences.formats.protocol import Options, Reader
from dsmap.sequences.images import Packed

_MAX_PIXELS = 1 << 24


def _detect(path: Path) -> bool:
    if path.is_dir():
        return (path / "metadata").is_file() and any((path / "rgbd").glob("*.depth"))
    return path.suffix.lower() == ".r3d" and path.is_file()


def _read(path: Path, _options: Options) -> Recording:
    optional_library("liblzfse", path, "Record3D's depth")
    members = _Members(path)
    metadata = _metadata(members)
    found = {suffix: _numbers(members.names, suffix) for suffix in (".jpg", ".png", ".depth", ".conf")}
    pictures = found[".jpg"] or found[".png"]
    colour = {n: Packed(path, name, partial(members.read, name)) for n, name in pictures.items()}
    calibration, (width, height) = _calibration(path, metadata)
    depth = {
        n: Packed(path, name, partial(_depth, members, name, found[".conf"].get(n), (width, height)))
        for n, name in found[".depth"].items()
    }
    stamps = [float(t) for t in metadata.get("frameTimestamps") or []]
    poses = _poses(path, metadata)
    return recording_by_number(
        "record3d", path, colour, depth, calibration, expected="rgbd/0.jpg beside rgbd/0.depth",
        times=dict(enumerate(stamps)) if len(stamps) >= len(colour) else None,
        rate=float(metadata.get("fps") or 30.0), poses=dict(enumerate(poses)),
    )  # fmt: skip


READER = Reader("record3d", _detect, _read)


class _Members:
    """The files of a `.r3d`, or of the folder that it was unpacked into. May be read from several threads."""

    def __init__(self, path: Path):
        """Read the directory of the zip once: it has three entries a frame. Raises InputError: no whole zip."""
        self.path = path
        self._archive: zipfile.ZipFile | None = None
        if path.is_dir():
            self.names = [f"rgbd/{file.name}" for file in (path / "rgbd").iterdir()]
            return
        try:
            self._archive = zipfile.ZipFile(path)
        except DECODER_ERRORS as error:
            raise InputError(
                f"{path}: found a file that is no whole zip ({error}), expected Record3D's .r3d"
            ) from error
        self.names = self._archive.namelist()

    def read(self, name: str) -> bytes:
        """The bytes of a file. Raises InputError: it is missing or damaged."""
        try:
            if self._archive is None:
                return read_bytes(self.path / name, "a whole file", MAX_TEXT_BYTES)
            if (size := self._archive.getinfo(name).file_size) > MAX_TEXT_BYTES:
                raise InputError(
                    f"{self.path}, {name}: found {size:,} bytes, expected at most {MAX_TEXT_BYTES:,}"
                )
            return self._archive.read(name)
        except DECODER_ERRORS as error:
            raise InputError(
                f"{self.path}, {name}: cannot be read ({error}), expected a whole file"
            ) from error


def _numbers(names: list[str], suffix: str) -> dict[int, str]:
    stems = ((Path(name).stem, name) for name in names if name.startswith("rgbd/") and name.endswith(suffix))
    return {int(stem): name for stem, name in stems if stem.isdigit()}


def _metadata(members: _Members) -> dict:
    content = parse_json(members.read("metadata"), f"{members.path}, metadata")
    if not isinstance(content, dict):
        raise InputError(
            f"{members.path}, metadata: found {type(content).__name__}, expected K, w, h, poses, ..."
        )
    return content


def _calibration(path: Path, metadata: dict) -> tuple[Calibration, tuple[int, int]]:
    """The camera, and (width, height) of the depth images."""
    try:
        K = np.array(metadata["K"], np.float64).reshape(3, 3).T  # stored by columns
        fx, fy, cx, cy = (float(v) for v in (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
        per_frame = metadata.get("perFrameIntrinsicCoeffs")
        if per_frame:  # autofocus moves the lens
            fx, fy, cx, cy = (float(v) for v in np.median(np.array(per_frame, np.float64)[:, :4], axis=0))
        camera = Intrinsics(int(metadata["w"]), int(metadata["h"]), fx, fy, cx, cy)
        depth = int(metadata.get("dw") or 192), int(metadata.get("dh") or 256)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise InputError(f"{path}, metadata: {error!r}, expected K, w, h, dw, dh") from error
    if not (camera.fx > 0 and camera.fy > 0 and 0 < depth[0] * depth[1] < _MAX_PIXELS):
        raise InputError(f"{path}, metadata: found K {metadata['K']} and depth of {depth[0]}x{depth[1]}")
    return two_cameras(camera, camera.scaled(*depth), np.eye(4), 1.0, "Record3D's metadata"), depth


def _poses(path: Path, metadata: dict) -> list[np.ndarray]:
    """Camera-to-world poses, stored as qx qy qz qw x y z with ARKit's axes."""
    try:
        table = np.array(metadata.get("poses") or [], np.float64).reshape(-1, 7)
    except ValueError as error:
        raise InputError(f"{path}, metadata: {error}, expected poses of seven numbers") from error
    return [pose_matrix(np.roll(pose, 3)) @ OPENGL_AXES for pose in table if np.linalg.norm(pose[:4]) > 0.5]


def _depth(members: _Members, name: str, confidence: str | None, size: tuple[int, int]) -> np.ndarray:
    pixels = size[0] * size[1]
    data = _unpacked(members, name, pixels * 4)
    dtype = np.float16 if len(data) == pixels * 2 else np.float32
    if len(data) != pixels * np.dtype(dtype).itemsize:
        raise InputError(
            f"{members.path}, {name}: found {len(data)} bytes of depth, expected {size[0]}x{size[1]} floats"
        )
    depth = np.frombuffer(data, dtype).astype(np.float32).reshape(size[1], size[0])
    if confidence is None:
        return depth
    sure = np.frombuffer(_unpacked(members, confidence, pixels), np.uint8)
    return confident(depth, sure.reshape(depth.shape)) if sure.size == pixels else depth


def _unpacked(members: _Members, name: str, at_most: int) -> bytes:
    lzfse = optional_library("liblzfse", members.path, "Record3D's depth")
    try:
        data = lzfse.decompress(members.read(name))
    except lzfse.error as error:
        raise InputError(f"{members.path}, {name}: does not decompress ({error}), expected LZFSE") from error
    return data if len(data) <= at_most else b""
