"""Whether a safetensors file of ours is whole: a checksum over its header and its tensors, kept in its words.

The words are the plain text of a header (`__metadata__`). Formats from before there were checksums still load, with a
warning; a file of a format with checksums is refused where its checksum is missing or wrong.
"""

import hashlib
import json
import struct
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from dsmap.errors import InputError, InputWarning
from dsmap.plain import brief, parse_json
from dsmap.reading import check_plain, reading

CHECKSUM = "checksum"
"""The word that holds it."""
WORDS = "__metadata__"
_MAX_HEADER = 100 << 20
"""safetensors' own bound [bytes]."""
_BLOCK = 1 << 22


def checksum_of(header: Mapping[str, Any], parts: Iterable[Any]) -> str:
    """SHA-256 of a header without its checksum, and of the tensors' bytes in the file's order."""
    words = {name: text for name, text in header.get(WORDS, {}).items() if name != CHECKSUM}
    digest = hashlib.sha256(json.dumps({**header, WORDS: words}, sort_keys=True).encode())
    for part in parts:
        digest.update(part)
    return f"sha256:{digest.hexdigest()}"


def read_words(
    path: Path,
    expected: str,
    formats: tuple[str, ...],
    *,
    with_tensors: bool = True,
    is_trusted: bool = False,
) -> dict[str, str]:
    """The words of a safetensors file, once it is known to be whole.

    Args:
        expected: what the file should be, for messages.
        formats: names that its word `format` may have; the first has a checksum, the others are older.
        with_tensors: whether the tensors will be read: only then is the checksum held against them.
        is_trusted: it came with dsmap: no warning where it is of an older format.

    Raises:
        InputError: no such file, damaged, of another format, without or with a wrong checksum.
    """
    check_plain(path, expected)
    with reading(path, expected), path.open("rb") as file:
        header = _header(path, file, expected)
        words = header.get(WORDS, {})
        if not isinstance(words, dict) or not all(isinstance(text, str) for text in words.values()):
            raise InputError(f"{path}: found words that are no text; expected {expected}")
        found = words.get("format")
        if found not in formats:
            raise InputError(
                f"{path}: format is {'not stated' if found is None else brief(found)}; expected {formats[0]!r}, "
                f"{expected}"
            )
        stated = words.get(CHECKSUM)
        if stated is None and found == formats[0]:
            raise InputError(f"{path}: damaged (its checksum is missing); expected {expected}")
        if (
            stated is not None
            and with_tensors
            and stated != checksum_of(header, iter(lambda: file.read(_BLOCK), b""))
        ):
            raise InputError(f"{path}: damaged (its checksum is wrong); expected {expected}")
    if stated is None and with_tensors and not is_trusted:
        text = f"{path}: written by an older dsmap, without a checksum: damage in it would not be noticed"
        warnings.warn(text, InputWarning, stacklevel=3)
    return words


def _header(path: Path, file: BinaryIO, expected: str) -> dict[str, Any]:
    start = file.read(8)
    size = struct.unpack("<Q", start)[0] if len(start) == 8 else 0
    if not 2 <= size <= min(_MAX_HEADER, path.stat().st_size - 8):
        raise InputError(
            f"{path}: damaged or not a safetensors file (a header of {size} bytes); expected {expected}"
        )
    header = parse_json(file.read(size), path, expected)
    if not isinstance(header, dict):
        raise InputError(f"{path}: damaged or not a safetensors file; expected {expected}")
    return header
