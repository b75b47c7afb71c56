"""Kinds of damage to files: bytes, lines, values, headers, and what lies where a file is expected.

A kind is a function of a random generator and a file's path, which it changes in place; it raises `NotApplicable` where
the file is none of its kind. The same generator gives the same damage.
"""

import json
import os
import re
import shutil
import sqlite3
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

Rng = np.random.Generator
Kind = Callable[[Rng, Path], None]


class NotApplicable(Exception):
    """This kind does nothing to such a file."""


TEXT = (
    ".txt",
    ".yaml",
    ".yml",
    ".json",
    ".csv",
    ".tsv",
    ".log",
    ".obj",
    ".mtl",
    ".xml",
    ".cfg",
    ".gltf",
    ".pincam",
    ".traj",
)
NUMBERS = (
    "nan",
    "inf",
    "-inf",
    "-1",
    "0",
    "1e308",
    "-1e308",
    "1e-308",
    "12345678901234567890",
    "9" * 400,
    "",
    "0x10",
    "1_000",
    "1,5",
    "١٢",
    "--1",
    "1e",
    "true",
    "None",
    "2020-01-01",
    "1e12",
    "-0.0",
)
VALUES: tuple[Any, ...] = (
    None, True, False, -1, 0, 0.5, float("nan"), float("inf"), float("-inf"), 1e308, -1e308, 10**20, -(10**20), 10**400,
    "", "text", "☃\u202e", "../../etc", "/dev/zero", "a" * 5000, "\0", [], {}, [1], [[]], {"a": 1}, [0] * 3000, [1, 2, 3, 4, 5, 6, 7, 8, 9],
    {"": None}, "nan", "1", 1, 2, 3, 1e-30,
)  # fmt: skip


def _read(path: Path) -> bytearray:
    data = bytearray(path.read_bytes())
    if not data:
        raise NotApplicable
    return data


def _write(path: Path, data: bytes | bytearray | str) -> None:
    path.unlink()
    path.write_bytes(data.encode("utf-8", "surrogatepass") if isinstance(data, str) else bytes(data))


def _span(rng: Rng, size: int, most: int = 400) -> tuple[int, int]:
    """A stretch of bytes; one in three lies in the first 256, where headers are."""
    begin = int(rng.integers(min(size, 256))) if rng.random() < 0.34 else int(rng.integers(size))
    return begin, min(size, begin + 1 + int(rng.integers(most)))


# Bytes -------------------------------------------------------------------------------------------------------------


def flip_bits(rng: Rng, path: Path) -> None:
    data = _read(path)
    for _ in range(int(rng.integers(1, 9))):
        data[_span(rng, len(data))[0]] ^= 1 << int(rng.integers(8))
    _write(path, data)


def random_bytes(rng: Rng, path: Path) -> None:
    data = _read(path)
    a, b = _span(rng, len(data), 64)
    data[a:b] = rng.bytes(b - a)
    _write(path, data)


def truncate(rng: Rng, path: Path) -> None:
    data = _read(path)
    _write(path, data[: int(rng.integers(len(data)))])


def truncate_a_little(rng: Rng, path: Path) -> None:
    data = _read(path)
    _write(path, data[: -int(rng.integers(1, 9))])


def zero_run(rng: Rng, path: Path) -> None:
    data = _read(path)
    a, b = _span(rng, len(data))
    data[a:b] = bytes(b - a)
    _write(path, data)


def ones_run(rng: Rng, path: Path) -> None:
    data = _read(path)
    a, b = _span(rng, len(data), 16)
    data[a:b] = b"\xff" * (b - a)
    _write(path, data)


def insert(rng: Rng, path: Path) -> None:
    data = _read(path)
    a = _span(rng, len(data))[0]
    data[a:a] = rng.bytes(int(rng.integers(1, 200)))
    _write(path, data)


def delete_run(rng: Rng, path: Path) -> None:
    data = _read(path)
    a, b = _span(rng, len(data))
    del data[a:b]
    _write(path, data)


def repeat_run(rng: Rng, path: Path) -> None:
    data = _read(path)
    a, b = _span(rng, len(data))
    data[b:b] = data[a:b] * int(rng.integers(1, 6))
    _write(path, data)


