"""Turning a guess until the view fits: where does a lost camera look, if it is about here?

Registration converges from a few degrees; a camera that was covered for a second has turned by ten or twenty more
than its last motion foretold. So the model is rendered from the guesses at the coarsest size, and from some turned
aside, and the frame's texture is shifted over each picture: a shift of a picture is a turn of the camera.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from dsmap.fusion.lie import exp_so3
from dsmap.fusion.tracking.agreement import at_all_shifts, textured
from dsmap.kernels.types import FrameMaps

ASIDE_DEG = 25.0
"""The likeliest guess is looked at from this far aside, too: together the views span about 100 degrees."""
_FARTHEST = 0.45
"""Largest shift, as a share of the image's size."""
_LEAST_SHARED = 0.2
"""Shifts that leave less than this share of the frame's pixels are not considered."""

Small = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Renders the model at T_world_camera on the coarsest level: intensity and where it is known, both (h, w)."""


def search_rotation(
    frame: FrameMaps, camera: Any, guesses: Sequence[np.ndarray], render: Small
) -> list[np.ndarray]:
    """Guesses turned to where the frame fits the model best, best first.

    Args:
        frame: maps of the coarsest level.
        camera: of that level.
        guesses: T_world_camera, shapes (4, 4), likeliest first; the first one is tried turned aside, too.
        render: of the model.
    """
    if not guesses:
        return []
    light, known = frame.intensity.numpy(), frame.vertex.numpy()[..., 2] > 0
    found = []
    for T in [*guesses, *(_yawed(guesses[0], degrees) for degrees in (-ASIDE_DEG, ASIDE_DEG))]:
        score, dy, dx = best_shift(light, known, *render(T))
        found.append((score, _turned(T, dy / camera.fy, dx / camera.fx)))
    return [T for score, T in sorted(found, key=lambda one: -one[0]) if score > 0]


def best_shift(
    a: np.ndarray, known_a: np.ndarray, b: np.ndarray, known_b: np.ndarray
) -> tuple[float, int, int]:
    """The shift (dy, dx) [px] at which b(y + dy, x + dx) looks most like a(y, x), and how much.

    The likeness is the correlation of the textures, contrast made alike everywhere, times the square root of
    the share of a's pixels that it rests on: 1 at best, 0 if there is none.

    Args:
        a, b: intensities in [0, 1], shape (H, W); known_a, known_b: where they are valid.
    """
    (a, weight_a), (b, weight_b) = textured(a, known_a), textured(b, known_b)
    reach = y, x = int(_FARTHEST * a.shape[0]), int(_FARTHEST * a.shape[1])
    shifted = partial(at_all_shifts, reach=reach)
    share = np.maximum(shifted(weight_b, weight_a), 0) / max(float(weight_a.sum()), 1.0)
    power = shifted(b * b, weight_a) * shifted(weight_b, a * a)
    fair = (share > _LEAST_SHARED) & (power > 1e-6)
    likeness = np.where(fair, shifted(b, a) * np.sqrt(share / np.where(fair, power, 1.0)), 0.0)
    top = np.unravel_index(int(np.argmax(likeness)), likeness.shape)
    return float(likeness[top]), int(top[0]) - y, int(top[1]) - x


def _turned(T: np.ndarray, down: float, right: float) -> np.ndarray:
    """T with the camera turned so that its axis goes where (right, down, 1) was."""
    axis = np.array([-down, right, 0.0])
    length = float(np.linalg.norm(axis))
    out = T.copy()
    if length > 0:
        out[:3, :3] = T[:3, :3] @ exp_so3(axis / length * np.arctan(length))
    return out


def _yawed(T: np.ndarray, degrees: float) -> np.ndarray:
    return _turned(T, 0.0, float(np.tan(np.deg2rad(degrees))))
