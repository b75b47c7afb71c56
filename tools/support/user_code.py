"""Code of the user's own that the command line names, and nothing else may: module:factory."""

import importlib
import sys
from typing import Any

from dsmap.errors import InputError


def made_by(word: str, option: str, what: str) -> Any:
    """What the factory `module:factory` returns.

    The current folder comes last on Python's path: nothing in it may pass for a part of dsmap or of Python.

    Args:
        option: that named it, for messages.
        what: the factory is to return.

    Raises:
        InputError: it cannot be loaded, or it raises.
    """
    module_name, _, factory_name = word.partition(":")
    if "" not in sys.path:
        sys.path.append("")
    try:
        factory = getattr(importlib.import_module(module_name), factory_name)
    except Exception as error:  # whatever the user's code raises
        raise InputError(
            f"{option} {word} cannot be loaded ({type(error).__name__}: {error}); expected an importable module with a "
            f"factory that returns {what}"
        ) from error
    try:
        return factory()
    except Exception as error:
        raise InputError(
            f"{option} {word} raised {type(error).__name__} ({error}); expected {what}"
        ) from error