def swap_runs(rng: Rng, path: Path) -> None:
    data = _read(path)
    (a, b), (c, _) = sorted((_span(rng, len(data)), _span(rng, len(data))))
    size = min(b - a, len(data) - c, c - a)
    data[a : a + size], data[c : c + size] = data[c : c + size], data[a : a + size]
    _write(path, data)


def number_in_header(rng: Rng, path: Path) -> None:
    """A 16, 32 or 64 bit number in the first 200 bytes is one that lengths should not be."""
    data = _read(path)
    code = str(rng.choice(["<H", ">H", "<I", ">I", "<Q", ">Q"]))
    size = struct.calcsize(code)
    if len(data) < size + 1:
        raise NotApplicable
    at = int(rng.integers(min(200, len(data) - size)))
    top = 2 ** (8 * size)
    value = int(rng.choice(np.array([0, 1, top // 2 - 1, top // 2, top - 1, 0x7FFFFFF, 60000], object)))
    data[at : at + size] = struct.pack(code, value % top)
    _write(path, data)


def empty(rng: Rng, path: Path) -> None:
    _write(path, b"")


def noise(rng: Rng, path: Path) -> None:
    _write(path, rng.bytes(int(rng.integers(1, 5000))))


def append(rng: Rng, path: Path) -> None:
    _write(path, _read(path) + rng.bytes(int(rng.integers(1, 3000))))


def sparse(rng: Rng, path: Path) -> None:
    """What was there, then holes up to 3 GB."""
    os.truncate(path, 3 << 30)


# What lies there instead --------------------------------------------------------------------------------------------


def missing(rng: Rng, path: Path) -> None:
    path.unlink()


def folder_instead(rng: Rng, path: Path) -> None:
    path.unlink()
    path.mkdir()


def link_to_itself(rng: Rng, path: Path) -> None:
    path.unlink()
    path.symlink_to(path.name)


def link_to_nothing(rng: Rng, path: Path) -> None:
    path.unlink()
    path.symlink_to("nowhere")


def link_to_parent(rng: Rng, path: Path) -> None:
    path.unlink()
    path.symlink_to("..")


def fifo(rng: Rng, path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def endless(rng: Rng, path: Path) -> None:
    path.unlink()
    path.symlink_to("/dev/zero")


def another_file(rng: Rng, path: Path) -> None:
    """The content of another file of the same folders."""
    others = sorted(p for p in _root(path).rglob("*") if p.is_file() and not p.is_symlink() and p != path)
    if not others:
        raise NotApplicable
    _write(path, others[int(rng.integers(len(others)))].read_bytes())


def other_name(rng: Rng, path: Path) -> None:
    name = str(
        rng.choice(
            ["☃" + path.suffix, path.name.upper() + "x", " " + path.name, "a\nb" + path.suffix, "x" * 200]
        )
    )
    if (path.parent / name).exists():
        raise NotApplicable
    path.rename(path.parent / name)


def crowd(rng: Rng, path: Path) -> None:
    """A folder and a loop of links beside the file, named like it."""
    beside = path.with_name("0" + path.name)
    if beside.exists():
        raise NotApplicable
    if rng.random() < 0.5:
        beside.mkdir()
    else:
        beside.symlink_to(beside.name)


def _root(path: Path) -> Path:
    return path.parents[1] if path.parent.name in ("rgb", "depth", "label", "image", "color") else path.parent


# Text ----------------------------------------------------------------------------------------------------------------


def _text(path: Path) -> str:
    data = _read(path)
    if path.suffix.lower() not in TEXT and (b"\0" in data or len(data) > 200_000 or path.suffix):
        raise NotApplicable
    try:
        return data.decode()
    except UnicodeDecodeError:
        raise NotApplicable from None


def number(rng: Rng, path: Path) -> None:
    """One number is another word."""
    text = _text(path)
    found = list(re.finditer(r"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?", text))
    if not found:
        raise NotApplicable
    one = found[int(rng.integers(len(found)))]
    _write(path, text[: one.start()] + str(rng.choice(NUMBERS)) + text[one.end() :])


def all_numbers_of_a_column(rng: Rng, path: Path) -> None:
    lines, column, word = _text(path).split("\n"), int(rng.integers(5)), str(rng.choice(NUMBERS))
    split = [line.split(" ") for line in lines]
    for words in split:
        if len(words) > column and words[0][:1] != "#":
            words[column] = word
    _write(path, "\n".join(" ".join(words) for words in split))


def lines(rng: Rng, path: Path) -> None:
    """Lines are lost, doubled, exchanged, or in another order."""
    found = _text(path).split("\n")
    if len(found) < 2:
        raise NotApplicable
    i, j = (int(k) for k in rng.integers(len(found), size=2))
    match int(rng.integers(5)):
        case 0:
            del found[i]
        case 1:
            found.insert(i, found[j])
        case 2:
            found[i], found[j] = found[j], found[i]
        case 3:
            rng.shuffle(found)
        case _:
            found = found * 3
    _write(path, "\n".join(found))


def fields(rng: Rng, path: Path) -> None:
    """Words of a line are lost, doubled or exchanged."""
    found = _text(path).split("\n")
    i = int(rng.integers(len(found)))
    words = found[i].split(" ")
    if len(words) < 2:
        raise NotApplicable
    a, b = (int(k) for k in rng.integers(len(words), size=2))
    match int(rng.integers(4)):
        case 0:
            del words[a]
        case 1:
            words.insert(a, words[b])
        case 2:
            words[a], words[b] = words[b], words[a]
        case _:
            words[a] = ""
    found[i] = " ".join(words)
    _write(path, "\n".join(found))


def characters(rng: Rng, path: Path) -> None:
    """A character that does not belong there; another encoding; endless lines."""
    text = _text(path)
    at = int(rng.integers(len(text) + 1))
    match int(rng.integers(8)):
        case 0:
            text = text[:at] + "\0" + text[at:]
        case 1:
            text = text[:at] + "☃\u202e\ufeff" + text[at:]
        case 2:
            _write(path, text.encode("utf-16"))
            return
        case 3:
            text = text[:at] + "9" * 100_000 + text[at:]
        case 4:
            text = text.replace("\n", "\r\n")
        case 5:
            text = text.replace("\n", " ")
        case 6:
            text = text[:at] + "\t:{[&*!%@`" + text[at:]
        case _:
            _write(path, text[:at].encode() + b"\xff\xfe\xc3" + text[at:].encode())
            return
    _write(path, text)


# Values of YAML and JSON -----------------------------------------------------------------------------------------------


def _places(content: Any, at: tuple = ()) -> list[tuple]:
    """Every place in nested lists and dicts."""
    found = [at]
    items = (
        content.items()
        if isinstance(content, dict)
        else enumerate(content)
        if isinstance(content, list)
        else ()
    )
    for key, value in list(items)[:60]:
        found += _places(value, (*at, key))
    return found


def _set(content: Any, at: tuple, value: Any) -> Any:
    if not at:
        return value
    inner = content
    for key in at[:-1]:
        inner = inner[key]
    inner[at[-1]] = value
    return content


def _get(content: Any, at: tuple) -> Any:
    for key in at:
        content = content[key]
    return content


def damaged_values(rng: Rng, content: Any) -> Any:
    """Plain values with one of them of another kind, lost, nested, or exchanged with another."""
    places = _places(content)
    at = places[int(rng.integers(len(places)))]
    other = places[int(rng.integers(len(places)))]
    match int(rng.integers(9)):
        case 0 | 1 | 2 | 3:
            return _set(content, at, VALUES[int(rng.integers(len(VALUES)))])
        case 4:
            if at and isinstance(holder := _get(content, at[:-1]), dict):
                del holder[at[-1]]
            return content
        case 5:
            holder = _get(content, at)
            if isinstance(holder, dict):
                holder[str(rng.choice(["unknown", "", "__class__", "name", "0"]))] = 1
            return content
        case 6:
            value = _get(content, at)
            return _set(content, at, [value])
        case 7:
            deep: Any = 1
            for _ in range(int(rng.choice([60, 3000]))):
                deep = [deep] if rng.random() < 0.5 else {"a": deep}
            return _set(content, at, deep)
        case _:
            if at[: len(other)] == other or other[: len(at)] == at:
                raise NotApplicable
            a, b = _get(content, at), _get(content, other)
            return _set(_set(content, at, b), other, a)


def values(rng: Rng, path: Path) -> None:
    """One value of a YAML or JSON file is of another kind."""
    text = _text(path)
    if path.suffix.lower() in (".json", ".gltf"):
        _write(path, _json(damaged_values(rng, json.loads(text))))
    elif path.suffix.lower() in (".yaml", ".yml"):
        _write(path, _json(damaged_values(rng, yaml.safe_load(text))))  # JSON is YAML
    else:
        raise NotApplicable


def _json(content: Any) -> str:
    """JSON with NaN, numbers of 400 digits and any depth."""
    import sys

    limit, digits = sys.getrecursionlimit(), sys.get_int_max_str_digits()
    sys.setrecursionlimit(20_000)
    sys.set_int_max_str_digits(0)
    try:
        return json.dumps(content)
    finally:
        sys.setrecursionlimit(limit)
        sys.set_int_max_str_digits(digits)


def yaml_text(rng: Rng, path: Path) -> None:
    """What only YAML can do: bombs of aliases, dates, tags, doubled keys, several documents."""
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise NotApplicable
    text = _text(path)
    keys = [line for line in text.split("\n") if re.match(r"\w+:\s*\S", line)]
    key = keys[int(rng.integers(len(keys)))] if keys else "a: 1"
    name = key.split(":")[0]
    bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
        f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 9)
    )
    added = [
        bomb, bomb + f"{name}: *a8\n", f"{name}: 2020-01-01\n", f"{name}: 2020-01-01 10:00:00\n", f"{name}: !!python/object/apply:os.system [true]\n",
        f"{name}: !!binary aGVsbG8=\n", f"{name}: !!set {{a, b}}\n", f"{name}: 1:30:00\n", f"{name}: 0b11\n", f"{name}: .nan\n", f"{name}: -.inf\n",
        key + "\n", f"{name}: 9999\n", "---\nb: 1\n", f"{name}: {'9' * 5000}\n", f"{name}: {'[' * 3000}{']' * 3000}\n", f"? [{name}, 1]\n: 2\n", f"{name}: &x [*x]\n",
        f"1: 2\n{name}: ~\n", "<<: {a: 1}\n", f"{name}: 2020-99-99\n", f"{name}: !!timestamp x\n", f"{name}: !!int x\n", f"{name}: !!float ''\n", f"{name}: 1e400\n",
    ]  # fmt: skip
    extra = added[int(rng.integers(len(added)))]
    if rng.random() < 0.5 and keys:
        text = text.replace(key + "\n", "", 1)
    _write(path, text + "\n" + extra)


# Images ------------------------------------------------------------------------------------------------------------------


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
    chunks = _chunks(_read(path))
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
    _write(path, _png(chunks))


def png_chunk(rng: Rng, path: Path) -> None:
    """A chunk whose length lies, is foreign, or a bomb of compressed text."""
    data = bytes(_read(path))
    chunks = _chunks(data)
    match int(rng.integers(4)):
        case 0:
            at = 8 + sum(12 + len(body) for _, body in chunks[:-2])
            _write(path, data[:at] + struct.pack(">I", 2**31 - 1) + data[at + 4 :])
        case 1:
            chunks.insert(1, (b"iCCP", b"x\0\0" + zlib.compress(bytes(50 << 20))))
            _write(path, _png(chunks))
        case 2:
            chunks.insert(1, (b"acTL", struct.pack(">II", 2**31 - 1, 0)))
            _write(path, _png(chunks))
        case _:
            _write(path, _png([c for c in chunks if c[0] != b"IDAT"]))


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
    _write(path, data.tobytes())


# Arrays in containers --------------------------------------------------------------------------------------------------------


def damaged_array(rng: Rng, array: np.ndarray) -> np.ndarray:
    """Of other values, shape or type."""
    out = array.copy()
    kind = int(rng.integers(9))
    if kind <= 2 and out.size:
        special = [np.nan, np.inf, -np.inf, 1e30, -1e30, -1.0, 0.0, 1e308]
        flat = out.reshape(-1)
        some = rng.integers(len(flat), size=max(1, len(flat) // int(rng.choice([1, 10, 1000]))))
        value = special[int(rng.integers(len(special)))]
        with np.errstate(all="ignore"):
            if out.dtype.kind == "f":
                flat[some] = value
            elif out.dtype.kind in "iu":
                info = np.iinfo(out.dtype)
                flat[some] = int(rng.choice(np.array([info.max, info.min, 0, 1, info.max // 2], object)))
        return out
    if kind == 3:
        return out.reshape(-1)[: max(0, out.size - 1)]
    if kind == 4:
        return out[:0] if out.ndim else out.reshape(1)
    if kind == 5:
        return out[None]
    if kind == 6:
        return out.astype(np.float64 if out.dtype != np.float64 else np.int32)
    if kind == 7 and out.ndim:
        return np.concatenate([out, out])
    return out.swapaxes(0, -1) if out.ndim > 1 else out[::-1] if out.ndim else out


def npy(rng: Rng, path: Path) -> None:
    """Arrays of .npy and .npz."""
    if path.suffix == ".npy":
        array = np.load(path)
        path.unlink()
        np.save(path, damaged_array(rng, array))
    elif path.suffix == ".npz":
        with np.load(path) as file:
            arrays = dict(file)
        name = str(rng.choice(sorted(arrays)))
        arrays[name] = damaged_array(rng, arrays[name])
        path.unlink()
        np.savez(path, **arrays)
    else:
        raise NotApplicable


def _safetensors(path: Path) -> tuple[dict, bytes]:
    if path.suffix != ".safetensors":
        raise NotApplicable
    data = bytes(_read(path))
    (size,) = struct.unpack("<Q", data[:8])
    return json.loads(data[8 : 8 + size]), data[8 + size :]


def _write_safetensors(path: Path, header: dict, body: bytes) -> None:
    text = _json(header).encode()
    text += b" " * (-len(text) % 8)
    _write(path, struct.pack("<Q", len(text)) + text + body)


def tensor_header(rng: Rng, path: Path) -> None:
    """The header of a safetensors file lies about a tensor."""
    header, body = _safetensors(path)
    names = sorted(name for name in header if name != "__metadata__")
    name = names[int(rng.integers(len(names)))]
    match int(rng.integers(6)):
        case 0:
            del header[name]
        case 1:
            header[name]["dtype"] = str(
                rng.choice(["F16", "I64", "U8", "BF16", "BOOL", "F64", "F8_E4M3", "X"])
            )
        case 2:
            header[name]["shape"] = [
                int(v) for v in rng.choice([0, 1, 2**40, 2**63, 7], int(rng.integers(4)))
            ]
        case 3:
            header[name + "x"] = header.pop(name)
        case 4:
            header[name]["data_offsets"] = [0, int(rng.choice([0, 8, 2**62]))]
        case _:
            header = damaged_values(rng, header)
    if not isinstance(header, dict):
        raise NotApplicable
    _write_safetensors(path, header, body)


def tensor_words(rng: Rng, path: Path) -> None:
    """One plain value in the header of a safetensors file; in a third of the cases as if without checksum."""
    header, body = _safetensors(path)
    words = header.get("__metadata__", {})
    if rng.random() < 0.34:
        _unseal(words)
    name = str(rng.choice(sorted(words)))
    try:
        words[name] = _json(damaged_values(rng, json.loads(words[name])))
    except ValueError:
        words[name] = str(rng.choice(["", "dsmap.map/1", "x", "\0", "dsmap.dsnet.training"]))
    _write_safetensors(path, header, body)


def tensor_values(rng: Rng, path: Path) -> None:
    """One tensor of other values, shape or type, in a file as it was before there were checksums."""
    from safetensors import safe_open
    from safetensors.numpy import save_file

    if path.suffix != ".safetensors":
        raise NotApplicable
    with safe_open(path, "np") as file:
        words = dict(file.metadata() or {})
        arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    _unseal(words)
    for _ in range(int(rng.integers(1, 3))):
        name = str(rng.choice(sorted(arrays)))
        arrays[name] = np.ascontiguousarray(damaged_array(rng, arrays[name]))
    path.unlink()
    save_file(arrays, path, metadata=words)


def _unseal(words: dict) -> None:
    """The words of a file that was written before there were checksums."""
    for name in [name for name in words if "checksum" in name]:
        del words[name]
    if "format" in words:
        words["format"] = {"dsmap.map/3": "dsmap.map/2"}.get(
            words["format"], words["format"].removesuffix("/2")
        )


def hdf5(rng: Rng, path: Path) -> None:
    """A data set of other values, shape or type, lost, or a group."""
    import h5py

    try:
        file = h5py.File(path, "r+")
    except OSError:
        raise NotApplicable from None
    with file:
        names: list[str] = []
        file.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
        if not names:
            raise NotApplicable
        name = names[int(rng.integers(len(names)))]
        array = file[name][()]
        del file[name]
        match int(rng.integers(6)):
            case 0:
                file.create_group(name)
            case 1:
                pass
            case 2:
                file[name] = "text"
            case 3:
                file.create_dataset(name, (2**20, 2**16), "u1", chunks=(1024, 1024))
            case _:
                if array.dtype.kind == "O":
                    file[name] = np.zeros(array.shape)
                else:
                    file[name] = damaged_array(rng, array)


def sqlite(rng: Rng, path: Path) -> None:
    """Rows of a data base are NULL, of another type, or their table is gone."""
    if not path.read_bytes()[:16].startswith(b"SQLite format 3"):
        raise NotApplicable
    with sqlite3.connect(path) as base:
        tables = [row[0] for row in base.execute("select name from sqlite_master where type = 'table'")]
        table = str(rng.choice(sorted(tables)))
        columns = [row[1] for row in base.execute(f'pragma table_info("{table}")')]
        column = str(rng.choice(sorted(columns)))
        value: Any = [None, b"", b"\xff" * 40, "text", -1, 10**18, 1e308][int(rng.integers(7))]
        try:
            match int(rng.integers(4)):
                case 0:
                    base.execute(f'drop table "{table}"')
                case 1:
                    base.execute(f'delete from "{table}" where rowid % 2 = 0')
                case 2:
                    base.execute(f'update "{table}" set "{column}" = ? where rowid = 2', (value,))
                case _:
                    base.execute(f'update "{table}" set "{column}" = ?', (value,))
        except sqlite3.Error:
            raise NotApplicable from None
    base.close()


def archive(rng: Rng, path: Path) -> None:
    """Members of a zip that leave the folder, are doubled, links, or bombs."""
    if path.suffix != ".zip":
        raise NotApplicable
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as file:
        names = file.namelist()
        name = names[int(rng.integers(len(names)))]
        match int(rng.integers(4)):
            case 0:
                file.writestr("../../outside.txt", "x")
            case 1:
                file.writestr(name, file.read(name))
            case 2:
                file.writestr("bomb.bin", bytes(200 << 20))
            case _:
                link = zipfile.ZipInfo("link")
                link.external_attr = 0o120777 << 16
                file.writestr(link, "/etc/passwd")


# Meshes and scenes --------------------------------------------------------------------------------------------------------------


def ply(rng: Rng, path: Path) -> None:
    """A header of a PLY that lies, doubled properties, or odd values in its body."""
    if path.suffix != ".ply":
        raise NotApplicable
    data = bytes(_read(path))
    head, mark, body = data.partition(b"end_header\n")
    rows = head.decode("latin-1").split("\n")
    counts = [i for i, row in enumerate(rows) if row.startswith("element")]
    properties = [i for i, row in enumerate(rows) if row.startswith("property")]
    if not counts or not properties:
        raise NotApplicable
    i, k = counts[int(rng.integers(len(counts)))], properties[int(rng.integers(len(properties)))]
    match int(rng.integers(7)):
        case 0:
            rows[i] = " ".join(
                [*rows[i].split(" ")[:2], str(rng.choice(["0", "-1", "999999999999", "nan", "1e9", ""]))]
            )
        case 1:
            rows.insert(k, rows[k])
        case 2:
            del rows[k]
        case 3:
            words = rows[k].split(" ")
            words[-2] = str(rng.choice(["double", "uchar", "int", "list", "float128", ""]))
            rows[k] = " ".join(words)
        case 4:
            rows[1] = str(rng.choice(["format ascii 1.0", "format binary_big_endian 1.0", "format x"]))
        case _:
            odd = np.array(rng.choice([np.nan, np.inf, 1e12, -1e30]), np.float32).tobytes()
            at = int(rng.integers(max(1, len(body) // 4))) * 4
            body = body[:at] + odd + body[at + 4 :]
    _write(path, "\n".join(rows).encode("latin-1") + mark + body)


def glb(rng: Rng, path: Path) -> None:
    """A value of the JSON in a GLB."""
    if path.suffix != ".glb":
        raise NotApplicable
    data = bytes(_read(path))
    (size,) = struct.unpack("<I", data[12:16])
    text = _json(damaged_values(rng, json.loads(data[20 : 20 + size]))).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + size :]
    _write(
        path, data[:8] + struct.pack("<III", 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text + rest
    )


def xml(rng: Rng, path: Path) -> None:
    """An attribute of an XML file, or an element that multiplies."""
    if path.suffix != ".xml":
        raise NotApplicable
    text = _text(path)
    found = list(re.finditer(r'="([^"]*)"', text))
    one = found[int(rng.integers(len(found)))]
    odd = [
        "nan",
        "inf",
        "-1",
        "0",
        "1e308",
        "1e12 1e12 1e12",
        "",
        "☃",
        "9" * 50,
        "0 0 0",
        "nothere",
        "1 2",
        "../x.png",
    ]
    replicate = (
        '<worldbody><replicate count="100000000" offset="1 0 0"><geom size="1" name="table"/></replicate>'
    )
    if rng.random() < 0.15:
        text = text.replace("<worldbody>", replicate)
    elif rng.random() < 0.1:
        text = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>' + text
    else:
        text = text[: one.start(1)] + str(rng.choice(odd)) + text[one.end(1) :]
    _write(path, text)


BYTES: tuple[Kind, ...] = (
    flip_bits, random_bytes, truncate, truncate_a_little, zero_run, ones_run, insert, delete_run, repeat_run, swap_runs,
    number_in_header, empty, noise, append,
)  # fmt: skip
PLACES: tuple[Kind, ...] = (
    missing, folder_instead, link_to_itself, link_to_nothing, link_to_parent, fifo, endless, another_file, other_name, crowd,
    sparse,
)  # fmt: skip
WORDS: tuple[Kind, ...] = (number, number, all_numbers_of_a_column, lines, fields, characters)
CONTENT: tuple[Kind, ...] = (
    values, values, values, yaml_text, yaml_text, png_header, png_chunk, other_image, npy, tensor_header, tensor_words, tensor_words,
    tensor_values, tensor_values, hdf5, sqlite, archive, ply, ply, glb, glb, xml, xml,
)  # fmt: skip
GROUPS = {"bytes": BYTES, "places": PLACES, "words": WORDS, "content": CONTENT}


def applicable(path: Path) -> list[Kind]:
    """Content and words apply to some files only: those that may, each as often as it should be tried."""
    copy = path.with_name("." + path.name + ".probe" + path.suffix)
    found: list[Kind] = []
    for kind in (*WORDS, *CONTENT):
        for seed in range(3):
            shutil.copy(path, copy)
            try:
                kind(np.random.default_rng(seed), copy)
                found.append(kind)
                break
            except Exception:  # the file is none of the kind's
                continue
            finally:
                copy.unlink(missing_ok=True)
    return found


def damage(rng: Rng, path: Path, special: list[Kind]) -> str:
    """Damage one file; returns the kind's name."""
    for _ in range(20):
        share = rng.random()
        pool = special if special and share < 0.62 else BYTES if share < 0.9 else PLACES
        kind = pool[int(rng.integers(len(pool)))]
        keep = path.read_bytes()
        try:
            kind(rng, path)
            return kind.__name__
        except Exception:  # the file is none of the kind's, or was damaged before
            if path.is_file():
                path.unlink()
            path.write_bytes(keep)
    truncate(rng, path)
    return "truncate"
