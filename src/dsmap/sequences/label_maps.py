"""What `--label-map` names: NYU40, ScanNet, or a file of ids, names and colours."""

import csv
import difflib
import re
from pathlib import Path
from typing import Any

from dsmap.classes import CLASS_NAMES, NUM_CLASSES, NYU40_NAMES, NYU40_TO_13, VOID
from dsmap.errors import InputError
from dsmap.limits import MAX_VALUES_BYTES
from dsmap.plain import brief, parse_yaml
from dsmap.reading import read_bytes
from dsmap.sequences.label_images import LabelMap
from dsmap.sequences.label_sets import SCANNET_LABEL_MAP, scannet_table

_VOID_NAMES = ("void", "unlabeled", "unlabelled", "unknown", "ignore", "background", "unannotated", "none")
_IDS = 65536
_NAMES = {
    **{name.replace(" ", ""): int(label) for name, label in zip(NYU40_NAMES, NYU40_TO_13, strict=True)},
    **{name: i for i, name in enumerate(CLASS_NAMES)},
    **dict.fromkeys(_VOID_NAMES, VOID),
}
"""Names of the 13 classes and of NYU40, without blanks, to classes."""
_HEX = re.compile(r"#([0-9a-fA-F]{6})")
_COLUMNS_ID = ("id", "label", "index", "value", "class_id")
_COLUMNS_CLASS = ("class", "nyu13", "to", "name", "category")


def load_label_map(name: str | None, recording: Path) -> LabelMap:
    """The label map that `--label-map` names; None: label images hold the 13 classes.

    Args:
        name: `nyu40`, `scannet` (raw ids, by ScanNet's label file in or above the recording), or a file: ScanNet's
            label file, YAML or JSON of `id: class` (also `"#rrggbb": class`, or a list like classes.json), or lines
            of `id class` or `r g b class`. A class is the name of one of the 13 or of NYU40, or a number 0..13.
        recording: where ScanNet's label file is looked for.

    Raises:
        InputError: no such file, or it names no class that is known.
    """
    if name is None:
        return LabelMap()
    if name == "nyu40":
        return LabelMap({i: int(c) for i, c in enumerate(NYU40_TO_13)}, name=name)
    if name == "scannet":
        return _scannet(_find_scannet(recording), name)
    path = Path(name)
    if not path.is_file():
        raise InputError(
            f"--label-map {name}: no such file, expected nyu40, scannet or a file of ids and classes"
        )
    if path.suffix.lower() == ".tsv" and "nyu40id" in _text(path).partition("\n")[0]:
        return _scannet(path, name)
    rows = _rows(path)
    if not rows:
        raise InputError(f"{path}: found no line of an id and a class, expected for example `3: chair`")
    classes, colours = {}, {}
    for key, value in rows:
        label, stored = _class(path, value), _key(path, key)
        if isinstance(stored, int):
            classes[stored] = label
        else:
            colours[stored] = label
    return LabelMap(classes, colours, name)


def _scannet(path: Path, name: str) -> LabelMap:
    return LabelMap({i: int(c) for i, c in enumerate(scannet_table(path))}, name=name)


def _find_scannet(recording: Path) -> Path:
    folder = recording.resolve()
    for place in (folder, *list(folder.parents)[:3], Path.cwd()):
        if (place / SCANNET_LABEL_MAP).is_file():
            return place / SCANNET_LABEL_MAP
    raise InputError(
        f"{recording}: --label-map scannet needs {SCANNET_LABEL_MAP}, expected it in the recording's folder or above"
    )


def _text(path: Path) -> str:
    data = read_bytes(path, "a label map", MAX_VALUES_BYTES)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not readable as text ({error}), expected a label map") from error


