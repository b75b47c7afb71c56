"""`dsmap map --help`: the options that people use first, then all others by what they are about."""

import shutil
import textwrap
import typing
from pathlib import Path
from typing import Literal

import tyro

from dsmap.config_file import is_union
from dsmap.fusion.config import MapConfig
from dsmap.tools.mapping.options import Args, Option, options_of
from dsmap.tools.mapping.spelling import ALIASES

FIRST = (
    *(
        "out",
        "config",
        "size",
        "depth_max",
        "camera_up",
        "poses",
        "loops.mode",
        "segmenter",
        "device",
        "resume",
    ),
)
"""What people use first."""
GROUPS = {
    "the run": (
        *("overwrite", "checkpoint_every", "localize_in", "extend", "save_probabilities", "refine"),
        *("objects", "pictures", "view", "realtime", "write_config"),
    ),
    "the recording": (
        *("start", "stop", "stride", "depth_min", "intrinsics", "depth_scale", "undistort", "readout_s"),
        *("pose_convention", "label_map", "color_topic", "depth_topic"),
    ),
    "the network, or other sources of labels": (
        *("weights", "engine", "prior", "label_noise", "label_noise_kind", "seed"),
    ),
}
"""Heading to options without a prefix. Those with one follow, a heading a prefix."""
_METAVARS = {
    "out": "RUN", "localize_in": "RUN", "config": "NAME|FILE", "size": "WxH", "intrinsics": "FX,FY,CX,CY",
    "segmenter": "dsnet|labels|none|MODULE:FACTORY", "device": "auto|cpu|cuda", "weights": "NAME|FILE",
    "pose_convention": "WORDS", "label_map": "NAME|FILE", "color_topic": "TOPIC", "depth_topic": "TOPIC",
}  # fmt: skip
"""What stands for a value, where the type does not say it."""
_INDENT = " " * 6


def help_text(args: Args) -> str:
    """The help of `dsmap map`, with the values of `args` as defaults."""
    width = min(shutil.get_terminal_size().columns, 100)
    options = {option.name: option for option in options_of(args)}
    short = {new.removeprefix("--").replace("-", "_"): old for old, new in ALIASES.items()}
    lines = ["usage: dsmap map RECORDING --out RUN [options]", ""]
    about = "Map an RGB-D recording: trajectory, surfels, labels, pictures. " + options["path"].doc
    lines += textwrap.wrap(about, width)
    groups = {"what people use first": FIRST, **GROUPS}
    config = MapConfig()
    for prefix in dict.fromkeys(name.partition(".")[0] for name in options if "." in name):
        title = f"--{prefix}.*: {getattr(config, prefix).__doc__}"
        groups[title] = tuple(n for n in options if n.startswith(prefix + ".") and n not in FIRST)
    for title, names in groups.items():
        lines += ["", *textwrap.wrap(title if title.endswith(".") else title + ":", width)]
        for name in names:
            lines += _lines(options[name], short.get(name), width)
    return "\n".join(lines)


def _lines(option: Option, alias: str | None, width: int) -> list[str]:
    value = metavar(option)
    flags = [flag for flag in (alias, option.flag) if flag]
    head = ", ".join(f"{flag} {value}" if value else flag for flag in flags)
    if option.hint is bool and option.value:
        group, dot, name = option.flag.removeprefix("--").rpartition(".")
        head = f"--{group}{dot}no-{name}"
    text = _turned_off(option.doc) if option.value is True else option.doc + _default(option)
    return [f"  {head}", *textwrap.wrap(text, width, initial_indent=_INDENT, subsequent_indent=_INDENT)]


def metavar(option: Option) -> str:
    """What stands for an option's value: `X` for a number, `N` for a whole one, the words it may be, or its name."""
    hint = option.hint
    kinds = [a for a in typing.get_args(hint) if a is not type(None)] if is_union(hint) else [hint]
    kind, arguments = kinds[0], typing.get_args(kinds[0])
    if kind is bool:
        return ""
    if typing.get_origin(kind) is Literal:
        return "|".join(str(a) for a in arguments)
    if typing.get_origin(kind) is tuple:
        return "{0} {0} ...".format("N" if arguments[0] is int else "X")
    if option.name in _METAVARS:
        return _METAVARS[option.name]
    return {int: "N", float: "X", Path: "FILE"}.get(kind, option.name.rpartition(".")[2].upper())


def _turned_off(doc: str) -> str:
    """What a flag does that turns off what its option says it does."""
    return f"Turn off what is on: {doc[0].lower()}{doc[1:]}"


def _default(option: Option) -> str:
    value = option.value
    if value is None or value is tyro.MISSING or value is False:
        return ""
    text = " ".join(str(v) for v in value) if isinstance(value, tuple) else str(value)
    return f" [{text}]"
