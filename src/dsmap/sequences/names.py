"""Which colour image belongs to which depth image, where only their names say it.

Of all the numbers in the names of a folder only those that vary count. They are frame numbers or time stamps
(`frame12`, `1560000083.949189`, `room2_Color_1554370821372.41`, `2021-05-06_000012`, `14-03-02-100`).
"""

import itertools
import re
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.sequences.associate import MAX_DIFFERENCE_S, associate
from dsmap.sequences.images import IMAGE_SUFFIXES
from dsmap.sequences.stamps import FRAMES, Unit, unit_of

COLOUR_FOLDERS = (
    "image",
    "color",
    "rgb",
    "colour",
    "images",
    "img",
    "colors",
    "rgb_images",
    "color_images",
    "cam0",
)
DEPTH_FOLDERS = (
    "aligned_depth", "depth_aligned", "aligned_depth_to_color", "depth_registered", "registered_depth", "depth",
    "depths", "depth_images", "depth_png",
)  # fmt: skip
"""Names of folders of images, in lower case, those first that come first: depth that is seen from the colour camera."""
_SAYS_COLOUR = re.compile(r"colou?r|rgb|image|img")
_SAYS_DEPTH = re.compile(r"depth")
_SAYS_OTHER = re.compile(
    r"depth|vis|view|map|mask|seg|label|sem|inst|normal|conf|infra|(?<![a-z])ir(?![a-z])|pred|right|fish|thumb|gray|grey"
)
"""In the name of what is no colour image; of what is no depth image, without the depth."""
_IN_A_NAME = re.compile(r"(?<![a-z])(?:(depth|dpt|d)|(colou?r|rgb|image|img|frame|c))(?![a-z])")
"""Which image a file of a mixed folder is."""
_NUMBER = re.compile(r"\d+(?:\.\d+)?")
_SECONDS = re.compile(r"1\d{9}")
"""A whole stamp of seconds since 1970."""
_FRACTION_DIGITS = (3, 6)
"""Of what follows after whole seconds: milli- or microseconds where all have so many digits, else nanoseconds."""
_LEAST_FRACTION = 100_000
"""Numbers after whole seconds that span less count frames."""
_MANY = 0.5
"""Names of both folders belong together one by one if at least this share of the fewer are the same."""
_LOSSLESS = (".png", ".tif", ".tiff", ".npy", ".npz", ".exr", ".pgm")


@dataclass
class Named:
    """The images of one folder, each with what varies in its name."""

    files: dict[tuple[Decimal, ...], Path] = field(default_factory=dict)
    """By the numbers that vary, in order."""
    words: dict[tuple[Decimal, ...], tuple[str, ...]] = field(default_factory=dict)
    """The same numbers as written."""
    left_out: list[Path] = field(default_factory=list)
    """Images named in another manner than the most."""
    duplicates: list[tuple[Path, Path]] = field(default_factory=list)
    """Second files of a number: (taken, left out)."""

    @property
    def count(self) -> int:
        """Images found, second ones of a number included."""
        return len(self.files) + len(self.duplicates)


def folder_of(parent: Path, names: Iterable[str]) -> Path | None:
    """The first sub-folder with one of the names, whatever its case, that holds an image; else one named alike."""
    found = {child.name.lower(): child for child in sorted(parent.iterdir()) if child.is_dir()}
    known = next((found[name] for name in names if name in found and images_in(found[name])), None)
    if known is not None:
        return known
    of_depth = names is DEPTH_FOLDERS
    return next((found[name] for name in found if _is_named(name, of_depth) and images_in(found[name])), None)


def _is_named(name: str, of_depth: bool) -> bool:
    """Whether a folder's name says depth, or colour, and nothing else."""
    if not of_depth:
        return _SAYS_COLOUR.search(name) is not None and _SAYS_OTHER.search(name) is None
    rest = _SAYS_DEPTH.sub("", name)
    return rest != name and _SAYS_OTHER.search(rest) is None


def mixed_images(folder: Path) -> tuple[list[Path], list[Path]]:
    """Colour and depth images of one folder that holds both (`color_0001.png`, `depth_0001.png`), in order of name."""
    colour, depth = [], []
    for path in images_in(folder):
        # Both words in a name: the last says what it is (rgbd_room_depth_12).
        words = _IN_A_NAME.findall(path.stem.lower())
        if words:
            (depth if words[-1][0] else colour).append(path)
    return colour, depth


def images_in(folder: Path) -> list[Path]:
    """Image files of a folder in order of name; hidden ones (`._0001.png` of a Mac) are none."""
    return sorted(
        path
        for path in folder.iterdir()
        if path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".")
    )


