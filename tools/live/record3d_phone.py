"""An iPhone or iPad with LiDAR that streams over USB by the app Record3D."""

import threading
import time
from collections.abc import Iterator

import cv2
import numpy as np
from record3d import Record3DStream

from dsmap.errors import InputError
from dsmap.frame import Frame, Intrinsics

_WAIT_S = 5.0


class Phone:
    """Frames at the depth image's size: the colour image is shrunk to it."""

    def __init__(self) -> None:
        devices = Record3DStream.get_connected_devices()
        if not devices:
            raise InputError(
                "record3d: found no phone, expected one on USB with Record3D in USB streaming mode"
            )
        self._new, self._ended = threading.Event(), threading.Event()
        self._stream = Record3DStream()
        self._stream.on_new_frame = self._new.set
        self._stream.on_stream_stopped = self._ended.set
        self._stream.connect(devices[0])
        if not self._new.wait(_WAIT_S):
            raise InputError("record3d: the phone sends no frame, expected Record3D to be streaming")
        k, (height, width) = self._stream.get_intrinsic_mat(), self._stream.get_rgb_frame().shape[:2]
        own = Intrinsics(width, height, k.fx, k.fy, k.tx, k.ty)
        rows, columns = self._stream.get_depth_frame().shape
        self.intrinsics = own.scaled(columns, rows)

    def frames(self) -> Iterator[Frame]:
        """Frames until the app stops."""
        index, size = 0, (self.intrinsics.width, self.intrinsics.height)
        while not self._ended.is_set():
            if not self._new.wait(_WAIT_S):
                return
            self._new.clear()
            depth = np.nan_to_num(np.array(self._stream.get_depth_frame(), dtype=np.float32))
            rgb = cv2.resize(np.asarray(self._stream.get_rgb_frame()), size, interpolation=cv2.INTER_AREA)
            yield Frame(index, time.time(), rgb, depth)
            index += 1


def connect() -> Phone:
    """Connect to the first phone. Raises InputError where there is none."""
    return Phone()
