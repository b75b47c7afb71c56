"""What a hand and a step add to the path of a camera that a person means to take."""

import numpy as np

BANDS_HZ = ((0.5, 1.0), (1.0, 2.0), (2.0, 4.0), (4.0, 8.0), (8.0, 12.0))
POSITION_RMS_M = (1.5e-3, 1.2e-3, 0.52e-3, 0.135e-3, 0.066e-3)
"""RMS of each axis in each band [m]."""
ROTATION_RMS_RAD = tuple(np.radians((0.30, 0.35, 0.27, 0.10, 0.065)))
"""RMS about each axis in each band [rad].

Above 2 Hz both are as measured, by band-pass filter, on the 100 Hz motion-capture trajectory of the hand-held
recording TUM fr1/xyz (J. Sturm et al., A Benchmark for the Evaluation of RGB-D SLAM Systems, IROS 2012), first
12 s, mean of the axes. Below 2 Hz that recording is moved on purpose (3.0 mm and 0.55 degrees at 1-2 Hz), which a
calm walk is not: those bands follow the slope of the ones above.
"""
_WAVES = 6
"""Sines a band."""
LEG_M = 0.9
"""Length of a leg, for the bounce of a step."""


def tremor(rng: np.random.Generator, t: np.ndarray) -> np.ndarray:
    """Unsteadiness of the hands at times t [s]: x, y, z [m] and three angles [rad], shape (N, 6).

    Sums of sines with random frequencies, of the spectrum given by `BANDS_HZ`; the same at equal times
    whatever the other times are.
    """
    total = np.zeros((len(t), 6))
    for (low, high), shift, turn in zip(BANDS_HZ, POSITION_RMS_M, ROTATION_RMS_RAD, strict=True):
        frequency = rng.uniform(low, high, (_WAVES, 6))
        phase = rng.uniform(0, 2 * np.pi, (_WAVES, 6))
        waves = np.sin(2 * np.pi * frequency * t[:, None, None] + phase).sum(1)
        total += waves * np.sqrt(2 / _WAVES) * np.array([shift] * 3 + [turn] * 3)
    return total


def step_height(speed: np.ndarray, cadence_hz: float) -> np.ndarray:
    """Rise of the body during one step [m] at a walking speed [m/s].

    The body vaults over a stiff leg: h = l - sqrt(l^2 - (s / 2)^2) with step length s = speed / cadence
    (Zijlstra & Hof, Assessment of spatio-temporal gait parameters from trunk accelerations during human walking,
    Gait & Posture 18, 2003, Eq. 1 solved for h).
    """
    half = np.minimum(speed / cadence_hz / 2, 0.9 * LEG_M)
    return LEG_M - np.sqrt(LEG_M**2 - np.square(half))