def named_images(files: list[Path], like: str | None = None) -> Named:
    """Group images by what varies in their names. Of several manners of naming the most frequent is taken.

    Args:
        files: of one folder, in order of name.
        like: manner of naming (`pattern_of`) to prefer where several are as frequent.
    """
    groups: dict[str, list[Path]] = defaultdict(list)
    for path in files:
        groups[pattern_of(path)].append(path)
    if not groups:
        return Named()
    # The plainest name of the most frequent: 00001.png comes before 00001_vis.png.
    chosen = min(groups, key=lambda p: (-len({f.stem for f in groups[p]}), p != like, len(p), p))
    named = Named(left_out=[f for pattern, group in groups.items() if pattern != chosen for f in group])
    numbers = _with_whole_stamps({path: tuple(_NUMBER.findall(path.stem)) for path in groups[chosen]})
    columns = [[Decimal(word) for word in column] for column in zip(*numbers.values(), strict=True)]
    varying = [i for i, column in enumerate(columns) if len(set(column)) > 1] or list(range(len(columns)))[
        -1:
    ]
    for path, words in sorted(
        numbers.items(), key=lambda item: (item[0].suffix.lower() not in _LOSSLESS, item[0])
    ):
        key = tuple(Decimal(words[i]) for i in varying)
        if key in named.files:
            named.duplicates.append((named.files[key], path))
            continue
        named.files[key] = path
        named.words[key] = tuple(words[i] for i in varying)
    for table in (named.files, named.words):
        ordered = sorted(table.items())
        table.clear()
        table.update(ordered)  # type: ignore[arg-type]
    return named


def _with_whole_stamps(numbers: dict[Path, tuple[str, ...]]) -> dict[Path, tuple[str, ...]]:
    """The numbers of names, with `seconds_nanoseconds` (also milli- and microseconds) put together to one stamp."""
    columns = list(zip(*numbers.values(), strict=True))
    for i, (first, second) in enumerate(itertools.pairwise(columns)):
        if not all(map(_SECONDS.fullmatch, first)) or not all(word.isdigit() for word in second):
            continue
        values, lengths = [int(word) for word in second], {len(word) for word in second}
        if max(map(len, second)) > 9 or max(values) - min(values) < _LEAST_FRACTION * (len(set(first)) == 1):
            continue
        digits = lengths.pop() if len(lengths) == 1 and lengths <= set(_FRACTION_DIGITS) else 9
        return {
            path: (*w[:i], f"{w[i]}.{w[i + 1].zfill(digits)}", *w[i + 2 :]) for path, w in numbers.items()
        }
    return numbers


def pattern_of(path: Path) -> str:
    """A name without its numbers and suffix: `frame#` of frame12.png."""
    return _NUMBER.sub("#", path.stem)


@dataclass
class Pairs:
    """Colour and depth images that belong together, in order of time."""

    colour: list[Path]
    depth: list[Path]
    times: np.ndarray
    """Of the colour images [s], shape (N,)."""
    depth_times: np.ndarray
    """Of the depth images [s], shape (N,)."""
    numbers: list[int] | None
    """Frame numbers, where the names hold such."""
    first_number: int | None
    """The least frame number of either folder, paired or not."""
    num_colour: int
    num_depth: int
    notes: list[str]


def pair_by_name(
    folder: Path, colour_files: list[Path], depth_files: list[Path], depth_offset_s: float = 0.0
) -> Pairs:
    """Pair the images of two folders by what varies in their names.

    Equal numbers belong together; stamps that differ by at most 20 ms do, nearest first.

    Raises:
        InputError: no two belong together.
    """
    if _is_scattered(colour_files) or _is_scattered(depth_files):
        return _pairs_of_stems(folder, colour_files, depth_files)
    colour = named_images(colour_files)
    like = pattern_of(next(iter(colour.files.values()))) if colour.files else None
    depth = named_images(depth_files, like)
    notes = [
        note for named, what in ((colour, "colour"), (depth, "depth")) for note in _what_was_left(named, what)
    ]
    keys = _pairs_of_keys(folder, colour, depth)
    pairs = _by_stamp(colour, depth, depth_offset_s) if keys is None else keys
    if not pairs:
        raise InputError(
            f"{folder}: found {colour.count} colour images ({_example(colour)}) and {depth.count} depth images "
            f"({_example(depth)}) of no common number and no two stamps within {MAX_DIFFERENCE_S * 1e3:.0f} ms, "
            "expected equal numbers, or stamps of one clock, in the names"
        )
    unit, words = _unit([colour.words[c] for c, _ in pairs])
    times = unit.times(words)
    depth_unit, depth_words = _unit([depth.words[d] for _, d in pairs])
    depth_times = depth_unit.times(depth_words) if unit != FRAMES and depth_unit == unit else times
    if unit != FRAMES:
        notes.append(f"the names of the images are read as stamps in {unit.name}")
        depth_times = depth_times + depth_offset_s
    numbers = [int(Decimal(word)) for word in words] if unit == FRAMES else None
    first = min((int(key[0]) for key in (*colour.files, *depth.files)), default=0) if numbers else None
    order = np.argsort(times, kind="stable")
    return Pairs(
        [colour.files[pairs[i][0]] for i in order], [depth.files[pairs[i][1]] for i in order], times[order],
        depth_times[order], [numbers[i] for i in order] if numbers else None, first, colour.count, depth.count, notes,
    )  # fmt: skip


