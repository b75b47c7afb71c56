"""Is a recording's depth plausible? What `dsmap info` and `dsmap map` look at before anything is mapped."""

import numpy as np

from dsmap.errors import InputError
from dsmap.sequences import Sequence

SAMPLES = 10
"""Frames opened to measure the depth range."""
PLAUSIBLE_DEPTH_M = (0.2, 10.0)
"""A median depth outside this range most likely means a wrong depth scale."""
_MOST_IS_OUTSIDE = 0.9
"""Share of depth outside the mapper's range from which little is left to map."""


def sample_depth(sequence: Sequence) -> np.ndarray | InputError:
    """Valid depth [m] of frames spread over the sequence, shape (N,), or why there is none."""
    values, failure = [], InputError(f"{sequence.path}: no frame with valid depth")
    for i in np.unique(np.linspace(0, len(sequence) - 1, SAMPLES).astype(int)):
        try:
            depth = sequence.depth(int(i))
        except InputError as error:
            failure = error
            continue
        values.append(depth[depth > 0])
    return np.concatenate(values) if values and any(map(len, values)) else failure


def depth_warnings(depth: np.ndarray | InputError, range_m: tuple[float, float] | None = None) -> list[str]:
    """What is probably wrong with sampled depth.

    Args:
        depth: of `sample_depth`.
        range_m: nearest and farthest depth that is going to be mapped [m].
    """
    if isinstance(depth, InputError):
        return [f"none of the sampled frames can be read: {depth}"]
    found, (low, high) = [], PLAUSIBLE_DEPTH_M
    median = float(np.median(depth))
    if not low <= median <= high:
        found.append(
            f"the median depth is {median:.3g} m, expected {low:g} to {high:g} m: "
            "the depth scale is probably wrong (--depth-scale)"
        )
    elif range_m is not None:
        near, far = float((depth < range_m[0]).mean()), float((depth > range_m[1]).mean())
        if near + far >= _MOST_IS_OUTSIDE:
            flag = "--depth-max" if far > near else "--depth-min"
            found.append(
                f"{near + far:.0%} of the depth lies outside {range_m[0]:g} to {range_m[1]:g} m, the median is "
                f"{median:.3g} m: little will be mapped ({flag}, or --depth-scale where this is no such place)"
            )
    return found
