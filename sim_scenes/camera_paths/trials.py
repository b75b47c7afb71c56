"""Walks that try a mapper's robustness: fast turns, a shaken camera, a covered lens, a camera carried elsewhere."""

from collections.abc import Callable

import numpy as np

BURST_DEG_S = 175.0
"""Rotation of a burst on top of the walk's own [deg/s], which is below 50."""
HOLD_S, RAMP_S = 0.55, 0.25
"""A burst holds its rate this long, after and before a ramp [s]."""
SHAKEN_DEG_S = 200.0
"""A shaken camera turns by up to this on top of the walk's own rotation [deg/s], which is below 50."""
_SHAKEN_HZ = (0.8, 1.8)
_REST_S = 0.7
"""A recording begins calmly for this long: something has to be mapped."""
COVERED_S = 1.0
"""How long the lens is covered [s]."""
Sampler = Callable[[np.ndarray], np.ndarray]
"""Eye (3), yaw and pitch, (N, 5), at times (N,) [s]."""


def with_bursts(state: np.ndarray, t: np.ndarray, seconds: float, rng: np.random.Generator) -> np.ndarray:
    """States (N, 5) whose camera is swung away by 140 degrees within a second, and back, every few seconds.

    Args:
        t: times of the states [s]; seconds: length of the recording (bursts come early in short ones).
    """
    out, start = state.copy(), min(float(rng.uniform(3.0, 4.5)), 0.3 * seconds)
    while start < t[-1]:
        sense, back = float(rng.choice([-1.0, 1.0])), float(rng.uniform(2.4, 3.2))
        out[:, 3] += sense * (_burst(t - start) - _burst(t - start - back))
        start += back + float(rng.uniform(3.5, 5.5))
    return out


def _burst(t: np.ndarray) -> np.ndarray:
    """Angle turned by a time after a burst's start [rad]: its rate ramps up, holds and ramps down."""
    top = np.radians(BURST_DEG_S)
    up, hold = np.clip(t, 0, RAMP_S), np.clip(t - RAMP_S, 0, HOLD_S)
    down = np.clip(t - RAMP_S - HOLD_S, 0, RAMP_S)
    return top * (up**2 / (2 * RAMP_S) + hold + down - down**2 / (2 * RAMP_S))


def shaken(t: np.ndarray, seconds: float, rng: np.random.Generator) -> np.ndarray:
    """Angles [rad] that a camera is shaken by at times t [s], yaw, pitch and roll, shape (N, 3).

    Each axis swings at a frequency of its own and comes and goes, so one and several turn at a time. The fastest
    moment of a recording of that many seconds turns by SHAKEN_DEG_S.
    """
    frequency, slow = rng.uniform(*_SHAKEN_HZ, 3), rng.uniform(0.15, 0.35, 3)
    phase, begin = rng.uniform(0, 2 * np.pi, (2, 3))

    def swing(times: np.ndarray) -> np.ndarray:
        s = np.clip(times / _REST_S, 0, 1)[:, None]
        strength = s * s * (3 - 2 * s) * (0.65 + 0.35 * np.sin(2 * np.pi * slow * times[:, None] + begin))
        return strength * np.sin(2 * np.pi * frequency * times[:, None] + phase)

    fine = np.arange(0, max(seconds, 2 * _REST_S), 0.005)
    rate = np.linalg.norm(np.diff(swing(fine), axis=0), axis=1).max() / 0.005
    return np.radians(SHAKEN_DEG_S) / rate * swing(t)


def covered_frames(kind: str, frames: int, fps: float, seed: int) -> np.ndarray:
    """Frames during which something covers the lens (black colour, no depth), bool (frames,): path `cover` only.

    Once in the first seconds, then about every ten.
    """
    covered, rng = np.zeros(frames, bool), np.random.default_rng([seed, 78])
    if kind != "cover":
        return covered
    t = np.arange(frames) / fps
    start = min(float(rng.uniform(3.0, 5.0)), 0.4 * frames / fps)
    while start < frames / fps:
        covered |= (t >= start) & (t < start + COVERED_S)
        start += float(rng.uniform(8.0, 12.0))
    return covered


def carried_times(sampler: Sampler, t: np.ndarray, seconds: float, rng: np.random.Generator) -> np.ndarray:
    """Times of a walk at which a camera is that, every few seconds, is somewhere it has been before.

    Each leap is to the place 1 s or more ago that differs most from the present one of a few drawn at random;
    the walk goes on from there, a little slower than the first time.
    """
    local, rate, leap = t.copy(), 1.0, min(float(rng.uniform(5.0, 8.0)), 0.5 * seconds)
    while leap < t[-1]:
        now = float(np.interp(leap, t, local))
        drawn = rng.uniform(0.0, max(0.0, now - 1.0), 5)
        here, there = sampler(np.array([now])), sampler(drawn)
        turned = np.abs((there[:, 3] - here[:, 3] + np.pi) % (2 * np.pi) - np.pi)
        apart = np.linalg.norm(there[:, :3] - here[:, :3], axis=1) + 0.5 * turned
        rate *= 0.92
        after = t >= leap
        local[after] = drawn[int(np.argmax(apart))] + rate * (t[after] - leap)
        leap += float(rng.uniform(6.0, 9.0))
    return local
