"""A small ray-cast recording in memory, and the same in TUM's layout."""

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from corner_frames import FRAMES

from dsmap.frame import Intrinsics
from dsmap.sequences.associate import pose_vector
from dsmap.sequences.calibration import Calibration, write_calibration
from dsmap.tools.twins.corner import INTRINSICS

CAMERA = INTRINSICS
COUNT = 12
START = 1560000083.25
"""Stamp of the first frame [s]."""


@dataclass(frozen=True)
class Shot:
    """One frame as a camera gives it."""

    time: float
    rgb: np.ndarray
    millimetres: np.ndarray
    """Depth, uint16."""
    T_world_camera: np.ndarray
    label: np.ndarray

    @property
    def jpeg(self) -> bytes:
        return cv2.imencode(".jpg", self.rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()

    @property
    def png(self) -> bytes:
        return cv2.imencode(".png", self.rgb[..., ::-1])[1].tobytes()

    @property
    def metres(self) -> np.ndarray:
        return (self.millimetres / 1000).astype(np.float32)

    def stored(self, units: float) -> np.ndarray:
        """Depth in units per metre, as a 16-bit file holds it; metres in 32 bits for one unit."""
        if units == 1.0:
            return self.metres
        return np.rint(self.millimetres * (units / 1000)).astype(np.uint16)


def shots(start: float = START, rate: float = 30.0) -> list[Shot]:
    """The frames; stamps are whole microseconds, or number / rate where they begin at 0."""
    out = []
    for i, f in enumerate(FRAMES[:COUNT]):
        millimetres = np.rint(f.depth * 1000).astype(np.uint16)
        millimetres[:2, :3] = 0  # a hole
        assert f.T_world_camera is not None and f.label is not None
        out.append(
            Shot(
                round(start + i / rate, 6) if start else i / rate,
                f.rgb,
                millimetres,
                f.T_world_camera,
                f.label,
            )
        )
    return out


def through_jpeg(found: list[Shot]) -> list[Shot]:
    """The same frames as a JPEG leaves them."""
    return [
        replace(s, rgb=cv2.imdecode(np.frombuffer(s.jpeg, np.uint8), cv2.IMREAD_COLOR)[..., ::-1])
        for s in found
    ]


def png16(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def write_tum(folder: Path, found: list[Shot], camera: Intrinsics, units: float) -> Path:
    """TUM's layout with calibration.yaml; depth of one unit per metre is stored as floats."""
    lists: dict[str, list[str]] = {"rgb": [], "depth": [], "groundtruth": []}
    suffix = ".tiff" if units == 1.0 else ".png"
    for name in ("rgb", "depth"):
        (folder / name).mkdir(parents=True)
    for s in found:
        stamp = repr(s.time)
        (folder / f"rgb/{stamp}.png").write_bytes(s.png)
        (folder / f"depth/{stamp}{suffix}").write_bytes(cv2.imencode(suffix, s.stored(units))[1].tobytes())
        lists["rgb"].append(f"{stamp} rgb/{stamp}.png")
        lists["depth"].append(f"{stamp} depth/{stamp}{suffix}")
        lists["groundtruth"].append(stamp + "".join(f" {v:.9f}" for v in pose_vector(s.T_world_camera)))
    for name, lines in lists.items():
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    write_calibration(folder, Calibration(camera, units, "test"))
    return folder
