"""What `dsmap map` looks at before it maps, and what it says where little came of it."""

import sys
import warnings

from dsmap.errors import InputError, InputWarning
from dsmap.fusion.config import MapConfig
from dsmap.fusion.runs.map_recording import RunState
from dsmap.sequences import Sequence
from dsmap.sequences.label_check import check_all_labels
from dsmap.sequences.pose_conventions import fit_poses
from dsmap.tools.mapping.options import Args
from dsmap.tools.support.depth_check import depth_warnings, sample_depth
from dsmap.tools.support.mirror_check import mirror_warnings

NO_MAP = 1
"""Exit code of a run that mapped nothing."""
_NEARLY_ALL = 0.7
"""Share of frames that are lost or could not be read, from which it is said what to try."""
_ADVICE = {
    "too little depth": "try a larger --depth-max, the right --depth-scale, or a larger --size",
    "no pose is given": "try --poses track",
    "not found in the map": "begin where the saved map was filmed",
}
"""Part of a reason that a frame is lost for -> what to try."""
_USUAL_ADVICE = (
    "the likeliest reasons are a wrong depth scale (--depth-scale), wrong intrinsics (--intrinsics), images too small "
    "(--size), or depth outside the range (--depth-min, --depth-max): `dsmap info` shows what was understood; "
    "--start leaves out a bad beginning"
)


def check_recording(args: Args, sequence: Sequence, config: MapConfig) -> None:
    """Warn of what will probably go wrong.

    Raises:
        InputError: poses are to be taken as given and are clearly in another convention, or labels that are to be
            fused are of another set.
    """
    for text in [*depth_warnings(sample_depth(sequence), config.depth_range), *mirror_warnings(sequence)]:
        warnings.warn(text, InputWarning, stacklevel=2)
    if sequence.has_poses:
        _check_poses(args, sequence)
    if args.spec.kind == "labels":
        check_all_labels(sequence)


def without_partner(sequence: Sequence) -> str:
    """How many images of the recording are of no use; empty where all are."""
    recording, pairs = sequence.recording, len(sequence.recording.entries)
    rgb, depth = recording.num_rgb - pairs, recording.num_depth - pairs
    if rgb <= 0 and depth <= 0:
        return ""
    return f"{rgb} of {recording.num_rgb} colour and {depth} of {recording.num_depth} depth images have no partner"


def verdict(state: RunState, sequence: Sequence) -> int:
    """Say what to try where little or nothing was mapped; returns the exit code."""
    points = state.mapper.trajectory[state.mapper.first_frame :]
    tracked = sum(point.tracked for point in points)
    dropped = 0 if state.pace is None else state.pace.dropped
    total = max(len(points), len(sequence) - dropped)
    nothing = tracked == 0 or state.mapper.surfels.count == 0
    if not nothing and total - tracked < _NEARLY_ALL * total:
        return 0
    index, reason = _first_lost(state, sequence)
    what = "nothing was mapped" if nothing else f"only {tracked} of {total} frames were mapped"
    # The second frame is lost for what the first one did to the map: advice goes by the reason alone.
    advice = next((text for part, text in _ADVICE.items() if part in reason), _USUAL_ADVICE)
    if len(state.skipped) >= total:
        advice = "no frame of it can be read"
    where = f": the first lost frame is {index} ({reason})" if reason else ""
    print(f"dsmap map: {sequence.path}: {what}{where}; {advice}", file=sys.stderr)
    return NO_MAP if nothing or tracked == 1 else 0  # the first frame of a map always fits itself


def _first_lost(state: RunState, sequence: Sequence) -> tuple[int, str]:
    """Index in the recording and reason of the first frame that is not in the map."""
    found = list(state.skipped[:1])
    if state.first_lost is not None:
        found.append(state.first_lost)
    return min(found, default=(0, ""))


def _check_poses(args: Args, sequence: Sequence) -> None:
    fit = fit_poses(sequence)
    if fit is None:
        return
    if args.map.poses == "track":  # nothing follows from them but what `evaluate` will say
        if fit.is_other and args.pose_convention is None:
            warnings.warn(fit.sentence(args.path), InputWarning, stacklevel=2)
        return
    if fit.is_other and args.pose_convention is None:
        raise InputError(fit.sentence(args.path))
    if fit.is_other or fit.is_bad:
        text = f"the given poses explain only {fit.given:.0%} of the depth of the first frames"
        warnings.warn(f"{text}: the map will be wrong (--poses track, --pose-convention)", InputWarning, 2)
