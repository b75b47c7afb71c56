"""SemanticFusion's refinement: a fully connected CRF over the surfels of a map (McCormac et al., ICRA 2017, III-D)."""

from collections.abc import Mapping

import numpy as np

from dsmap.fusion.config import CrfConfig
from dsmap.fusion.objects.segments import class_means, find_cells, labelled
from dsmap.kernels.dense_crf import Kernels, find_neighbours, mean_field

_REACH = 3.5
"""Standard deviations of position at which both kernels end: beyond are 2 of 1000 of a surface's weight."""
_LEAST = 1e-3
_FLOOR = 1e-3


def refine_by_crf(
    surfels: Mapping[str, np.ndarray], probabilities: np.ndarray, config: CrfConfig, device: object = "cpu"
) -> tuple[np.ndarray, np.ndarray]:
    """Class probabilities after mean field, float32 (N, 13), and which surfels have any, bool (N,).

    Surfels of one cell (see `segments.find_cells`) send and receive one message; each adds it to its own log
    probabilities. A surfel that was never labelled is uniform, and takes its neighbours'.

    Args:
        surfels: arrays by the names of SurfelMap, N rows each.
        probabilities: of the 13 classes, shape (N, 13).
    """
    own = labelled(probabilities, surfels["observations"])
    p = np.where(own[:, None], probabilities, 1.0 / probabilities.shape[1]).astype(np.float32)
    cells = find_cells(surfels, config.cell)
    if len(cells) == 0 or not own.any():
        return p, own
    mass = cells.sum(np.ones(len(p)))
    neighbours = find_neighbours(
        gaussian_kernels(config), cells.position, cells.colour, cells.normal, mass, device
    )
    unary = np.log(np.maximum(class_means(cells, probabilities, surfels["observations"]), _FLOOR))
    _, message = mean_field(neighbours, unary, config.iterations)
    there = cells.of_surfel >= 0
    refined = np.log(np.maximum(p, _FLOOR))
    refined[there] += message[cells.of_surfel[there]]
    refined = np.exp((refined - refined.max(axis=1, keepdims=True)) / config.temperature)
    # A surfel with labels near none has learnt nothing: its message is flat.
    heard = np.zeros(len(p), bool)
    heard[there] = np.ptp(message, axis=1)[cells.of_surfel[there]] > 1e-3
    return refined / refined.sum(axis=1, keepdims=True), own | heard


def gaussian_kernels(config: CrfConfig) -> Kernels:
    """The kernels of a configuration, for `kernels.dense_crf`."""
    k = Kernels()
    k.reach, k.least = _REACH * config.position, _LEAST
    k.position, k.colour, k.normal = (
        0.5 / sigma**2 for sigma in (config.position, config.colour / 255, config.normal)
    )
    k.weight_colour, k.weight_normal = config.weight_colour, config.weight_normal
    return k
