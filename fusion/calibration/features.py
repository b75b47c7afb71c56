"""Corners followed from colour image to colour image (Kanade-Lucas-Tomasi), sub-pixel, checked by the way back."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import cv2
import numpy as np

_CORNERS = 400
"""Followed at a time, at most."""
_QUALITY = 0.005
"""Of the strongest corner's response; indoor walls have few strong ones."""
_APART_BY_WIDTH = 1 / 45
"""Corners lie at least this far apart [image widths]."""
_PATCH_BY_WIDTH = 1 / 20
"""Side of the patch that is followed [image widths]."""
_THERE_AND_BACK_PX = 0.3
"""A corner followed to the next image and back must return to where it was [px; more in images wider than 320]."""
_LONGEST = 45
"""Frames after which a corner is given up: what it looks like has changed."""
_REFERENCE = 15
"""A corner is placed by its patch of up to so many frames ago: from frame to frame errors would add up."""
_DRIFT_PX = 1.0
"""Places by the last image and by the reference further apart than this are of different things [px as above]."""
_CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 40, 0.003)


@dataclass
class Corners:
    """What was followed through a window of frames."""

    frame: np.ndarray
    """Of every observation, ascending, shape (N,)."""
    track: np.ndarray
    """Which corner, shape (N,)."""
    pixel: np.ndarray
    """Where (x, y), shape (N, 2)."""


@dataclass
class _Active:
    """Corners that are being followed, one a row of every array."""

    point: np.ndarray
    track: np.ndarray
    age: np.ndarray
    reference: np.ndarray
    """The image whose patch is looked for..."""
    place: np.ndarray
    """... and where it was there."""

    def chosen(self, which: np.ndarray) -> "_Active":
        return _Active(*(getattr(self, f.name)[which] for f in fields(self)))

    def joined(self, other: "_Active") -> "_Active":
        return _Active(
            *(np.concatenate([getattr(self, f.name), getattr(other, f.name)]) for f in fields(self))
        )


def follow(images: Sequence[np.ndarray]) -> Corners:
    """Corners through grey images, uint8, shape (H, W), which follow one another."""
    active = _begun(np.empty((0, 2), np.float32), 0, 0)
    seen: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    begun = 0
    for i, grey in enumerate(images):
        if i and len(active.point):
            active = _followed(images, i, active)
        fresh = _new_corners(grey, active.point)
        active = active.joined(_begun(fresh, begun, i))
        begun += len(fresh)
        seen.append((np.full(len(active.track), i), active.track, active.point))
    frame, track, pixel = (np.concatenate(part) for part in zip(*seen, strict=True))
    return Corners(frame, track, pixel.astype(np.float64))


def _begun(points: np.ndarray, first: int, image: int) -> _Active:
    count = len(points)
    return _Active(points, first + np.arange(count), np.zeros(count, np.int64), np.full(count, image), points)


def _followed(images: Sequence[np.ndarray], i: int, active: _Active) -> _Active:
    """The corners that are found again in image i: from the image before, then exactly by their reference."""
    there, held = _next(images[i - 1], images[i], active.point)
    active = replace(active, point=there, age=active.age + 1).chosen(held & (active.age < _LONGEST))
    exact, held = active.point.copy(), np.ones(len(active.point), bool)
    for reference in np.unique(active.reference):
        rows = np.flatnonzero(active.reference == reference)
        if reference < i - 1:
            exact[rows], held[rows] = _exactly(images[reference], images[i], active.place[rows], exact[rows])
    active = replace(active, point=exact).chosen(held)
    old = active.age % _REFERENCE == 0
    return replace(
        active,
        reference=np.where(old, i, active.reference),
        place=np.where(old[:, None], active.point, active.place),
    )


def _exactly(
    reference: np.ndarray, grey: np.ndarray, place: np.ndarray, about: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where patches of a reference image are in another one, near where they are known to be."""
    side = round(grey.shape[1] * _PATCH_BY_WIDTH) | 1
    there, found, _ = cv2.calcOpticalFlowPyrLK(  # type: ignore[call-overload]
        reference, grey, place, about.copy(), winSize=(side, side), maxLevel=0, criteria=_CRITERIA,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )  # fmt: skip
    near = np.linalg.norm(there - about, axis=1) < _DRIFT_PX * max(grey.shape[1] / 320, 1.0)
    return there, (found.ravel() > 0) & near


def _new_corners(grey: np.ndarray, points: np.ndarray) -> np.ndarray:
    """More corners, away from those that are followed already."""
    apart = grey.shape[1] * _APART_BY_WIDTH
    if (missing := _CORNERS - len(points)) <= 0:
        return np.empty((0, 2), np.float32)
    free = np.full(grey.shape, 255, np.uint8)
    for x, y in np.rint(points).astype(int):
        cv2.circle(free, (int(x), int(y)), int(apart), 0, -1)
    found = cv2.goodFeaturesToTrack(grey, missing, _QUALITY, apart, mask=free)
    return np.empty((0, 2), np.float32) if found is None else found.reshape(-1, 2)


def _next(before: np.ndarray, after: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where points are in the next image, and which of them were found."""
    height, width = before.shape
    side = round(width * _PATCH_BY_WIDTH) | 1
    how = {
        "winSize": (side, side),
        "maxLevel": 3,
        "criteria": _CRITERIA,
    }
    there, found, _ = cv2.calcOpticalFlowPyrLK(before, after, points, None, **how)  # type: ignore[call-overload]
    back, returned, _ = cv2.calcOpticalFlowPyrLK(after, before, there, points.copy(), **how)  # type: ignore[call-overload]
    off = np.linalg.norm(back - points, axis=1)
    margin = side // 2
    inside = (there > margin).all(axis=1) & (there < (width - 1 - margin, height - 1 - margin)).all(axis=1)
    limit = _THERE_AND_BACK_PX * max(width / 320, 1.0)
    return there, (found.ravel() > 0) & (returned.ravel() > 0) & (off < limit) & inside
