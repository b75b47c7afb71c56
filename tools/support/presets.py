"""Named configurations: YAML files with the options of `dsmap map`, one a data set, which come with dsmap."""

from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from dsmap.errors import InputError
from dsmap.files import read_yaml

EXTENDS = "extends"
"""Key of a configuration that starts from another one."""


def preset_names() -> list[str]:
    """The configurations that come with dsmap, and can be given by name."""
    return sorted(f.name.removesuffix(".yaml") for f in _folder().iterdir() if f.name.endswith(".yaml"))


def load_preset(name: str) -> dict[str, Any]:
    """The parameters of a configuration, those of the ones that it extends included.

    Args:
        name: a name of `preset_names`, or a YAML file; one that `extends` a name or a file beside itself.

    Raises:
        InputError: there is no such configuration, it is no YAML, or it extends itself.
    """
    return _load(name, Path.cwd(), ())


def option(argv: list[str], flag: str) -> str | None:
    """The value of `--flag VALUE` or `--flag=VALUE` on a command line that is yet to be parsed."""
    for i, word in enumerate(argv):
        if word == flag and i + 1 < len(argv):
            return argv[i + 1]
        if word.startswith(flag + "="):
            return word.split("=", 1)[1]
    return None


def _folder() -> Traversable:
    return resources.files("dsmap.tools") / "configs"


def _load(name: str, beside: Path, seen: tuple[str, ...]) -> dict[str, Any]:
    path = beside / name
    file: Path | Traversable = path
    if not path.is_file():
        if name not in preset_names():
            raise InputError(
                f"--config {name}: no such file and no such configuration; expected a YAML file or one of "
                f"{', '.join(preset_names())}"
            )
        file = _folder() / f"{name}.yaml"
    elif path.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"--config {name}: found a file that is no YAML; expected NAME.yaml")
    if str(file) in seen:
        raise InputError(f"{file}: extends itself; expected a chain of configurations that ends")
    values = read_yaml(file)
    base = values.pop(EXTENDS, None)
    if base is None:
        return values
    if not isinstance(base, str):
        raise InputError(f"{file}: extends is {base!r}; expected the name of a configuration")
    return merged(_load(base, path.parent, (*seen, str(file))), values)


def merged(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """Nested dicts, those of `over` first."""
    out = dict(base)
    for key, value in over.items():
        old = out.get(key)
        out[key] = merged(old, value) if isinstance(old, dict) and isinstance(value, dict) else value
    return out
