"""The first Luxonis OAK that is plugged in, by depthai 3.

The pipeline is that of Luxonis's documents for depth aligned to colour: the two grey cameras give depth, which the
device brings into the colour camera's view (RVC2 inside StereoDepth, RVC4 by ImageAlign) and pairs with colour.
"""

from collections.abc import Iterator
from datetime import timedelta
from typing import Any

import depthai as dai
import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Frame, Intrinsics

_SIZE, _GREY_SIZE, _FPS = (640, 480), (640, 400), 30.0
_WAIT = timedelta(seconds=10)
"""The first frame of a device that has just started takes seconds."""
_MILLIMETRES = np.float32(1e-3)


class Oak:
    """Depth in the view of the colour camera, whose lens distortion the device takes out."""

    def __init__(self, pipeline: Any) -> None:
        """Start a `dai.Pipeline` that has its device and no nodes yet."""
        self._pipeline = pipeline
        self._queue = _rgb_and_depth(pipeline)
        pipeline.start()
        self._first = self._next()
        colour = self._first["rgb"]
        # OpenCV's calibration: pixel centres lie at integers, as ours. It is that of the resized, cropped image.
        k = np.array(colour.getTransformation().getIntrinsicMatrix())
        fx, fy, cx, cy = (float(v) for v in (k[0, 0], k[1, 1], k[0, 2], k[1, 2]))
        self.intrinsics = Intrinsics(colour.getWidth(), colour.getHeight(), fx, fy, cx, cy)

    def frames(self) -> Iterator[Frame]:
        """Frames until the camera is unplugged."""
        index, both = 0, self._first
        try:
            while True:
                colour, depth = both["rgb"], both["depth"]
                metres = np.asarray(depth.getFrame()).astype(np.float32) * _MILLIMETRES
                rgb = np.ascontiguousarray(colour.getCvFrame()[..., ::-1])  # OpenCV's BGR, whatever was sent
                stamps = (stamped.getTimestamp().total_seconds() for stamped in (colour, depth))
                time, depth_time = stamps
                yield Frame(index, time, rgb, metres, depth_time=depth_time)
                index += 1
                both = self._next()
        except (RuntimeError, dai.MessageQueue.QueueException) as error:
            raise InputError(f"oak: {error}; expected a camera that stays plugged in") from error
        finally:
            self._pipeline.stop()

    def _next(self) -> Any:
        """The next pair. Raises InputError where none comes."""
        both = self._queue.get(_WAIT)
        if both is None:
            raise InputError(f"oak: no frame came within {_WAIT.seconds} s, expected a camera that films")
        return both


def _rgb_and_depth(pipeline: Any) -> Any:
    """Build the nodes; returns the queue of colour and depth in pairs."""
    sockets = dai.CameraBoardSocket
    colour = pipeline.create(dai.node.Camera).build(sockets.CAM_A)
    rgb = colour.requestOutput(_SIZE, fps=_FPS, enableUndistortion=True)
    stereo, sync = pipeline.create(dai.node.StereoDepth), pipeline.create(dai.node.Sync)
    for socket, side in ((sockets.CAM_B, stereo.left), (sockets.CAM_C, stereo.right)):
        pipeline.create(dai.node.Camera).build(socket).requestOutput(_GREY_SIZE, fps=_FPS).link(side)
    stereo.setLeftRightCheck(True)
    stereo.setSubpixel(True)  # a whole pixel of disparity is 0.25 m at 3 m
    sync.setSyncThreshold(timedelta(seconds=0.5 / _FPS))
    rgb.link(sync.inputs["rgb"])
    if pipeline.getDefaultDevice().getPlatform() == dai.Platform.RVC4:
        align = pipeline.create(dai.node.ImageAlign)
        stereo.depth.link(align.input)
        rgb.link(align.inputAlignTo)
        align.outputAligned.link(sync.inputs["depth"])
    else:
        rgb.link(stereo.inputAlignTo)
        stereo.depth.link(sync.inputs["depth"])
    return sync.out.createOutputQueue(4, False)


def connect() -> Oak:
    """Start the camera.

    Raises:
        InputError: there is none, or depthai is older than 3.
    """
    if int(dai.__version__.split(".")[0]) < 3:
        raise InputError(f"oak: depthai {dai.__version__} is too old; install: pip install 'depthai>=3'")
    try:
        return Oak(dai.Pipeline())
    except (RuntimeError, dai.MessageQueue.QueueException) as error:
        raise InputError(f"oak: {error}; expected an OAK that is plugged in") from error
