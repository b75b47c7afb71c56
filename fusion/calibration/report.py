"""What an estimate says: the calibration to write, how sure each number is, what the recording cannot tell."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from dsmap.frame import Intrinsics
from dsmap.fusion.calibration.estimate import Estimate
from dsmap.fusion.calibration.pose_scale import PoseScale
from dsmap.fusion.calibration.rig import LENS, PLACE, Cameras, corrected
from dsmap.sequences.calibration import CALIBRATION_FILE, Calibration

_LIMITS = {
    "focal": 0.005, "depth_focal": 0.01, "k1": 0.02, "readout_s": 0.003, "depth_time_offset_s": 0.002,
    **dict.fromkeys(PLACE[:3], 0.004), **dict.fromkeys(PLACE[3:], float(np.deg2rad(0.2))),
}  # fmt: skip
"""Standard deviations above which a number counts as undetermined, and the given one stays."""
_LIMIT_CENTRE = 0.005
"""The same of the principal point [image widths]."""
_CONTRADICTS = 3.0
"""A given number is off if it is this many standard deviations away, and by more than its limit."""
_LIMIT_SCALE = 0.01
_MORE = {
    "focal": "turn the camera about all axes, and come nearer and go away",
    "depth_focal": "turn the camera, with slanted surfaces in view",
    "readout_s": "turn the camera fast, to and fro",
    "depth_time_offset_s": "turn the camera fast, to and fro",
    "place": "turn the camera far, with slanted surfaces near and far in view",
    "cx": "roll the camera about its own axis",
    "k1": "let textured things be seen in the image's corners",
}
"""What determines each number."""


@dataclass(frozen=True)
class Line:
    """One number of the report."""

    name: str
    given: float
    found: float
    sigma: float
    """Standard deviation; infinite where nothing is known."""
    unit: str
    verdict: Literal["determined", "undetermined", "contradicts"]
    """`contradicts`: determined, and the given number is not it."""
    advice: str = ""
    """What to film where it is undetermined."""


@dataclass(frozen=True)
class Report:
    """The outcome of a calibration."""

    calibration: Calibration
    """The given one with every determined number replaced, and the uncertainties."""
    lines: list[Line]
    warnings: list[str]
    """Contradictions to the given calibration, one sentence each."""


def report(found: Estimate, unregistered: bool, scale: PoseScale | None, scale_is_asked: bool) -> Report:
    """What was found, in words and as a calibration.

    Args:
        unregistered: depth was given as lying on colour, and does not.
        scale: by given poses, if the recording has any.
        scale_is_asked: whether that scale is to be written.
    """
    lines = _lines(found, scale)
    names = {line.name: line for line in lines}
    determined = {name for name, line in names.items() if line.verdict != "undetermined"}
    calibration = _calibration(found, names, determined)
    if scale is not None and scale_is_asked and "depth_scale" in determined:
        calibration = replace(calibration, depth_scale=names["depth_scale"].found)
    elif not scale_is_asked:
        determined.discard("depth_scale")
    calibration = replace(
        calibration,
        uncertainty={name: names[name].sigma for name in names if name in determined},
        undetermined=tuple(name for name in names if name not in determined),
    )
    warnings = [_contradiction(line) for line in lines if line.verdict == "contradicts"]
    if unregistered:
        warnings.insert(
            0, "the depth images do not lie on the colour images; T_color_depth says how they lie"
        )
    return Report(calibration, lines, warnings)


def _lines(found: Estimate, scale: PoseScale | None) -> list[Line]:
    given, cameras = found.rig.given, found.rig.cameras(found.vector)
    colour, prefix = given.stored_colour, "color_" if given.color_camera is not None else ""
    lines = []

    def add(
        name: str, parameter: str, before: float, after: float, factor: float, unit: str, advice: str
    ) -> None:
        limit = _LIMITS.get(parameter, _LIMIT_CENTRE * colour.width) * factor
        lines.append(_line(name, before, after, found.sigma_of(parameter) * factor, unit, limit, advice))

    for name in ("fx", "fy"):
        value = getattr(colour, name)
        add(prefix + name, "focal", value, getattr(cameras.colour, name), value, "px", _MORE["focal"])
    for name in ("cx", "cy"):
        add(prefix + name, name, getattr(colour, name), getattr(cameras.colour, name), 1.0, "px", _MORE["cx"])
    if given.color_camera is not None:
        for name in ("fx", "fy"):
            value = getattr(given.intrinsics, name)
            add(name, "depth_focal", value, getattr(cameras.depth, name), value, "px", _MORE["depth_focal"])
    else:
        add("k1", "k1", _k1(colour), _k1(cameras.colour), 1.0, "", _MORE["k1"])
    add("readout_s", "readout_s", given.readout_s, cameras.readout_s, 1.0, "s", _MORE["readout_s"])
    before = given.depth_time_offset_s
    add(
        "depth_time_offset_s", "depth_time_offset_s", before, before + cameras.offset_s, 1.0, "s",
        _MORE["depth_time_offset_s"],
    )  # fmt: skip
    if found.rig.places:
        lines += _place(found, cameras)
    lines.append(_scale_line(given.depth_scale, scale))
    return lines


def _place(found: Estimate, cameras: Cameras) -> list[Line]:
    """Where the depth camera is: distance and angle from where it was said to be, each axis its own line."""
    given = np.eye(4) if found.rig.given.T_color_depth is None else found.rig.given.T_color_depth
    lines = []
    for k, name in enumerate(PLACE[:3]):
        lines.append(
            _line(f"T_color_depth_{name}", given[k, 3], float(cameras.t_color_depth[k]), found.sigma_of(name), "m",
                  _LIMITS[name], _MORE["place"])
        )  # fmt: skip
    for name in PLACE[3:]:
        turn, sigma = np.rad2deg([found.value(name), found.sigma_of(name)])
        limit = float(np.rad2deg(_LIMITS[name]))
        lines.append(
            _line(f"T_color_depth_{name}_deg", 0.0, float(turn), float(sigma), "deg", limit, _MORE["place"])
        )
    return lines


def _line(name: str, given: float, found: float, sigma: float, unit: str, limit: float, advice: str) -> Line:
    if not sigma <= limit:
        return Line(name, given, found, sigma, unit, "undetermined", advice)
    off = abs(found - given)
    contradicts = off > _CONTRADICTS * sigma and off > limit
    return Line(name, given, found, sigma, unit, "contradicts" if contradicts else "determined")


def _scale_line(given: float, scale: PoseScale | None) -> Line:
    """Images alone tell a room from a doll's house by nothing but the depth itself."""
    if scale is None:
        advice = "nothing in colour and depth tells it: measure a known length, or give poses in metres"
        return Line("depth_scale", given, given, float("inf"), "units/m", "undetermined", advice)
    return _line(
        "depth_scale", given, given / scale.factor, scale.sigma * given, "units/m", _LIMIT_SCALE * given,
        "move the camera further than it is now",
    )  # fmt: skip


