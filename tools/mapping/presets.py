"""Named configurations: YAML files with the options of `dsmap map`, one a data set, which come with dsmap."""

import textwrap
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import yaml

from dsmap.config_file import merged_values
from dsmap.errors import InputError
from dsmap.files import atomic_path
from dsmap.fusion.config import MapConfig
from dsmap.plain import read_yaml
from dsmap.tools.mapping.options import OF_A_CALL, Args, Option, options_of
from dsmap.tools.mapping.spelling import todays_spelling

EXTENDS = "extends"
"""Key of a configuration that starts from another one."""
_NOT_STATED = {
    *(
        "device",
        "engine",
        "start",
        "stop",
        "pictures",
        "objects",
        "refine",
        "save_probabilities",
    ),  # where and how much, not what
    *("weights", "label_noise", "label_noise_kind", "seed", "intrinsics", "depth_scale"),  # of one recording
    *("color_topic", "depth_topic", "pose_convention", "label_map"),  # of one recording, too
}
"""Options that a written configuration only states where they are not the usual ones."""
_HEAD = """\
# Parameters of `dsmap map` that change what is computed, written by `dsmap map --write-config`. A configuration of your
# own only needs what is different, with `extends: default` or without. Names are those of flags: surfels.max_angle is
# --surfels.max-angle.
"""


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
    values = todays_spelling(read_yaml(file), str(file))
    base = values.pop(EXTENDS, None)
    if base is None:
        return values
    if not isinstance(base, str):
        raise InputError(f"{file}: extends is {base!r}; expected the name of a configuration")
    return merged_values(_load(base, path.parent, (*seen, str(file))), values)


def write_preset(path: Path, args: Args) -> None:
    """Write a configuration file: every parameter under what it means.

    Raises:
        InputError: the file is there and --overwrite is not given, or it cannot be written.
    """
    if path.exists() and not args.overwrite:
        raise InputError(f"{path} exists; expected a new file, or --overwrite")
    usual = {option.name: option.value for option in options_of(Args(args.path, args.out))}
    lines, group = [_HEAD], ""
    for option in options_of(args):
        name = option.name
        if name in OF_A_CALL or (name in _NOT_STATED and option.value == usual[name]):
            continue
        prefix = name.rpartition(".")[0]
        if prefix != group:
            lines += ["", *_comment(getattr(MapConfig(), prefix).__doc__ or "", ""), f"{prefix}:"]
            group = prefix
        lines += _parameter(option, "  " if prefix else "")
    with atomic_path(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _parameter(option: Option, indent: str) -> list[str]:
    value = list(option.value) if isinstance(option.value, tuple) else option.value
    value = str(value) if isinstance(value, Path) else value
    named = {option.name.rpartition(".")[2]: value}
    text = yaml.safe_dump(named, default_flow_style=None if isinstance(value, list) else False).strip()
    return [*_comment(option.doc, indent), indent + text]


def _comment(text: str, indent: str) -> list[str]:
    start = indent + "# "
    return textwrap.wrap(text, 118, initial_indent=start, subsequent_indent=start)