def _rows(path: Path) -> list[tuple[Any, Any]]:
    """Pairs of an id or colour and a class."""
    text = _text(path)
    if path.suffix.lower() not in (".yaml", ".yml", ".json"):
        return _lines(text)
    content = parse_yaml(text, path)
    if isinstance(content, dict):
        return [(key, value) for key, value in content.items()]
    if not isinstance(content, list) or not all(isinstance(record, dict) for record in content):
        raise InputError(
            f"{path}: found {type(content).__name__}, expected `id: class` pairs or a list of records"
        )
    return [pair for record in content for pair in _record(path, record)]


def _record(path: Path, record: dict) -> list[tuple[Any, Any]]:
    """By id, and by colour where one is stated."""
    value = next((record[key] for key in _COLUMNS_CLASS if key in record), None)
    if value is None:
        raise InputError(
            f"{path}: found the record {brief(record)}, expected id (or color) and class (or name)"
        )
    keys = [record[key] for key in _COLUMNS_ID if key in record][:1]
    return [(key, value) for key in [*keys, *[record[k] for k in ("color", "colour") if k in record]]]


def _lines(text: str) -> list[tuple[Any, Any]]:
    """Lines of `id class`, `#rrggbb class` or `r g b class`, split by commas, semicolons, tabs, = or blanks."""
    rows = []
    for line in text.splitlines():
        stripped = line.strip()
        if not stripped or (stripped.startswith("#") and not _HEX.match(stripped)):
            continue
        separator = next((s for s in ("\t", ";", ",", "=", ":") if s in stripped), None)
        words = next(csv.reader([stripped], delimiter=separator)) if separator else stripped.split()
        words = [word.strip() for word in words if word.strip()]
        if not words or not (words[0].isdigit() or _HEX.fullmatch(words[0])):
            continue  # a header
        numbers = 0
        while numbers < len(words) and words[numbers].isdigit():
            numbers += 1
        if numbers >= 3 and len(words) > 3:
            rows.append((words[:3], " ".join(words[3:])))
        elif len(words) >= 2:
            rows.append((words[0], words[1] if separator or numbers == 2 else " ".join(words[1:])))
    return rows


def _key(path: Path, key: Any) -> int | tuple[int, int, int]:
    """A stored id, or a colour."""
    if isinstance(key, str) and (match := _HEX.fullmatch(key.strip())):
        code = int(match[1], 16)
        return code >> 16, (code >> 8) & 255, code & 255
    if isinstance(key, str) and key.count(",") == 2:
        key = key.strip("()[] ").split(",")
    try:
        values = [_id(v) for v in (key if isinstance(key, list | tuple) else [key])]
    except (TypeError, ValueError):
        values = []
    if len(values) == 3 and all(0 <= v <= 255 for v in values):
        return values[0], values[1], values[2]
    if len(values) == 1 and 0 <= values[0] < _IDS:
        return values[0]
    raise InputError(
        f"{path}: found {brief(key)}, expected an id of 0..{_IDS - 1}, or a colour like #ff8000 or 255,128,0"
    )


def _id(value: Any) -> int:
    """A whole number, or one as text. Raises ValueError: anything else, a truth value or a fraction included."""
    if isinstance(value, str) or (isinstance(value, int) and not isinstance(value, bool)):
        return int(value)
    raise ValueError(value)


def _class(path: Path, value: Any) -> int:
    """One of the 13, by number or by its name or that of an NYU40 class."""
    text = str(value).strip() if isinstance(value, str | int) and not isinstance(value, bool) else ""
    if text.isascii() and text.isdigit() and int(text) < NUM_CLASSES:
        return int(text)
    name = re.sub(r"[\s_-]", "", text.lower()[:200])
    if name in _NAMES:
        return _NAMES[name]
    if name.removesuffix("s") in _NAMES:
        return _NAMES[name.removesuffix("s")]
    near = difflib.get_close_matches(name, _NAMES, 1)
    meant = f"{near[0]!r}, or " if near else ""
    raise InputError(
        f"{path}: found the class {brief(text)}, expected {meant}0..{NUM_CLASSES - 1} or one of "
        f"{', '.join(CLASS_NAMES)} (or a name of NYU40)"
    )
