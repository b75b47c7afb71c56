"""A kernel beside its twin: how far they are apart."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

BORDERLINE = 0.01
"""Share of entries that may fall the other way in single precision: a pixel on a gate or on the border of two."""


@dataclass(frozen=True)
class Check:
    """A kernel and its twin."""

    run: Callable[[Any], float]
    """Takes a device, gives the largest difference."""
    limit: float
    """What rounding makes of it at most, in the kernel's own unit."""


def apart(found: wp.array | np.ndarray, expected: np.ndarray) -> float:
    """Largest difference of two arrays, the worst entries, which may be borderline, left out."""
    values = found.numpy() if isinstance(found, wp.array) else found
    off = np.abs(values.astype(np.float64) - expected)
    return float(np.quantile(off, 1 - BORDERLINE)) if off.size else 0.0
