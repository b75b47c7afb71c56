"""Writing a sequence in the TUM layout, frame by frame."""

import shutil
from pathlib import Path
from types import TracebackType
from typing import TextIO

import cv2
import numpy as np

from dsmap.classes import write_classes
from dsmap.errors import InputError
from dsmap.files import atomic_path
from dsmap.frame import Intrinsics
from dsmap.sequences.associate import pose_vector
from dsmap.sequences.calibration import CALIBRATION_FILE, Calibration, write_calibration
from dsmap.sequences.images import SATURATED

LISTS = {
    "rgb": "# color images\n# timestamp filename\n",
    "depth": "# depth maps\n# timestamp filename\n",
    "label": "# class ids (classes.json)\n# timestamp filename\n",
    "instance": "# instance ids\n# timestamp filename\n",
    "groundtruth": "# camera-to-world poses\n# timestamp tx ty tz qx qy qz qw\n",
}
PNG_COMPRESSION = 3
"""zlib level: 3 is twice as fast as the default and 5 % larger."""


class SequenceWriter:
    """Writes images, their lists, `groundtruth.txt`, `calibration.yaml` and `classes.json`.

    Every frame is on disk when `write` returns; what is there is readable at any time. Usable in `with`.
    """

    def __init__(
        self,
        path: Path | str,
        intrinsics: Intrinsics,
        depth_scale: float = 5000.0,
        *,
        overwrite: bool = False,
        depth_time_offset_s: float = 0.0,
        readout_s: float = 0.0,
        depth_max: float | None = None,
    ):
        """Create the folder and write the calibration.

        Args:
            intrinsics: integer pixel centres; distortion is written if there is any.
            depth_scale: stored units per metre (5000: 0.2 mm steps up to 13.1 m).
            depth_time_offset_s: what is added to a depth stamp to make it one of the colour's clock [s].
            readout_s: rolling shutter: time from an image's first row to its last [s].
            depth_max: depth beyond which the sensor is not to be trusted [m]: the mapper's default.
            overwrite: replace a sequence that is already there; otherwise one is an error.

        Raises:
            InputError: a sequence is there already, or the folder cannot be written.
        """
        self.path = Path(path)
        self.intrinsics = intrinsics
        self.depth_scale = float(depth_scale)
        self.count = 0
        self._lists: dict[str, TextIO] = {}
        if (self.path / "rgb.txt").exists():
            if not overwrite:
                raise InputError(
                    f"{self.path}: found a sequence there already, expected a new folder (or overwrite)"
                )
            remove_sequence(self.path)
        calibration = Calibration(
            intrinsics,
            self.depth_scale,
            CALIBRATION_FILE,
            depth_time_offset_s=depth_time_offset_s,
            readout_s=readout_s,
            depth_max=depth_max,
        )
        write_calibration(self.path, calibration)

    def write(
        self,
        time: float,
        rgb: np.ndarray,
        depth: np.ndarray,
        *,
        T_world_camera: np.ndarray | None = None,
        pose_time: float | None = None,
        label: np.ndarray | None = None,
        instance: np.ndarray | None = None,
    ) -> None:
        """Append one frame.

        Args:
            time: stamp [s], written with six decimals.
            rgb: uint8, shape (H, W, 3), RGB order.
            depth: planar depth [m], float, shape (H, W); 0, NaN and inf mean none.
            T_world_camera: camera-to-world pose, shape (4, 4)...
            pose_time: ... at this time [s]; None: that of the frame.
            label: class ids, shape (H, W), stored in 8 bits.
            instance: instance ids, shape (H, W), stored in 16 bits.

        Raises:
            InputError: an image has not the size of the intrinsics, or the folder cannot be written.
        """
        stamp = f"{time:.6f}"
        self._image("rgb", stamp, rgb[..., ::-1])
        self._image("depth", stamp, encode_depth(depth, self.depth_scale))
        if label is not None:
            if "label" not in self._lists:
                write_classes(self.path / "classes.json")
            self._image("label", stamp, label.astype(np.uint8))
        if instance is not None:
            self._image("instance", stamp, instance.astype(np.uint16))
        if T_world_camera is not None:
            stamp = stamp if pose_time is None else f"{pose_time:.6f}"
            self._line("groundtruth", stamp, " ".join(f"{v:.9f}" for v in pose_vector(T_world_camera)))
        self.count += 1

    def close(self) -> None:
        """Close the lists."""
        for file in self._lists.values():
            file.close()
        self._lists.clear()

    def __enter__(self) -> "SequenceWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _image(self, name: str, stamp: str, image: np.ndarray) -> None:
        expected = (self.intrinsics.height, self.intrinsics.width)
        if image.shape[:2] != expected:
            raise InputError(
                f"{self.path}: found a {name} image of {image.shape[1]}x{image.shape[0]}, "
                f"expected {expected[1]}x{expected[0]}"
            )
        relative = f"{name}/{stamp}.png"
        with atomic_path(self.path / relative) as path:
            _, data = cv2.imencode(
                ".png", np.ascontiguousarray(image), [cv2.IMWRITE_PNG_COMPRESSION, PNG_COMPRESSION]
            )
            path.write_bytes(data.tobytes())
        self._line(name, stamp, relative)

    def _line(self, name: str, stamp: str, text: str) -> None:
        try:
            if name not in self._lists:
                file = open(self.path / f"{name}.txt", "w")  # noqa: SIM115 - open over many calls; close() ends it
                file.write(LISTS[name])
                self._lists[name] = file
            self._lists[name].write(f"{stamp} {text}\n")
            self._lists[name].flush()
        except OSError as error:
            raise InputError(f"cannot write {self.path / name}.txt: {error.strerror or error}") from error


def encode_depth(depth: np.ndarray, depth_scale: float) -> np.ndarray:
    """Depth [m] as stored 16-bit units, rounded; 0 where there is none or it does not fit."""
    units = np.nan_to_num(
        np.rint(np.asarray(depth, dtype=np.float64) * depth_scale), nan=0.0, posinf=0.0, neginf=0.0
    )
    return np.where((units > 0) & (units < SATURATED), units, 0).astype(np.uint16)


def remove_sequence(folder: Path) -> None:
    """Delete the files of a TUM-layout sequence, and nothing else in the folder."""
    for name in LISTS:
        (folder / f"{name}.txt").unlink(missing_ok=True)
        if name != "groundtruth":
            shutil.rmtree(folder / name, ignore_errors=True)
    for name in (CALIBRATION_FILE, "classes.json", "mesh.ply", "bodies.txt"):
        (folder / name).unlink(missing_ok=True)
