"""Warp's settings (no derivatives), made before anything else touches Warp, and the device that kernels run on."""

import os
import sys
import tempfile
from typing import TypeVar, cast

import warp as wp

from dsmap.errors import InputError

_T = TypeVar("_T")
_NO_DRIVER = b"Could not find or load the NVIDIA CUDA driver"


def _initialise() -> None:
    wp.config.log_level = wp.LOG_WARNING
    wp.config.enable_backward = False
    # On a machine without a GPU Warp's C++ part warns on stderr at every start; that is the normal case here.
    # Everything else it says is passed on.
    sys.stderr.flush()
    keep = os.dup(2)
    with tempfile.TemporaryFile() as caught:
        os.dup2(caught.fileno(), 2)
        try:
            wp.init()
        finally:
            os.dup2(keep, 2)
            os.close(keep)
        caught.seek(0)
        rest = b"".join(line for line in caught if _NO_DRIVER not in line)
    os.write(2, rest)


_initialise()


def struct(kind: type[_T]) -> type[_T]:
    """`wp.struct`, which type checkers take for what it is used as: the class."""
    return cast(type[_T], wp.struct(kind))


def chosen_device(name: str) -> wp.Device:
    """The device of `auto`, `cpu`, `cuda` or `cuda:N`.

    Raises:
        InputError: there is no CUDA here.
    """
    chosen = name
    if name == "auto":
        chosen = "cuda:0" if wp.is_cuda_available() else "cpu"
    if chosen.startswith("cuda") and not wp.is_cuda_available():
        raise InputError(
            f"device {name!r} was asked for, but this machine has no CUDA driver; expected --device cpu"
        )
    return wp.get_device(chosen)


def stays_on_device(device: wp.Device) -> bool:
    """Whether what a GPU would compute is computed there, without a look by the host.

    On CUDA; and on a CPU where DSMAP_FORCE_DEVICE_PATH is 1, so that it can be tried without a GPU.
    """
    return device.is_cuda or os.environ.get("DSMAP_FORCE_DEVICE_PATH") == "1"
