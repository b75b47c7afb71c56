"""Other spellings of the options of `dsmap map`: short flags, and what earlier versions called them."""

from typing import Any

from dsmap.errors import InputError

ALIASES = {"--loops": "--loops.mode", "--label-fusion": "--labels.rule", "--segment-every": "--labels.every"}
"""Short flag -> the flag that it stands for."""
_OLD_GROUPS = {"loop": "loops"}
"""What a group of parameters was called -> what it is called."""
_SHORT = {
    "loops": ("loops", "mode"),
    "label_fusion": ("labels", "rule"),
    "segment_every": ("labels", "every"),
}
"""A short parameter of a file -> the group and the parameter that it stands for."""


def spelled_out(argv: list[str]) -> list[str]:
    """A command line in which every flag has its own name.

    Raises:
        InputError: --segment-every is neither a number nor `keyframes`.
    """
    out: list[str] = []
    before = ""
    for word in argv:
        flag, equals, value = word.partition("=")
        known = flag.replace("_", "-")
        if before == "--segment-every":
            word = str(_every(word))
        elif known == "--segment-every" and equals:
            word = f"{ALIASES[known]}={_every(value)}"
        elif known in ALIASES:
            word = ALIASES[known] + equals + value
        else:
            group, dot, name = word.partition(".")
            old = _OLD_GROUPS.get(group.removeprefix("--"))
            word = f"--{old}.{name}" if dot and old else word
        out.append(word)
        before = known if not equals else ""
    return out


def todays_spelling(values: dict[str, Any], where: str) -> dict[str, Any]:
    """The parameters of a configuration file or a checkpoint with the names of today.

    Raises:
        InputError: segment_every is neither a number nor `keyframes`, or a group is no group; `where` names the file.
    """
    out: dict[str, Any] = {}
    short: dict[str, Any] = {}
    for name, value in values.items():
        if name in _SHORT and not isinstance(value, dict):
            if value is not None:  # None was "as the long parameter says"
                short[name] = value
            continue
        name = _OLD_GROUPS.get(name, name)
        both = isinstance(value, dict) and isinstance(out.get(name), dict)
        out[name] = {**out[name], **value} if both else value
    for name, value in short.items():  # they come before the long ones
        group, parameter = _SHORT[name]
        into = out.setdefault(group, {})
        if not isinstance(into, dict):
            raise InputError(f"{where}: {group}: found {into!r}; expected parameters by name")
        out[group] = {**into, parameter: _every(value) if name == "segment_every" else value}
    return out


def _every(value: Any) -> int:
    """Every how many frames are labelled: 0 stands for keyframes."""
    text = str(value)
    if text == "keyframes":
        return 0
    if not text.isdigit() or int(text) < 1:
        raise InputError(f"--segment-every is {text!r}; expected a positive number or `keyframes`")
    return int(text)
