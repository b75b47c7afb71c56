"""Off-screen OpenGL on Linux: choose EGL before anything loads, and say what is missing in one sentence."""

# pyright: reportAttributeAccessIssue=false

import ctypes
import os
import sys

from dsmap.errors import InputError

_PACKAGES = (
    "install the system packages libegl1 and libgl1-mesa-dri, or use --renderer warp, which needs no OpenGL"
)


def use_egl() -> None:
    """Make PyOpenGL, MuJoCo and pyrender use EGL (Linux; elsewhere their defaults serve). Idempotent.

    Raises:
        InputError: libEGL is not installed.
    """
    if sys.platform != "linux":
        return
    try:
        ctypes.CDLL("libEGL.so.1")
    except OSError as error:
        raise InputError(f"cannot render with OpenGL: libEGL.so.1 is missing; {_PACKAGES}") from error
    os.environ["MUJOCO_GL"] = os.environ["PYOPENGL_PLATFORM"] = "egl"
    import OpenGL.EGL
    import OpenGL.raw.EGL._types

    # PyOpenGL 3.1.0, which pyrender pins, lacks a type that MuJoCo's EGL context names, and compares the
    # names of extensions (bytes) with prefixes that it forgot to make bytes.
    if not hasattr(OpenGL.EGL, "EGLDeviceEXT"):
        OpenGL.EGL.EGLDeviceEXT = ctypes.c_void_p
    querier = OpenGL.raw.EGL._types.EGLQuerier
    if isinstance(querier.prefix, str):
        querier.prefix, querier.version_prefix = b"EGL_", b"EGL_VERSION_EGL_"


def no_context(error: Exception) -> InputError:
    """The error to raise where EGL is there but yields no context."""
    reason = str(error).splitlines()[0] if str(error) else type(error).__name__
    return InputError(f"cannot render with OpenGL: EGL gave no context ({reason}); {_PACKAGES}")
