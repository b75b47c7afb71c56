"""A `.zip` or `.tar` (`.tgz`, ...) of any recording, unpacked into a folder that goes with the process."""

import shutil
import stat
import tarfile
import zipfile
from collections.abc import Callable
from pathlib import Path, PurePosixPath

from dsmap.errors import InputError
from dsmap.folders import temporary_folder
from dsmap.reading import DECODER_ERRORS

_SUFFIXES = (".zip", ".tar", ".tgz", ".tar.gz", ".tar.bz2", ".tbz2", ".tar.xz", ".txz")
_MAX_FILES = 2_000_000
_SPARE_BYTES = 1 << 30
"""Left free on the disk."""
_unpacked: dict[tuple[str, int, int], Path] = {}
"""Folders by archive, its time and its size: one process unpacks an archive once."""


def is_archive(path: Path) -> bool:
    return path.is_file() and path.name.lower().endswith(_SUFFIXES)


def unpack(path: Path, is_recording: Callable[[Path], bool]) -> Path:
    """Unpack an archive and return the recording in it: the folder or file, at most three folders deep.

    No file leaves the folder, links are refused, and nothing is written beyond what the archive says or the
    disk holds.

    Raises:
        InputError: the archive is damaged, unsafe or too large, or holds no recording, or several.
    """
    state = path.stat()
    key = (str(path.resolve()), state.st_mtime_ns, state.st_size)
    if key not in _unpacked:
        folder = (
            temporary_folder("unpacked") / path.name.split(".")[0]
        )  # known cameras are found by the folder's name
        folder.mkdir()
        try:
            _extract(path, folder)
        except (*DECODER_ERRORS, tarfile.TarError) as error:
            raise InputError(f"{path}: cannot be unpacked ({error}), expected a whole archive") from error
        _unpacked[key] = folder
    return _recording_in(path, _unpacked[key], is_recording)


def _extract(path: Path, folder: Path) -> None:
    if path.name.lower().endswith(".zip"):
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            _check(path, folder, [(m.filename, m.file_size) for m in members])
            for member in members:
                if stat.S_ISLNK(member.external_attr >> 16):
                    raise InputError(f"{path}: found a link {member.filename}, expected files and folders")
                if "/" not in member.filename:
                    member.filename = member.filename.replace(
                        "\\", "/"
                    )  # as old Windows programs write names
                archive.extract(member, folder)  # bounded: zipfile reads no more than file_size
        return
    with tarfile.open(path) as archive:
        members = archive.getmembers()
        _check(path, folder, [(m.name, m.size) for m in members])
        odd = next((m.name for m in members if not (m.isfile() or m.isdir())), None)
        if odd is not None:
            raise InputError(f"{path}: found {odd}, which is a link or a device, expected files and folders")
        archive.extractall(folder, filter="data")


def _check(path: Path, folder: Path, members: list[tuple[str, int]]) -> None:
    for name, _ in members:
        parts = PurePosixPath(name.replace("\\", "/")).parts
        if ".." in parts or name.startswith(("/", "\\")) or ":" in (parts[0] if parts else ""):
            raise InputError(f"{path}: found the name {name!r}, expected names inside one folder")
    total, room = sum(size for _, size in members), shutil.disk_usage(folder).free - _SPARE_BYTES
    if len(members) > _MAX_FILES or total > room:
        raise InputError(
            f"{path}: found {len(members)} files of {total / 1e9:.1f} GB, expected what {folder.parent} "
            f"has room for ({max(room, 0) / 1e9:.1f} GB)"
        )


def _recording_in(path: Path, folder: Path, is_recording: Callable[[Path], bool]) -> Path:
    level = [folder]
    for _ in range(4):
        found = [p for p in level if is_recording(p)]
        if len(found) > 1:
            names = ", ".join(str(p.relative_to(folder)) for p in found[:3])
            raise InputError(
                f"{path}: found {len(found)} recordings ({names}, ...), expected one: unpack it yourself"
            )
        if found:
            return found[0]
        level = sorted(child for p in level if p.is_dir() for child in p.iterdir())
    raise InputError(f"{path}: found no recording in the archive, expected one, at most three folders deep")
