"""Libraries that need not be installed: the extra `recordings`."""

import importlib
from pathlib import Path
from types import ModuleType

from dsmap.errors import InputError


def optional_library(name: str, path: Path | str, what: str) -> ModuleType:
    """Import a library of the extra `recordings`.

    Raises:
        InputError: it is not installed; names the extra.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InputError(
            f"{path}: reading {what} needs the package {name.split('.')[0]}, expected it installed: "
            'pip install "dsmap[recordings]"'
        ) from error
