"""Given poses as programs write them: their conventions, and which of them explains the depth of the first frames."""

import itertools
from collections.abc import Sequence as Items
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from dsmap.errors import InputError
from dsmap.frame import Intrinsics, orthonormal
from dsmap.sequences.base import Entry, Sequence

STANDARD = "camera-to-world"
"""What dsmap takes poses for: T_world_camera in metres, quaternion x y z w, camera axes x right, y down, z forward."""
_QUATERNION = ("wxyz",)
_UNIT = {"millimetres": 1e-3, "centimetres": 1e-2}
_DIRECTION = ("world-to-camera",)
_AXES = {
    "opengl": np.diag([1.0, -1.0, -1.0, 1.0]),
    "ros": np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]]),
}
"""T_file_camera: from dsmap's camera axes to the file's (OpenGL: y up, z backward; ROS body: x forward, z up)."""
_NAMES = (STANDARD, *_DIRECTION, *_AXES, *_QUATERNION, *_UNIT)
"""Everything that `--pose-convention` knows; several are joined by commas."""

_GAPS = (1, 2, 4, 8, 16, 32)
"""Frames between the two of a pair that is compared."""
_STARTS = (0, 8, 16)
_POINTS = 3000
"""Depth pixels of a frame that are carried into the other one, about."""
_TOLERANCE = (0.01, 0.01)
"""A point agrees with the depth it lands on within this many metres, plus this share of its depth."""
_EXPLAINED = 0.5
"""Share of points that agree, from which poses explain a pair of frames."""
_CLEARLY = 0.15
"""Share by which another convention must be better before it is named."""
_NOTHING_FITS = 0.3


@dataclass(frozen=True)
class Fit:
    """How well poses explain depth: the share of points that land on the other frame's depth."""

    given: float
    """Of the poses as they are read."""
    best: float
    name: str
    """The convention that does best, as `--pose-convention` takes it."""

    @property
    def is_other(self) -> bool:
        """Whether another convention explains the depth clearly better."""
        return self.name != STANDARD and self.best >= _EXPLAINED and self.best - self.given >= _CLEARLY

    @property
    def is_bad(self) -> bool:
        """Whether no convention explains the depth."""
        return self.best < _NOTHING_FITS

    def sentence(self, path: object) -> str:
        """What is probably wrong, for people."""
        return (
            f"{path}: found poses that explain {self.given:.0%} of the depth of the first frames, "
            f"but {self.best:.0%} if they are {self.name.replace(',', ' and ')}; expected --pose-convention {self.name}"
        )


def parse_convention(text: str) -> tuple[str, ...]:
    """The names of a convention, e.g. `world-to-camera,opengl`.

    Raises:
        InputError: a name is unknown, or two exclude each other.
    """
    names = tuple(name for name in text.lower().replace("+", ",").replace(" ", "").split(",") if name)
    for name in names:
        if name not in _NAMES:
            raise InputError(
                f"--pose-convention: found {name!r}, expected names out of {', '.join(_NAMES)}, joined by commas"
            )
    for group in (_UNIT, _AXES, (STANDARD, *_DIRECTION)):
        if sum(name in group for name in names) > 1:
            raise InputError(f"--pose-convention: found {text!r}, expected one of {', '.join(group)}")
    return names


def with_convention(sequence: Sequence, text: str) -> Sequence:
    """The sequence with its poses read in a convention of `parse_convention`."""
    names = parse_convention(text)

    def read(entry: Entry) -> Entry:
        T = entry.T_world_camera
        return entry if T is None else replace(entry, T_world_camera=as_standard(T, names))

    sequence.entries = [read(entry) for entry in sequence.entries]
    return sequence


def as_standard(T: np.ndarray, names: Items[str]) -> np.ndarray:
    """T_world_camera in dsmap's convention of a pose that was read as if it were in it, shape (4, 4)."""
    T = T.copy()
    if "wxyz" in names:  # what was taken for x y z w is w x y z
        w, x, y, z = Rotation.from_matrix(T[:3, :3]).as_quat()
        T[:3, :3] = Rotation.from_quat([x, y, z, w]).as_matrix()
    for name in names:
        T[:3, 3] *= _UNIT.get(name, 1.0)
    if "world-to-camera" in names:
        T = np.linalg.inv(T)
    for name in names:
        if name in _AXES:
            T = T @ _AXES[name]
    return orthonormal(T)


