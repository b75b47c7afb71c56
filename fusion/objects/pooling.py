"""Class probabilities a segment: what its surfels say together, and what that makes of each of them.

Nakajima et al. (IROS 2018, section III-D) keep one distribution a segment. Here a surfel keeps a share of its own,
as a geometric segment may hold a picture and its wall.
"""

from collections.abc import Mapping

import numpy as np

from dsmap.fusion.config import SegmentConfig
from dsmap.fusion.objects.segments import labelled
from dsmap.kernels.label import Rule
from dsmap.kernels.types import NUM_EVIDENCE, SurfelMap

_FLOOR = 1e-4
_FAINT = 0.01
"""Observations that a surfel counts as having which its segment alone has labelled."""


def pool_probabilities(
    probabilities: np.ndarray, observations: np.ndarray, segment: np.ndarray, config: SegmentConfig
) -> tuple[np.ndarray, np.ndarray]:
    """Probabilities (p_i^(1 - w) q_s^w)^k, renormalised, for the mean q_s of the segment's distributions.

    The mean over a segment says how large a part of it a class has; where a segment is one thing, the largest part
    is right more often than that, hence the sharpness k > 1.

    Args:
        probabilities: of every surfel, shape (N, 13).
        observations: of every surfel, 0 where it was never labelled, shape (N,).
        segment: of every surfel, >= 0, shape (N,); 0 has no segment and keeps its own.
        config: weight w and sharpness k.

    Returns:
        The probabilities, float32 (N, 13), and where there are any, bool (N,): of labelled surfels and of those
        in a segment with labelled ones.
    """
    own = labelled(probabilities, observations)
    p = np.where(own[:, None], probabilities, 0.0)
    count = int(segment.max(initial=0)) + 1
    total = np.stack([np.bincount(segment[own], p[own, k], count) for k in range(p.shape[1])], axis=1)
    per = total.sum(axis=1, keepdims=True)
    mean = np.where(per > 0, total / np.maximum(per, 1e-12), 0.0)
    known = (per[:, 0] > 0) & (np.arange(count) > 0)
    share = np.where(known[segment], np.where(own, config.weight, 1.0), 0.0)[:, None]
    q = np.where(known[segment, None], mean[segment], 1.0)
    log_p = (1 - share) * np.log(np.maximum(np.where(own[:, None], p, 1.0), _FLOOR)) + share * np.log(
        np.maximum(q, _FLOOR)
    )
    log_p *= config.sharpness
    pooled = np.exp(log_p - log_p.max(axis=1, keepdims=True, initial=-np.inf))
    return (pooled / pooled.sum(axis=1, keepdims=True)).astype(np.float32), own | known[segment]


def set_probabilities(
    surfels: SurfelMap, probabilities: np.ndarray, there: np.ndarray, rule: Rule, temperature: float = 1.0
) -> None:
    """Let `label.posterior` give these probabilities; labels follow, observations stay as they are.

    Args:
        probabilities: shape (N, 13).
        there: surfels that have any, bool, shape (N,); the others are left as they are.
    """
    if surfels.count == 0:
        return
    arrays: Mapping[str, np.ndarray] = {
        name: getattr(surfels, name).numpy()[: surfels.count].copy()
        for name in ("evidence", "observations", "label")
    }
    evidence, n, label = arrays["evidence"], arrays["observations"], arrays["label"]
    n[there] = np.where(n[there] > 0, n[there], _FAINT)
    p = np.maximum(probabilities[there].astype(np.float64), 1e-9)
    log_p = temperature * np.log(p)
    log_p -= log_p.max(axis=1, keepdims=True, initial=-np.inf)
    values = {"bayes": log_p, "geometric": log_p * n[there, None], "mean": np.exp(log_p) * n[there, None]}
    assert evidence.shape[1] == NUM_EVIDENCE
    evidence[there] = values[rule]
    label[there] = p.argmax(axis=1) + 1
    for name, values_now in arrays.items():
        getattr(surfels, name)[: surfels.count].assign(values_now)
