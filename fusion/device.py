"""Which Warp device a map lives on."""

import warp as wp

from dsmap.errors import InputError


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
