"""Grids of free cells: how far each is from what is taken, and which hang together."""

import numpy as np
from scipy import ndimage


def distance_to_taken(free: np.ndarray, cell: float = 1.0) -> np.ndarray:
    """Distance of every cell to the nearest one that is not free, in units of `cell`, the size of one."""
    return np.asarray(ndimage.distance_transform_edt(free, sampling=cell))


def regions(free: np.ndarray) -> tuple[np.ndarray, int]:
    """Number of each cell's connected region, from 1, 0 where it is not free; and how many regions there are."""
    parts = np.zeros(free.shape, np.int32)
    count = ndimage.label(free, output=parts)
    return parts, int(count)  # type: ignore[arg-type]  # with an output array it is only the number
