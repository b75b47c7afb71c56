"""Commands of dsmap in this process."""

import sys
from pathlib import Path

import numpy as np


def cli(line: str) -> int:
    """A command of dsmap in this process, by its command line; `cifar` is a reader that has no quick command."""
    from dsmap.tools.cli import run

    command, *argv = line.split()
    if command != "cifar":
        return run(command, argv)
    from dsmap.dsnet.datasets.cifar import load_cifar10
    from dsmap.errors import InputError

    try:
        data = load_cifar10(argv[0])
        print(len(data), data.images.shape, np.bincount(data.labels))
        return 0
    except InputError as error:
        print(f"cifar: {error}", file=sys.stderr)
        return 2


def expand(call: str, inside: Path, out: Path) -> str:
    """The command line of a call."""
    where = inside / "where.txt"
    place = inside / where.read_text() if where.exists() else inside
    return call.replace("{in}", str(inside)).replace("{out}", str(out)).replace("{where}", str(place))