def conventions() -> list[tuple[str, ...]]:
    """All that are compared, the plainest first."""
    groups = [(None, *_DIRECTION), (None, *_AXES), (None, *_QUATERNION), (None, *_UNIT)]
    every = [tuple(name for name in names if name) for names in itertools.product(*groups)]
    return sorted(every, key=len)


def fit_poses(sequence: Sequence) -> Fit | None:
    """Compare the depth of the first frames under every convention; None where too little can be compared.

    Points of one frame are carried into another, `T_j^-1 T_i p`, and must land on that frame's depth.
    """
    posed = [i for i in range(len(sequence)) if sequence.T_world_camera(i) is not None]
    posed = posed[: _GAPS[-1] + _STARTS[-1] + 1]
    depths = _Depths(sequence)
    pairs = [(posed[a], posed[a + gap]) for a in _STARTS for gap in _GAPS if a + gap < len(posed)]
    pairs = [(i, j) for i, j in pairs if depths[i] is not None and depths[j] is not None]
    every = conventions()
    agreement = []
    for i, j in pairs:
        T_i, T_j = sequence.T_world_camera(i), sequence.T_world_camera(j)
        assert T_i is not None and T_j is not None  # `posed` says so
        points = _points(depths[i], sequence.intrinsics)
        relative = [np.linalg.inv(as_standard(T_j, c)) @ as_standard(T_i, c) for c in every]
        agreement.append([_agreement(points, T, depths[j], sequence.intrinsics) for T in relative])
    if not agreement:
        return None
    shares = np.array(agreement)
    explained = shares.max(axis=1) >= _EXPLAINED
    shares = shares[explained].mean(axis=0) if explained.any() else shares.mean(axis=0)
    best = int(np.argmax(np.round(shares, 2)))  # the plainest of those that do alike
    return Fit(float(shares[0]), float(shares[best]), ",".join(every[best]) or STANDARD)


class _Depths:
    """Depth images of a sequence, decoded once; None for those that cannot be read."""

    def __init__(self, sequence: Sequence):
        self._sequence = sequence
        self._read: dict[int, np.ndarray | None] = {}

    def __getitem__(self, i: int) -> np.ndarray | None:
        if i not in self._read:
            try:
                self._read[i] = self._sequence.depth(i)
            except InputError:  # the frame is left out of the map too
                self._read[i] = None
        return self._read[i]


def _points(depth: np.ndarray | None, camera: Intrinsics) -> np.ndarray:
    """Points [m] of valid pixels spread over an image, shape (N, 3)."""
    assert depth is not None
    v, u = np.nonzero(depth)
    step = max(1, len(u) // _POINTS)
    u, v = u[::step], v[::step]
    z = depth[v, u].astype(np.float64)
    return np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], axis=-1)


def _agreement(points: np.ndarray, T_j_i: np.ndarray, depth: np.ndarray | None, camera: Intrinsics) -> float:
    """Share of points that land on the depth of the other image; those on its holes do not count."""
    assert depth is not None
    if not len(points):
        return 0.0
    x, y, z = T_j_i[:3, :3] @ points.T + T_j_i[:3, 3:]
    in_front = z > 1e-3
    z_safe = np.where(in_front, z, 1.0)
    u = np.clip(np.rint(camera.fx * x / z_safe + camera.cx), -1, camera.width).astype(int)
    v = np.clip(np.rint(camera.fy * y / z_safe + camera.cy), -1, camera.height).astype(int)
    inside = in_front & (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    seen = depth[v[inside], u[inside]].astype(np.float64)
    metres, share = _TOLERANCE
    agree = (seen > 0) & (np.abs(seen - z[inside]) < metres + share * seen)
    counted = len(points) - int((seen == 0).sum())
    return float(agree.sum() / counted) if counted else 0.0
