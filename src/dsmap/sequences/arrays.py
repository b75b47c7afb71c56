"""Images stored as arrays: NumPy's .npy and .npz, and OpenEXR."""

import io
import math
import tempfile
import zipfile
from typing import IO

import numpy as np

from dsmap.errors import InputError
from dsmap.limits import MAX_ARRAY_BYTES
from dsmap.reading import DECODER_ERRORS
from dsmap.sequences.extra import optional_library

_NUMPY = (b"\x93NUMPY", b"PK\x03\x04")
_EXR = b"\x76\x2f\x31\x01"
_DEPTH_CHANNELS = ("Z", "depth", "Y", "V", "R")
"""Of EXR files, those first that are taken first."""


def is_array(data: bytes) -> bool:
    """Whether a file's bytes are such an array."""
    return data.startswith((*_NUMPY, _EXR))


def read_array(where: str, data: bytes) -> np.ndarray:
    """The array of a file's bytes, shape (H, W) or (H, W, channels).

    Args:
        where: the file, for messages.

    Raises:
        InputError: the file is damaged, or holds nothing of the shape of an image.
    """
    if data.startswith(_EXR):
        return _exr(where, data)
    try:
        _check_size(where, data)
        loaded = np.load(io.BytesIO(data), allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            arrays = [loaded]
        else:
            arrays = [loaded[name] for name in sorted(loaded.files, key=lambda name: name != "depth")]
    except DECODER_ERRORS as error:
        raise InputError(
            f"{where}: found an array that does not decode ({error}), expected a whole file"
        ) from error
    found = next((a.squeeze() for a in arrays if a.squeeze().ndim in (2, 3) and a.dtype.kind in "iuf"), None)
    if found is None:
        raise InputError(f"{where}: found no array of the shape of an image, expected one of depth")
    return found


def _check_size(where: str, data: bytes) -> None:
    """Look at what the headers promise before memory is asked for."""
    if not data.startswith(b"PK"):
        _check_header(where, io.BytesIO(data))
        return
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = archive.infolist()
        promised = sum(member.file_size for member in members)
        if promised > MAX_ARRAY_BYTES:
            raise _too_large(where, promised)
        for member in members:
            if member.filename.endswith(".npy"):
                with archive.open(member) as stream:
                    _check_header(where, stream)


def _check_header(where: str, stream: IO[bytes]) -> None:
    version = np.lib.format.read_magic(stream)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(stream)
    promised = math.prod(shape) * dtype.itemsize
    if promised > MAX_ARRAY_BYTES or min(shape, default=0) < 0:
        raise _too_large(where, promised)


def _too_large(where: str, promised: int) -> InputError:
    return InputError(
        f"{where}: found an array of {promised:,} bytes, expected an image of at most {MAX_ARRAY_BYTES:,}"
    )


def _exr(where: str, data: bytes) -> np.ndarray:
    library = optional_library("OpenEXR", where, "an EXR image")
    try:
        with tempfile.NamedTemporaryFile(suffix=".exr") as file:  # the library opens files by name alone
            file.write(data)
            file.flush()
            with library.File(file.name, separate_channels=True) as opened:
                channels = {name: np.array(c.pixels) for name, c in opened.channels().items()}
    except Exception as error:  # whatever the library makes of damaged bytes
        raise InputError(
            f"{where}: found an EXR image that does not decode ({error}), expected a whole file"
        ) from error
    name = next((n for n in _DEPTH_CHANNELS if n in channels), next(iter(channels), None))
    if name is None:
        raise InputError(f"{where}: found no channel, expected one of depth")
    return channels[name]
