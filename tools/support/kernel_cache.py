"""Where Warp keeps its compiled kernels."""

import os
import sys
import tempfile
from pathlib import Path


def make_kernel_cache_writable() -> None:
    """Without a home that can be written, compiled kernels go to the system's temporary folder, with a note.

    Call it before Warp is loaded. A `WARP_CACHE_PATH` that is set is the user's own choice.
    """
    if "WARP_CACHE_PATH" in os.environ or _is_writable(_usual()):
        return
    place = Path(tempfile.gettempdir()) / f"dsmap-kernels-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
    if not _is_writable(place):
        place = Path(tempfile.mkdtemp(prefix="dsmap-kernels-"))
    os.environ["WARP_CACHE_PATH"] = str(place)
    print(f"note: the home folder cannot be written; compiled kernels go to {place}", file=sys.stderr)


def _usual() -> Path:
    """Warp's own choice, user_cache_dir of appdirs on Linux."""
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return Path(base) / "warp"


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False
