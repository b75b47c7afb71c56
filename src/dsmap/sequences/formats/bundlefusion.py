"""BundleFusion and ScanNet's SensReader: 7-Scenes' file names beside `info.txt` or `_info.txt`."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sequences.base import Recording
from dsmap.sequences.calibration import Calibration
from dsmap.sequences.formats.parts import two_cameras
from dsmap.sequences.formats.protocol import Options, Reader
from dsmap.sequences.seven_scenes import is_seven_scenes, read_seven_scenes
from dsmap.sequences.text import read_text

_FILES = ("info.txt", "_info.txt")


def _detect(path: Path) -> bool:
    return path.is_dir() and any((path / name).is_file() for name in _FILES) and is_seven_scenes(path)


def _read(path: Path, _options: Options) -> Recording:
    file = next(path / name for name in _FILES if (path / name).is_file())
    return replace(read_seven_scenes(path), layout="bundlefusion", calibration=read_info(file))


READER = Reader("bundlefusion", _detect, _read)


def read_info(file: Path) -> Calibration:
    """The cameras of an `info.txt` of lines `m_key = values`. Raises InputError: one is missing or no number."""
    lines = (line.split("=", 1) for line in read_text(file).splitlines() if "=" in line)
    values = {key.strip(): value.split() for key, value in lines}
    try:
        cameras, extrinsics = [], []
        for what in ("Color", "Depth"):
            size = (int(values[f"m_{what.lower()}Width"][0]), int(values[f"m_{what.lower()}Height"][0]))
            K = np.array(values[f"m_calibration{what}Intrinsic"], np.float64).reshape(4, 4)
            cameras.append(Intrinsics(*size, K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
            T = np.array(values.get(f"m_calibration{what}Extrinsic", np.eye(4).ravel()), np.float64).reshape(
                4, 4
            )
            extrinsics.append(T if np.linalg.det(T) else np.eye(4))
        scale = float(values.get("m_depthShift", ["1000"])[0])
    except (KeyError, ValueError, IndexError) as error:
        raise InputError(
            f"{file}: {error!r}, expected m_colorWidth, m_calibrationColorIntrinsic, ..."
        ) from error
    colour, depth = cameras
    same = (colour.width, colour.height) == (depth.width, depth.height)
    if same and np.allclose(colour.K, depth.K) and np.allclose(extrinsics[0], extrinsics[1]):
        return Calibration(colour, scale, file.name)
    return two_cameras(colour, depth, np.linalg.inv(extrinsics[0]) @ extrinsics[1], scale, file.name)
