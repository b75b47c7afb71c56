"""Where live frames come from: a recording at its own speed, a camera, or the user's own code."""

import importlib
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Protocol

from dsmap.errors import InputError, InputWarning
from dsmap.frame import Frame, Intrinsics
from dsmap.sequences import Sequence


class LiveSource(Protocol):
    """A camera, or what stands for one. What factories return needs `intrinsics` and `frames` alone."""

    intrinsics: Intrinsics

    def frames(self) -> Iterator[Frame]:
        """Frames as they come: blocks until the next one, ends where there are no more."""
        ...


class Replay:
    """A recording that comes at its own speed, as if its camera were here."""

    def __init__(self, sequence: Sequence, speed: float = 1.0):
        self.sequence, self.speed = sequence, speed
        self.intrinsics = sequence.intrinsics

    def frames(self) -> Iterator[Frame]:
        """Each frame when its time has come; a damaged one is left out."""
        began, first = time.monotonic(), float(self.sequence.times[0]) if len(self.sequence) else 0.0
        for frame in self.sequence:
            due = began + (frame.time - first) / self.speed
            time.sleep(max(due - time.monotonic(), 0.0))
            yield frame
        for _, reason in self.sequence.skipped:
            warnings.warn(InputWarning(f"left out: {reason}"), stacklevel=2)


def _camera(module: str) -> Callable[[], LiveSource]:
    def connect() -> LiveSource:
        return importlib.import_module(f"dsmap.tools.live.{module}").connect()

    return connect


CAMERAS: dict[str, tuple[str, Callable[[], LiveSource]]] = {
    "realsense": ("pyrealsense2", _camera("realsense")),
    "record3d": ("record3d", _camera("record3d_phone")),
}
"""Name of a kind of camera to the package that it needs, and what connects to the first one of that kind."""


def open_source(name: str) -> LiveSource:
    """The source that the command line names.

    Raises:
        InputError: an unknown name, a package that is not installed, a camera that is not there, or a factory that
            cannot be loaded.
    """
    if name in CAMERAS:
        package, connect = CAMERAS[name]
        try:
            return connect()
        except ModuleNotFoundError as error:
            if (error.name or "").split(".")[0] != package:
                raise
            raise InputError(f"{name}: needs {package}; install it with: pip install {package}") from error
    module_name, colon, factory_name = name.partition(":")
    if not colon:
        raise InputError(
            f"{name}: no such source; expected {', '.join(CAMERAS)}, module:factory, or --replay {Path(name)}"
        )
    return _from_factory(module_name, factory_name)


def _from_factory(module_name: str, factory_name: str) -> LiveSource:
    if "" not in sys.path:
        sys.path.insert(0, "")  # a console script does not look into the current folder by itself
    name = f"{module_name}:{factory_name}"
    try:
        source = getattr(importlib.import_module(module_name), factory_name)()
    except Exception as error:  # whatever the user's code raises
        raise InputError(
            f"{name} cannot be used ({type(error).__name__}: {error}); expected an importable module with a factory "
            "that returns a source"
        ) from error
    if not isinstance(getattr(source, "intrinsics", None), Intrinsics) or not callable(
        getattr(source, "frames", None)
    ):
        raise InputError(
            f"{name} returned {type(source).__name__}; expected something with `intrinsics` (dsmap.frame.Intrinsics) "
            "and `frames()`"
        )
    return source