def _is_scattered(files: list[Path]) -> bool:
    """Whether names share no manner: letters, hashes."""
    groups = Counter(map(pattern_of, files))
    return bool(files) and (
        max(groups.values()) < _MANY * len(files) or not any(_NUMBER.search(file.stem) for file in files)
    )


def _pairs_of_stems(folder: Path, colour_files: list[Path], depth_files: list[Path]) -> Pairs:
    """Pairs of the same name but for the suffix, in order of name. Raises InputError: there is none."""
    colour, depth = ({file.stem: file for file in reversed(files)} for files in (colour_files, depth_files))
    stems = sorted(colour.keys() & depth.keys())
    if not stems:
        raise InputError(
            f"{folder}: found colour images like {colour_files[0].name} and depth images like {depth_files[0].name}, "
            "expected the same names, or numbers or stamps in them"
        )
    times = np.arange(len(stems)) * FRAMES.seconds
    notes = ["the names of the images hold no numbers of frames: they are taken in order of name, at 30 Hz"]
    return Pairs(
        [colour[s] for s in stems], [depth[s] for s in stems], times, times, list(range(len(stems))), 0,
        len(colour_files), len(depth_files), notes,
    )  # fmt: skip


Key = tuple[Decimal, ...]


def _pairs_of_keys(folder: Path, colour: Named, depth: Named) -> list[tuple[Key, Key]] | None:
    """Pairs of equal numbers: all that vary, or one of them (SUN3D: `number-stamp`); None where few are equal."""
    fewer = min(len(colour.files), len(depth.files))
    common = [key for key in colour.files if key in depth.files]
    if fewer and len(common) >= _MANY * fewer:
        return [(key, key) for key in common]
    sizes = {len(key) for key in (*colour.files, *depth.files)}
    for i in range(min(sizes, default=0) if len(sizes) == 1 and sizes != {1} else 0):
        ours, theirs = {key[i]: key for key in colour.files}, {key[i]: key for key in depth.files}
        both = [(ours[n], theirs[n]) for n in ours if n in theirs]
        if len(ours) == len(colour.files) and len(theirs) == len(depth.files) and len(both) >= _MANY * fewer:
            return both
    return None


def _by_stamp(colour: Named, depth: Named, depth_offset_s: float) -> list[tuple[Key, Key]]:
    """Pairs of near stamps, where the names hold one stamp each."""
    if not colour.files or not depth.files:
        return []
    (unit, words), (depth_unit, depth_words) = (
        _unit(list(colour.words.values())),
        _unit(list(depth.words.values())),
    )
    if FRAMES in (unit, depth_unit):
        return []
    times, depth_times = unit.times(words), depth_unit.times(depth_words) + depth_offset_s
    order, depth_order = np.argsort(times, kind="stable"), np.argsort(depth_times, kind="stable")
    ours, theirs = list(colour.files), list(depth.files)
    found = associate(times[order], depth_times[depth_order])
    return [(ours[order[i]], theirs[depth_order[j]]) for i, j in found]


def _unit(words: list[tuple[str, ...]]) -> tuple[Unit, list[str]]:
    """The unit of the numbers in names, and the number of each that tells the time.

    Of several numbers it is the one that steps in a unit of time, else the last that is another in every name,
    else the place in the order of names.
    """
    columns = [list(column) for column in zip(*words, strict=True)]
    units = [unit_of(column) for column in columns]
    if len(columns) == 1:
        return units[0], columns[0]
    distinct = [len(set(column)) == len(column) for column in columns]
    for timed in (True, False):
        for unit, column, unique in reversed(list(zip(units, columns, distinct, strict=True))):
            if unique and (unit.name not in ("seconds", "frame numbers")) == timed:
                return unit, column
    return FRAMES, [str(i) for i in range(len(words))]


def _what_was_left(named: Named, what: str) -> list[str]:
    notes = []
    if named.left_out:
        notes.append(
            f"{len(named.left_out)} files beside the {what} images are named in another manner and left out "
            f"({named.left_out[0].name})"
        )
    if named.duplicates:
        taken, other = named.duplicates[0]
        notes.append(
            f"{len(named.duplicates)} {what} images are second ones of their number and left out "
            f"({other.name}: {taken.name} is taken)"
        )
    return notes


def _example(named: Named) -> str:
    return f"such as {next(iter(named.files.values())).name}" if named.files else "none"
