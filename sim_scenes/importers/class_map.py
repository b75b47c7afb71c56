"""Which of the 13 classes a foreign name or id means: a file of the user's, or NYU40 and everyday words."""

import csv
import fnmatch
import re
from collections.abc import Hashable, Mapping, Sequence
from pathlib import Path

from dsmap.classes import CLASS_NAMES, NYU40_NAMES, NYU40_TO_13
from dsmap.errors import InputError
from dsmap.limits import MAX_VALUES_BYTES
from dsmap.plain import brief, parse_yaml
from dsmap.reading import read_bytes, reason

_WORDS = {
    "bed": "mattress", "books": "book", "ceiling": "roof", "chair": "stool armchair bench seat",
    "floor": "ground carpet rug mat", "picture": "painting poster frame art", "sofa": "couch settee",
    "furniture": "wardrobe cupboard closet drawer drawers fridge oven stove sideboard shelf rack bookcase dishwasher "
                 "nightstand",
    "table": "worktable tabletop", "tv": "screen monitor display", "wall": "walls pillar column",
    "window": "windows glass pane curtains blind",
    "objects": "object lamp light pillow cushion blanket box bag bottle cup mug plate bowl plant vase pot clock mirror "
               "laptop keyboard mouse phone toy ball basket bin trash clothes towel paper sink toilet bathtub person",
}  # fmt: skip
"""Everyday words beside the class names of NYUv2-13 and NYU40."""


class ClassMap:
    """Resolves names and ids; what it cannot resolve it remembers."""

    def __init__(
        self, entries: Mapping[str, int], ids: Mapping[int, int], words: Mapping[str, int], source: str
    ) -> None:
        """Entries are lower-case names or patterns with * and ?; ids are integers; words are looked for in names."""
        self.entries, self.ids, self.words, self.source = dict(entries), dict(ids), dict(words), source
        self.unknown: set[str] = set()

    def resolve(self, keys: Sequence[Hashable]) -> int | None:
        """The class of a thing by the first of its names or ids that is known; None (and remembered) if none is."""
        for key in keys:
            found = self._one(key)
            if found is not None:
                return found
        if "*" in self.entries:
            return self.entries["*"]
        self.unknown.add(repr(keys[0]) if keys else "(nothing)")
        return None

    def _one(self, key: Hashable) -> int | None:
        if isinstance(key, int):
            return self.ids.get(key)
        name = str(key).lower()
        if name in self.entries:
            return self.entries[name]
        for pattern, value in self.entries.items():
            if pattern != "*" and set("*?") & set(pattern) and fnmatch.fnmatchcase(name, pattern):
                return value
        spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", str(key)).lower()
        words = re.findall(r"[a-z]+", spaced)
        pairs = [" ".join(pair) for pair in zip(words, words[1:], strict=False)]
        return next((self.words[w] for w in [*pairs, *reversed(words)] if w in self.words), None)

    def require(self, path: Path) -> None:
        """Raises InputError that lists what had no class, if anything."""
        if self.unknown:
            names = ", ".join(sorted(self.unknown)[:20]) + (" ..." if len(self.unknown) > 20 else "")
            raise InputError(
                f"{path}: found {len(self.unknown)} names or ids without a class in {self.source} ({names}); "
                f"expected each in a class map, or a line '\"*\": void' there for the rest"
            )


def everyday() -> ClassMap:
    """NYU40 ids, and names that contain a word of NYUv2-13, NYU40 or everyday language."""
    words = {name: int(NYU40_TO_13[i]) for i, name in enumerate(NYU40_NAMES)}
    for name, more in _WORDS.items():
        words.update(dict.fromkeys(more.split(), CLASS_NAMES.index(name)))
    words.update({name: i for i, name in enumerate(CLASS_NAMES)})
    return ClassMap(
        {}, {i: int(c) for i, c in enumerate(NYU40_TO_13)}, words, "the built-in names and NYU40 ids"
    )


def own() -> ClassMap:
    """Ids that are those of the 13 classes already."""
    return ClassMap({}, {i: i for i in range(len(CLASS_NAMES))}, {}, "the 13 classes")


def read_class_map(path: Path | str) -> ClassMap:
    """A file of lines "name or id -> class": YAML (a mapping) or CSV (two columns).

    Names may hold * and ?; "*" alone stands for all the rest. A class is a name or id of NYUv2-13 (void = 0).

    Raises:
        InputError: unreadable, not of that form, or a class that does not exist.
    """
    path = Path(path)
    try:
        text = read_bytes(path, "a class map", MAX_VALUES_BYTES).decode("utf-8-sig")
        if path.suffix.lower() in (".csv", ".tsv", ".txt"):
            rows = list(
                csv.reader(text.splitlines(), delimiter="\t" if path.suffix.lower() == ".tsv" else ",")
            )
            content = {row[0].strip(): row[1].strip() for row in rows if len(row) >= 2}
            content = {k: v for k, v in content.items() if v.lower() not in ("class", "label")}  # a heading
        else:
            content = parse_yaml(text, path)
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: not readable as a class map ({reason(error)})") from error
    if not isinstance(content, dict) or not content:
        raise InputError(
            f"{path}: found {type(content).__name__}, expected a mapping of names or ids to classes"
        )
    entries, ids = {}, {}
    for key, value in content.items():
        value = _class(path, value)
        entries[str(key).lower()] = value
        if re.fullmatch(r"-?\d+", str(key)):
            ids[int(key)] = value
    return ClassMap(entries, ids, {}, str(path))


def _class(path: Path, value: object) -> int:
    if str(value).lower() in CLASS_NAMES:
        return CLASS_NAMES.index(str(value).lower())
    if str(value).isdigit() and int(str(value)) < len(CLASS_NAMES):
        return int(str(value))
    raise InputError(f"{path}: found class {brief(value)}, expected one of: {', '.join(CLASS_NAMES)}")
