"""The first Intel RealSense that is plugged in, by pyrealsense2."""

from collections.abc import Iterator

import numpy as np
import pyrealsense2 as rs

from dsmap.errors import InputError
from dsmap.frame import Frame, Intrinsics

_SIZE, _FPS = (640, 480), 30
_WAIT_MS = 5000


class RealSense:
    """Depth registered to colour by the SDK."""

    def __init__(self) -> None:
        config = rs.config()
        config.enable_stream(rs.stream.color, *_SIZE, rs.format.rgb8, _FPS)
        config.enable_stream(rs.stream.depth, *_SIZE, rs.format.z16, _FPS)
        self._pipeline = rs.pipeline()
        profile = self._pipeline.start(config)
        self._align = rs.align(rs.stream.color)
        self._metres = profile.get_device().first_depth_sensor().get_depth_scale()
        k = profile.get_stream(rs.stream.color).as_video_stream_profile().get_intrinsics()
        # librealsense's pixel centres lie at integers, as ours.
        self.intrinsics = Intrinsics(k.width, k.height, k.fx, k.fy, k.ppx, k.ppy)

    def frames(self) -> Iterator[Frame]:
        """Frames until the camera is unplugged."""
        index = 0
        try:
            while True:
                both = self._align.process(self._pipeline.wait_for_frames(_WAIT_MS))
                colour, depth = both.get_color_frame(), both.get_depth_frame()
                if not colour or not depth:
                    continue
                rgb = np.array(colour.get_data(), dtype=np.uint8)
                metres = np.asarray(depth.get_data(), dtype=np.float32) * np.float32(self._metres)
                stamps = colour.get_timestamp() / 1e3, depth.get_timestamp() / 1e3
                yield Frame(index, stamps[0], rgb, metres, depth_time=stamps[1])
                index += 1
        except RuntimeError as error:
            raise InputError(f"realsense: {error}; expected a camera that stays plugged in") from error
        finally:
            self._pipeline.stop()


def connect() -> RealSense:
    """Start the camera.

    Raises:
        InputError: there is none.
    """
    try:
        return RealSense()
    except RuntimeError as error:
        raise InputError(f"realsense: {error}; expected a RealSense that is plugged in") from error
