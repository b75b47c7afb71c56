"""Damage to arrays and to the containers they lie in."""

import json
import sqlite3
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from damage_common import NotApplicable, Rng, read, write
from damage_values import damaged_values, json_text


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
    data = bytes(read(path))
    (size,) = struct.unpack("<Q", data[:8])
    return json.loads(data[8 : 8 + size]), data[8 + size :]


def _write_safetensors(path: Path, header: dict, body: bytes) -> None:
    text = json_text(header).encode()
    text += b" " * (-len(text) % 8)
    write(path, struct.pack("<Q", len(text)) + text + body)


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
        words[name] = json_text(damaged_values(rng, json.loads(words[name])))
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
