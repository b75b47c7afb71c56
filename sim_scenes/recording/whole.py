"""Whether a rendered sequence is whole: every file that it must have, every image that its lists name."""

import json
from pathlib import Path

from dsmap.sequences.calibration import CALIBRATION_FILE as CALIBRATION
from dsmap.sequences.mesh import MESH_FILE as MESH

SUMMARY = "pixels.json"
"""In a scene's folder: its frames and its pixels a class, counted while it was rendered."""
_IMAGES = ("rgb", "depth", "label", "instance")
_FILES = (CALIBRATION, "classes.json", MESH, "scene.json", "groundtruth.txt")


def what_is_missing(folder: Path) -> str:
    """Why a scene of a data set is not whole, in words; empty where it is."""
    try:
        frames = json.loads((folder / SUMMARY).read_text())["frames"]
        for name in _FILES:
            if not (folder / name).stat().st_size:
                return f"{name} is empty"
        for name in (*_IMAGES, "groundtruth"):
            lines = (folder / f"{name}.txt").read_text().splitlines()
            rows = [line.split() for line in lines if not line.startswith("#")]
            if len(rows) != frames:
                return f"{name}.txt has {len(rows)} lines for {frames} frames"
            images = rows if name in _IMAGES else []
            for _, file in images:
                if not (folder / file).stat().st_size:
                    return f"{file} is empty"
    except OSError as error:
        return f"{Path(error.filename or folder).name} cannot be read ({error.strerror})"
    except (ValueError, KeyError, TypeError) as error:
        return f"a list or {SUMMARY} is damaged ({error})"
    return ""
