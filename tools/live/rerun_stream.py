"""A live session in rerun: streamed to its viewer, or written into an `.rrd`."""

import time
from pathlib import Path

import numpy as np
import rerun as rr

from dsmap.fusion.exports.rerun_log import log_classes, log_frame, log_map
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.runs.map_live import Moment

_MAP_S = 2.0
"""Time between two whole maps [s]."""
_POINTS = 100_000
VIEWER = "viewer"


class RerunStream:
    """Logs frames as they are mapped.

    Args:
        where: `viewer` starts rerun's viewer, else the file to write.
    """

    def __init__(self, where: str):
        self._stream = rr.RecordingStream("dsmap")
        if where == VIEWER:
            self._stream.spawn()
        else:
            Path(where).parent.mkdir(parents=True, exist_ok=True)
            self._stream.save(where)
        log_classes(self._stream)
        self._mapped_at = 0.0

    def show(self, mapper: Mapper, moment: Moment) -> None:
        """Log a frame, and every two seconds the map."""
        frame, result = moment.arrived.frame, moment.result
        log_frame(self._stream, frame, result.T_world_camera, mapper.intrinsics, None)
        self._stream.log("health/delay_s", rr.Scalars(moment.delay_s))
        self._stream.log("health/tracked", rr.Scalars(float(result.tracked)))
        if time.monotonic() - self._mapped_at > _MAP_S:
            log_map(
                self._stream,
                {k: np.array(v) for k, v in mapper.surfels.numpy().items()},
                _POINTS,
                static=False,
            )
            self._mapped_at = time.monotonic()

    def close(self) -> None:
        """Write what is buffered."""
        self._stream.flush()
        self._stream.disconnect()