def _calibration(found: Estimate, lines: dict[str, Line], determined: set[str]) -> Calibration:
    """The given calibration with what is determined."""
    given, cameras = found.rig.given, found.rig.cameras(found.vector)
    own = given.color_camera is not None
    prefix = "color_" if own else ""
    kept = {
        name: found.value(name) if prefix + {"focal": "fx"}.get(name, name) in determined else 0.0
        for name in LENS
    }
    colour = corrected(given.stored_colour, **kept)
    depth_focal = found.value("depth_focal") if "fx" in determined else 0.0
    changes = {
        "intrinsics": corrected(given.intrinsics, depth_focal, 0.0, 0.0, 0.0) if own else colour,
        "color_camera": colour if own else None,
    }
    for name in ("readout_s", "depth_time_offset_s"):
        changes[name] = lines[name].found if name in determined else getattr(given, name)
    place = [name for name in lines if name.startswith("T_color_depth")]
    if place and determined.issuperset(place):
        changes["T_color_depth"] = cameras.T_color_depth
    return replace(given, source=CALIBRATION_FILE, pixel_center="integer", **changes)


def _contradiction(line: Line) -> str:
    unit = f" {line.unit}" if line.unit else ""
    return (
        f"the given {line.name} {line.given:.5g}{unit} contradicts the images, which say "
        f"{line.found:.5g} +- {line.sigma:.2g}{unit}"
    )


def _k1(camera: Intrinsics) -> float:
    return 0.0 if camera.distortion is None else camera.distortion[0]
