"""Where live frames come from: a camera, or the user's own code (a recording: `fusion/runs/replay.py`)."""

import importlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Protocol

from dsmap.errors import InputError
from dsmap.frame import Frame, Intrinsics
from dsmap.tools.support.user_code import made_by


class LiveSource(Protocol):
    """A camera, or what stands for one. What factories return needs `intrinsics` and `frames` alone."""

    intrinsics: Intrinsics

    def frames(self) -> Iterator[Frame]:
        """Frames as they come: blocks until the next one, ends where there are no more."""
        ...


def _camera(module: str) -> Callable[[], LiveSource]:
    def connect() -> LiveSource:
        return importlib.import_module(f"dsmap.tools.live.{module}").connect()

    return connect


CAMERAS: dict[str, tuple[str, Callable[[], LiveSource]]] = {
    "realsense": ("pyrealsense2", _camera("realsense")),
    "oak": ("depthai", _camera("oak")),
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
    if ":" not in name:
        raise InputError(
            f"{name}: no such source; expected {', '.join(CAMERAS)}, module:factory, or --replay {Path(name)}"
        )
    source = made_by(name, "SOURCE", "a source")
    if not isinstance(getattr(source, "intrinsics", None), Intrinsics) or not callable(
        getattr(source, "frames", None)
    ):
        raise InputError(
            f"{name} returned {type(source).__name__}; expected something with `intrinsics` (dsmap.frame.Intrinsics) "
            "and `frames()`"
        )
    return source
