"""Writing arrays by name in the safetensors format, straight to the file.

The library writes through a temporary file of its own, which a killed process leaves behind under a random name, and
tells a full disk apart from nothing else. The format (huggingface/safetensors, "Format") is small: 8 bytes of header
length, little endian; a JSON header of dtype, shape and offsets; the arrays, those of the widest type first.
"""

import json
from pathlib import Path

import numpy as np

from dsmap.files import atomic_path
from dsmap.sealed import CHECKSUM, WORDS, checksum_of

_NAMES = {
    "float64": "F64", "float32": "F32", "float16": "F16", "int64": "I64", "int32": "I32", "int16": "I16",
    "int8": "I8", "uint64": "U64", "uint32": "U32", "uint16": "U16", "uint8": "U8", "bool": "BOOL",
}  # fmt: skip
_ALIGNMENT = 8


def write_tensors(
    path: Path | str, arrays: dict[str, np.ndarray], metadata: dict[str, str], durable: bool = False
) -> None:
    """Write a safetensors file with a checksum (`sealed`); it is whole or absent.

    Args:
        arrays: by name, of NumPy's usual types.
        metadata: the header's `__metadata__`.
        durable: wait for the disk before an older file goes.

    Raises:
        WriteError: the disk is full, or the folder cannot be written.
    """
    ordered = sorted(arrays.items(), key=lambda item: (-item[1].dtype.alignment, item[0]))
    words = dict(sorted(metadata.items()))
    header: dict[str, object] = {WORDS: words}
    end = 0
    for name, array in ordered:
        begin, end = end, end + array.nbytes
        header[name] = {
            "dtype": _NAMES[array.dtype.name], "shape": list(array.shape), "data_offsets": [begin, end],
        }  # fmt: skip
    words[CHECKSUM] = checksum_of(header, (_bytes(array) for _, array in ordered))
    text = json.dumps(header, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % _ALIGNMENT)
    with atomic_path(path, durable=durable) as temporary, open(temporary, "wb") as file:
        file.write(len(text).to_bytes(8, "little"))
        file.write(text)
        for _, array in ordered:
            file.write(_bytes(array))


def _bytes(array: np.ndarray) -> memoryview:
    return np.ascontiguousarray(array).reshape(-1).view(np.uint8).data if array.size else memoryview(b"")
