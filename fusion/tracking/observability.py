"""Which motions of the camera does a frame tell nothing about? Those stand still, instead of following noise.

Before a bare wall nothing holds the camera sideways, nor against turning about the wall's normal. Normals and
gradients are noisy, so the normal equations hold those directions a little nevertheless, and the camera wanders. Their
eigenvalues tell them apart (Zhang et al., ICRA 2016), once metres and radians are made alike: about a point in the
middle of what is seen, with radians as the distance that they move its rim. Measured: 1e-5 to 1e-4 a residual for
noise before a bare wall, 6e-4 and more where a cupboard's edge is in view, 4e-2 in a room.
"""

from dataclasses import dataclass

import numpy as np

from dsmap.fusion.lie import adjoint, exp_se3, log_se3
from dsmap.kernels.types import Surface

_NOISE = 3e-4
"""Information a residual, in these units, that noise alone gives, at least..."""
_NOISE_OF_NORMALS = 6.0
"""... and this times the variance of the model's normals from pixel to pixel: a new map is noisy."""
_EDGE = 3.0
"""The mean square of changes of the normal is at most this times their median; what is more are edges."""
HELD = 2.4e-3
"""With more information than this a direction is held in any case: curved things are no noise."""
_ROWS = 40
"""Normals are looked at in so many rows of an image."""
_RIM = 0.35
"""Distance from the middle of the image to what counts as its rim, of the depth."""
REST_M_S = 0.03
"""A camera that was slower than this in directions that nothing holds is at rest there: a hand's tremor."""
MOST_BLIND_M = 0.1
"""A camera that has gone on further than this in directions that nothing holds may be centimetres off: it is lost."""
_LOST_M = 1e6
_HELD_FRAMES = 3
"""After so many frames in a row that held it everywhere a camera is where it is thought to be."""
_STEP = 0.02
"""A camera moves by about this from frame to frame [m]."""


@dataclass(frozen=True)
class Unheld:
    """Directions of a twist (translation [m], rotation [rad], about the camera) that a frame tells nothing about."""

    twists: np.ndarray
    """Shape (k, 6), k = 0 where everything is held."""
    rim: float
    """A radian moves what is seen by about this [m]."""

    def __len__(self) -> int:
        return len(self.twists)

    def part(self, xi: np.ndarray) -> np.ndarray:
        """The part of a twist, shape (6,), that lies in these directions."""
        metres = self._metres
        U = self.twists * metres
        return U.T @ np.linalg.solve(U @ U.T, U @ (metres * xi)) / metres if len(U) else np.zeros(6)

    def size(self, xi: np.ndarray) -> float:
        """Of that part, in metres."""
        return float(np.linalg.norm(self._metres * self.part(xi)))

    @property
    def _metres(self) -> np.ndarray:
        return np.repeat([1.0, self.rim], 3)


class BlindWay:
    """How far a camera has gone in directions that nothing held, since it was held everywhere last."""

    def __init__(self) -> None:
        self.metres = 0.0
        self.held = 0
        """Frames in a row, up to this one, in which everything was held."""

    def see(self, unheld: Unheld) -> None:
        """A frame was registered, for the first time: noise may seem to hold a camera in a frame or two."""
        self.held = 0 if len(unheld) else self.held + 1
        if self.held >= _HELD_FRAMES:
            self.metres = 0.0

    def resting(self, T_last_now: np.ndarray, seconds: float, unheld: Unheld) -> np.ndarray:
        """The motion since the last frame, (4, 4), without a creep in directions that nothing holds."""
        xi = log_se3(T_last_now)
        if not len(unheld) or not 0 < unheld.size(xi) < REST_M_S * seconds:
            return T_last_now
        return exp_se3(-unheld.part(xi)) @ T_last_now

    def reason_to_reject(self, T_last_now: np.ndarray, unheld: Unheld) -> str:
        """Why the pose after this motion is not to be believed, in words; empty if it is."""
        way = self.metres + unheld.size(log_se3(T_last_now))
        open_ = f"{len(unheld)} of 6 directions" if len(unheld) else "the camera for long enough"
        if way <= MOST_BLIND_M:
            return ""
        self.metres = _LOST_M
        return f"nothing in view holds {open_}"

    def add(self, T_last_now: np.ndarray, unheld: Unheld) -> None:
        """A frame was tracked."""
        self.metres += unheld.size(log_se3(T_last_now))

    def found(self) -> None:
        """The camera was found in the map."""
        self.metres = 0.0


EVERYTHING_HELD = Unheld(np.zeros((0, 6)), 1.0)


def unheld(A: np.ndarray, count: float, depth: float, model: Surface) -> Unheld:
    """What J^T J, shape (6, 6), of so many residuals with a model's surface leaves open.

    depth: at which the camera sees things [m].
    """
    if count <= 0 or not np.isfinite(A).all():
        return EVERYTHING_HELD
    xi_from_y = twist_from_metres(depth)
    values, vectors = np.linalg.eigh(xi_from_y.T @ A @ xi_from_y)
    if values[0] > HELD * count:
        return EVERYTHING_HELD
    open_ = values < max(_NOISE, _NOISE_OF_NORMALS * normal_noise(model)) * count
    return Unheld((xi_from_y @ vectors[:, open_]).T, _RIM * depth) if open_.any() else EVERYTHING_HELD


def normal_noise(surface: Surface) -> float:
    """Variance of a component of the normals from pixel to pixel, edges apart."""
    n = surface.normal.numpy()
    n = n[:: max(len(n) // _ROWS, 1)]
    a, b = n[:, 1:], n[:, :-1]
    both = (a * a).sum(axis=-1) * (b * b).sum(axis=-1) > 0
    if not both.any():
        return 0.0
    change = ((a - b)[both] ** 2).sum(axis=-1)
    # The mean counts, as in J^T J: far things are noisy. But a room is full of edges.
    return min(float(change.mean()), _EDGE * float(np.median(change))) / 4


def only_held(A: np.ndarray, b: np.ndarray, unheld: Unheld) -> tuple[np.ndarray, np.ndarray]:
    """A x = b without what it says about directions that nothing holds."""
    P = np.eye(6) - np.stack([unheld.part(e) for e in np.eye(6)], axis=1)
    return P.T @ A @ P, P.T @ b


def at_rest(depth: float) -> np.ndarray:
    """Information of a camera about which nothing is known but that it moves little from frame to frame, (6, 6)."""
    return np.diag([1 / _STEP**2] * 3 + [1 / (_STEP / (_RIM * depth)) ** 2] * 3)


def twist_from_metres(depth: float) -> np.ndarray:
    """From motions of what lies straight ahead, all in metres, to the twist of the camera, shape (6, 6)."""
    T = np.eye(4)
    T[2, 3] = depth
    return adjoint(T) @ np.diag([1.0] * 3 + [1 / (_RIM * depth)] * 3)
