"""The slow twin of `dsmap.kernels.dense_crf`: every pair of points, no cut-off."""

import numpy as np


def mean_field(position, colour, normal, mass, log_p, config) -> np.ndarray:
    """Mean field with both Gaussian kernels over all pairs, symmetrically normalised; probabilities (N, 13)."""

    def squared(a: np.ndarray) -> np.ndarray:
        return ((a[:, None] - a[None]) ** 2).sum(axis=2)

    near = squared(position) / config.position**2
    both = np.zeros(near.shape)
    for weight, apart in (
        (config.weight_colour, squared(colour) / (config.colour / 255) ** 2),
        (config.weight_normal, squared(normal) / config.normal**2),
    ):
        k = np.exp(-0.5 * (near + apart))
        total = k @ mass
        both += weight * k / np.sqrt(total[:, None] * total[None])
    q = np.exp(log_p)
    for _ in range(config.iterations):
        e = log_p + (both * mass) @ q
        q = np.exp(e - e.max(axis=1, keepdims=True))
        q /= q.sum(axis=1, keepdims=True)
    return q
