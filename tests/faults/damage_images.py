"""Damage to images."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
from damage_common import NotApplicable, Rng, read, write


def _chunks(data: bytes) -> list[tuple[bytes, bytes]]:
    if not data.startswith(b"\x89PNG"):
        raise NotApplicable
    at, found = 8, []
    while at < len(data):
        size, name = struct.unpack(">I4s", data[at : at + 8])
        found.append((name, data[at + 8 : at + 8 + size]))
        at += 12 + size
    return found


def _png(chunks: list[tuple[bytes, bytes]]) -> bytes:
    out = b"\x89PNG\r\n\x1a\n"
    for name, body in chunks:
        out += struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
    return out


def png_header(rng: Rng, path: Path) -> None:
    """A header that lies about size, depth or colours, its checksum right."""
    chunks = _chunks(read(path))
    width, height, depth, colour, *rest = struct.unpack(">IIBBBBB", chunks[0][1])
    match int(rng.integers(4)):
        case 0:
            width, height = (int(v) for v in rng.choice([0, 1, 60_000, 20_000, 2**31 - 1, 65_535], 2))
        case 1:
            height *= 2
        case 2:
            depth = int(rng.choice([1, 2, 4, 8, 16, 77]))
        case _:
            colour = int(rng.choice([0, 2, 3, 4, 6, 9]))
    chunks[0] = (b"IHDR", struct.pack(">IIBBBBB", width, height, depth, colour, *rest))
    write(path, _png(chunks))


def png_chunk(rng: Rng, path: Path) -> None:
    """A chunk whose length lies, is foreign, or a bomb of compressed text."""
    data = bytes(read(path))
    chunks = _chunks(data)
    match int(rng.integers(4)):
        case 0:
            at = 8 + sum(12 + len(body) for _, body in chunks[:-2])
            write(path, data[:at] + struct.pack(">I", 2**31 - 1) + data[at + 4 :])
        case 1:
            chunks.insert(1, (b"iCCP", b"x\0\0" + zlib.compress(bytes(50 << 20))))
            write(path, _png(chunks))
        case 2:
            chunks.insert(1, (b"acTL", struct.pack(">II", 2**31 - 1, 0)))
            write(path, _png(chunks))
        case _:
            write(path, _png([c for c in chunks if c[0] != b"IDAT"]))


def other_image(rng: Rng, path: Path) -> None:
    """A whole image of another size, type or number of channels, or without any content."""
    if path.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise NotApplicable
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise NotApplicable
    flat = image if image.ndim == 2 else image[..., 0]
    others = [
        np.zeros_like(image), np.full_like(image, np.iinfo(image.dtype).max), image[:-1], image[: len(image) // 2, : len(image) // 2],
        np.ascontiguousarray(image.swapaxes(0, 1)), flat.astype(np.uint8), flat.astype(np.uint16) * 200, np.dstack([flat] * 3).astype(np.uint8),
        np.dstack([flat] * 4).astype(np.uint8), image[:1, :1], np.repeat(image, 2, 0),
        np.random.default_rng(int(rng.integers(99))).integers(0, 255, image.shape).astype(image.dtype),
    ]  # fmt: skip
    other = others[int(rng.integers(len(others)))]
    suffix = ".png" if other.dtype != np.uint8 else path.suffix.lower()
    ok, data = cv2.imencode(suffix, other)
    if not ok:
        raise NotApplicable
    write(path, data.tobytes())
