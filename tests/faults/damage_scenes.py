"""Damage to meshes and scenes."""

import json
import re
import struct
from pathlib import Path

import numpy as np
from damage_common import NotApplicable, Rng, read, write
from damage_text import text_of
from damage_values import damaged_values, json_text


def ply(rng: Rng, path: Path) -> None:
    """A header of a PLY that lies, doubled properties, or odd values in its body."""
    if path.suffix != ".ply":
        raise NotApplicable
    data = bytes(read(path))
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
    write(path, "\n".join(rows).encode("latin-1") + mark + body)


def glb(rng: Rng, path: Path) -> None:
    """A value of the JSON in a GLB."""
    if path.suffix != ".glb":
        raise NotApplicable
    data = bytes(read(path))
    (size,) = struct.unpack("<I", data[12:16])
    text = json_text(damaged_values(rng, json.loads(data[20 : 20 + size]))).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + size :]
    write(
        path, data[:8] + struct.pack("<III", 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text + rest
    )


def xml(rng: Rng, path: Path) -> None:
    """An attribute of an XML file, or an element that multiplies."""
    if path.suffix != ".xml":
        raise NotApplicable
    text = text_of(path)
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
    write(path, text)
