"""Scoring a trial that tries to lose the camera: how long was it lost, and was it ever believed in a wrong place.

Was there anything to be found by? A camera that comes back looking at what was never mapped cannot be found by
anyone. Such a trial is not passed either, but it is told apart.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dsmap.frame import Frame
from dsmap.fusion.lie import inverse, pose_difference
from dsmap.fusion.mapper import Mapper
from dsmap.metrics import ate_rmse

WRONG_M, WRONG_DEG = 0.05, 3.0
"""A tracked pose further off than this is wrong [m, deg]."""
WITHIN_S = 1.0
"""A camera that is lost has to be found within this time [s] of being able to see."""
FAST_DEG_S = 120.0
"""Rotation from which a motion counts as fast [deg/s]."""
IN_VIEW = 0.25
"""A frame of which the map shows less than this share cannot be found: the verdict's own gate (min_overlap)."""
_LEAP_M, _LEAP_DEG = 0.25, 15.0
"""No hand carries a camera this far between two frames: it was lifted and put down elsewhere."""


@dataclass
class TrialScore:
    """What happened in one trial."""

    frames: int
    blind: int
    """Frames without an image."""
    leaps: int
    """Times that the camera was put down elsewhere."""
    fast_s: float
    """Time during which it turned by FAST_DEG_S or more [s]."""
    lost: int
    """Frames with an image and without a pose."""
    longest_lost_s: float
    """Longest time from being able to see to having a pose [s]."""
    relocalised: int
    """Poses that came from relocalisation."""
    wrong_relocalised: int
    """Of these, the wrong ones."""
    wrong: int
    """All poses believed that are wrong; drift counts too."""
    worst_m: float
    """Largest error of a pose that was believed [m]."""
    ate_m: float | None = None
    """RMS of the positions of the poses that were believed, after SE(3) alignment [m]; None for fewer than three."""
    in_view: float = 1.0
    """Largest share of a lost frame that the map shows, in the first WITHIN_S of the longest loss; 1 if none."""

    @property
    def passed(self) -> bool:
        """Never wrong, and never lost for longer than WITHIN_S."""
        return self.wrong == 0 and self.longest_lost_s <= WITHIN_S

    @property
    def hopeless(self) -> bool:
        """Not passed, but never wrong either: when the camera could see again, it saw too little of the map."""
        return self.wrong == 0 and not self.passed and self.in_view < IN_VIEW


def score_trial(
    true: np.ndarray,
    estimated: np.ndarray,
    tracked: Sequence[bool],
    relocalised: Sequence[bool],
    blind: np.ndarray,
    fps: float,
    in_view: np.ndarray | None = None,
) -> TrialScore:
    """Score the frames of one trial; the worlds are made one by the first frame.

    Args:
        true, estimated: T_world_camera, shape (K, 4, 4).
        tracked, relocalised: what the mapper said of each frame, shape (K,).
        blind: frames without an image, bool, shape (K,).
        in_view: share of every lost frame that the map shows from its true pose (`share_in_view`), shape (K,).
    """
    T_true_estimated = true[0] @ inverse(estimated[0])
    distance, angle = np.array(
        [pose_difference(a, T_true_estimated @ b) for a, b in zip(true, estimated, strict=True)]
    ).T
    moved, turned = np.array([pose_difference(a, b) for a, b in pairwise(true)]).reshape(-1, 2).T
    leaps = (moved > _LEAP_M) | (turned > _LEAP_DEG)
    believed, found = np.asarray(tracked, bool), np.asarray(relocalised, bool)
    wrong = believed & ((distance > WRONG_M) | (angle > WRONG_DEG))
    lost = ~believed & ~blind
    rows = _longest(lost, blind)
    early = rows[: int(WITHIN_S * fps)]
    return TrialScore(
        frames=len(true),
        blind=int(blind.sum()),
        leaps=int(leaps.sum()),
        fast_s=float(np.count_nonzero(~leaps & (turned * fps >= FAST_DEG_S)) / fps),
        lost=int(lost.sum()),
        longest_lost_s=len(rows) / fps,
        relocalised=int(found.sum()),
        wrong_relocalised=int((found & wrong).sum()),
        wrong=int(wrong.sum()),
        worst_m=float(distance[believed].max(initial=0.0)),
        ate_m=ate_rmse(estimated[believed], true[believed]) if believed.sum() > 2 else None,
        in_view=1.0 if in_view is None or not early else float(np.max(in_view[early])),
    )


def share_in_view(mapper: Mapper, frame: Frame, T_world_camera: np.ndarray) -> float:
    """Share of a frame's depth image that the map shows from a pose, its true one, at the same depth."""
    config, width = mapper.config, mapper.intrinsics.width
    maps = mapper.model.views.empty()
    mapper.model.views.render(T_world_camera, maps)
    skip = max(width // 320, 1)
    z, model = frame.depth[::skip, ::skip], maps.vertex.numpy()[::skip, ::skip, 2]
    near, far = config.depth_range
    valid = (z > near) & (z < far)
    slack = config.relocalise.slack + config.relocalise.slack_z2 * z * z
    shown = valid & (model > 0) & (np.abs(model - z) < slack)
    return float(np.count_nonzero(shown) / max(np.count_nonzero(valid), 1))


def _longest(lost: np.ndarray, blind: np.ndarray) -> list[int]:
    """The longest row of lost frames; blind ones neither count nor end a row."""
    rows: list[list[int]] = [[]]
    for frame in np.flatnonzero(~blind):
        if lost[frame]:
            rows[-1].append(int(frame))
        elif rows[-1]:
            rows.append([])
    return max(rows, key=len)
