"""From a recording without a target to its calibration."""

from collections.abc import Callable

import numpy as np

from dsmap.fusion.calibration.bundle import Window
from dsmap.fusion.calibration.estimate import Estimate, estimate
from dsmap.fusion.calibration.pose_scale import pose_scale
from dsmap.fusion.calibration.recording import windows_of
from dsmap.fusion.calibration.report import Report, report
from dsmap.fusion.calibration.rig import PLACE, Rig
from dsmap.sequences import Sequence

_FEWEST_OBSERVATIONS = 500
_OFF_M, _OFF_RAD = 0.005, float(np.deg2rad(0.3))
"""Depth that is said to lie on colour does not where it is off by more than this, and by more than the noise."""
_SURE = 5.0
"""Standard deviations: what was said to be registered is called otherwise only beyond."""


class TooLittleSeen(Exception):
    """A recording that shows too little to calibrate anything; the message says what to film."""


def calibrate(
    sequence: Sequence,
    frames: int,
    scale_from_poses: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Report:
    """Calibrate the camera of a recording as it is stored.

    Args:
        sequence: opened at its own size, without undistortion.
        frames: how many are looked at, in windows spread over the recording.
        scale_from_poses: the depth scale is taken from the recording's own poses.
        progress: told what is being done.

    Raises:
        TooLittleSeen: no corner could be followed, or nothing could be determined.
    """
    say = progress or (lambda _: None)
    given = sequence.calibration
    rig = Rig(given, places=given.T_color_depth is not None)
    say("following corners")
    windows = list(windows_of(sequence, rig.cameras(np.zeros(len(rig.names))), frames))
    seen = sum(len(w.tracks.frame) for w in windows)
    if seen < _FEWEST_OBSERVATIONS:
        raise TooLittleSeen(
            f"{sequence.path}: {seen} observations of corners with depth could be followed, expected "
            f"{_FEWEST_OBSERVATIONS} at least; film a textured, lit room within the reach of the depth camera while "
            "turning and moving, ten seconds or more"
        )
    say(f"adjusting {len(windows)} windows, {seen:,} observations")
    found = estimate(rig, windows)
    scale = pose_scale(windows, rig.cameras(found.vector), given.color_camera is not None)
    unregistered = False
    if not rig.places:
        say("trying whether depth lies on colour")
        freed = _freed(found, windows)
        if unregistered := _is_off(freed):
            found = freed
    result = report(found, unregistered, scale, scale_from_poses)
    if all(line.verdict == "undetermined" for line in result.lines):
        raise TooLittleSeen(
            f"{sequence.path}: the recording determines none of the camera's numbers; film while turning the camera "
            "about all axes, fast and slowly, and moving it through a textured room"
        )
    return result


def _freed(found: Estimate, windows: list[Window]) -> Estimate:
    """The estimate when the depth camera may be elsewhere, too."""
    rig = Rig(found.rig.given, places=True)
    start = np.array([found.value(name) for name in rig.names])
    return estimate(rig, windows, start)


def _is_off(freed: Estimate) -> bool:
    limits = dict(zip(PLACE, (_OFF_M,) * 3 + (_OFF_RAD,) * 3, strict=True))
    return any(
        abs(freed.value(name)) > max(limit, _SURE * freed.sigma_of(name)) for name, limit in limits.items()
    )
