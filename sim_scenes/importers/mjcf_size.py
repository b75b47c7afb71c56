"""How much a MuJoCo model unfolds to, counted before MuJoCo builds it: a few lines can ask for any amount."""

from pathlib import Path
from xml.etree import ElementTree

from dsmap.errors import InputError
from dsmap.limits import MAX_IMAGE_PIXELS, MAX_MODEL_ELEMENTS

MAX_FILES = 200
"""Files that a model includes."""
_MAX_BYTES = 1 << 26
"""Of one file of a model."""
_ARENA_BYTES = 1 << 30
_UNITS = {"k": 1 << 10, "m": 1 << 20, "g": 1 << 30, "t": 1 << 40, "p": 1 << 50, "e": 1 << 60}


def check_mjcf_size(path: Path) -> None:
    """Refuse a model that unfolds to too much.

    Raises:
        InputError: it does, or a file of it is not readable as XML.
    """
    seen: list[Path] = []
    total = _count(path, 1, seen, path)
    if total > MAX_MODEL_ELEMENTS:
        raise InputError(f"{path}: unfolds to {total:,} elements, expected at most {MAX_MODEL_ELEMENTS:,}")


def _count(file: Path, times: int, seen: list[Path], model: Path) -> int:
    """Elements of a file that stands `times` times in the model."""
    seen.append(file)
    if len(seen) > MAX_FILES:
        raise InputError(f"{model}: includes more than {MAX_FILES} files, expected fewer")
    try:
        if file.is_file() and file.stat().st_size > _MAX_BYTES:
            raise InputError(f"{file}: more than {_MAX_BYTES >> 20} MiB, expected a model")
        root = ElementTree.fromstring(file.read_bytes())
    except (OSError, ValueError, ElementTree.ParseError) as error:
        raise InputError(f"{file}: not readable as MJCF ({error})") from error
    total = 0
    stack = [(root, times)]
    while stack:
        element, count = stack.pop()
        total += count
        _check_element(element, model)
        if element.tag == "include" and element.get("file"):
            total += _count(_included(file, model, str(element.get("file"))), count, seen, model)
        count *= _copies(element, model)
        if total > MAX_MODEL_ELEMENTS or count > MAX_MODEL_ELEMENTS:
            return max(total, count)
        total += count if element.tag in ("composite", "flexcomp") else 0
        stack += [(child, count) for child in element]
    return total


def _included(file: Path, model: Path, name: str) -> Path:
    """MuJoCo looks beside the model."""
    beside = model.parent / name
    return beside if beside.is_file() else file.parent / name


def _copies(element: ElementTree.Element, model: Path) -> int:
    """How often what stands in an element, or what it makes, comes in the model."""
    if element.tag not in ("replicate", "composite", "flexcomp"):
        return 1
    copies = 1
    for number in _numbers(element, "count", model) or [1]:
        copies *= max(int(min(number, 1e9)), 1)
    return copies


def _check_element(element: ElementTree.Element, model: Path) -> None:
    def product(*names: str) -> float:
        found = 1.0
        for name in names:
            for number in _numbers(element, name, model):
                found *= max(number, 1)
        return found

    texels = 0.0
    if element.tag == "texture":
        texels = product("width", "height") * (1 if element.get("type") == "2d" else 6)
    elif element.tag == "hfield":
        texels = product("nrow", "ncol")
    if texels > MAX_IMAGE_PIXELS:
        name = element.get("name", element.tag)
        raise InputError(
            f"{model}: {name!r} asks for {texels:,.0f} texels, expected at most {MAX_IMAGE_PIXELS:,}"
        )
    if element.tag == "size":
        _check_arena(element, model)


def _check_arena(element: ElementTree.Element, model: Path) -> None:
    word = element.get("memory", "").strip().lower()
    unit = _UNITS.get(word[-1:], 1)
    try:
        asked = float(word.rstrip("kmgtpe") or 0) * unit
    except ValueError:
        asked = 0.0  # MuJoCo says what it makes of it
    counts = [n for name in element.attrib if name.startswith("n") for n in _numbers(element, name, model)]
    if asked > _ARENA_BYTES or max(counts, default=0) * 1000 > _ARENA_BYTES:
        raise InputError(f"{model}: its <size> asks for more than {_ARENA_BYTES >> 20} MiB, expected less")


def _numbers(element: ElementTree.Element, name: str, model: Path) -> list[float]:
    try:
        return [float(word) for word in element.get(name, "").split()]
    except ValueError as error:
        raise InputError(
            f"{model}: {name} of <{element.tag}> is {element.get(name)!r}, expected numbers"
        ) from error
