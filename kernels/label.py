"""Label fusion: every visible surfel gathers the class probabilities of the pixel that it projects to."""

from typing import Any, Literal

import numpy as np
import warp as wp

from dsmap.classes import NUM_CLASSES
from dsmap.errors import InputError
from dsmap.kernels.camera import Camera, surfel_at, to_transform
from dsmap.kernels.label_smooth import vec14
from dsmap.kernels.launch import Slice, first_surfel, launch_blocks, launch_rows
from dsmap.kernels.types import NUM_EVIDENCE, FrameImages, FrameMaps, SurfelArrays, SurfelMap

Rule = Literal["bayes", "mean", "geometric"]
"""How observations combine: product (Eq. 5-6), arithmetic mean, or geometric mean of the probabilities."""

vec13 = wp.types.vector(NUM_EVIDENCE, wp.float32)
_VOID_LIMIT = wp.constant(0.999)
_MOST_ENTROPY = wp.constant(2.5649494)  # log 13
_LEAST_SURE = wp.constant(0.02)


@wp.struct
class Gate:
    """Which surfels a label image is seen by."""

    max_distance: wp.float32  # [m] between a surfel's depth and its pixel's
    max_distance_z2: wp.float32  # [1/m] or this times depth squared, where that is more
    t_min: wp.int32  # frame number: older surfels are not asked


@wp.kernel
def _prepare(
    s: Slice,
    floor: float,
    use_log: int,
    sureness: float,
    probabilities: wp.array2d(dtype=vec14),
    observed: wp.array2d(dtype=vec13),
    weight_of: wp.array2d(dtype=wp.float32),
):
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, probabilities.shape[1], s.step):
        p = probabilities[y, x]
        total = float(0.0)
        for k in range(1, 14):
            total += p[k]
        q = vec13()
        sure = float(0.0)
        # The comparisons are written so that NaN is no observation.
        if total > 1.0e-6 and p[0] <= _VOID_LIMIT:
            per_total = 1.0 / total
            entropy = float(0.0)
            for k in range(13):
                q[k] = p[k + 1] * per_total
                entropy -= q[k] * wp.log(wp.max(q[k], 1.0e-9))
                if use_log == 1:
                    q[k] = wp.log(wp.max(q[k], floor))
            sure = wp.pow(wp.max(1.0 - entropy / _MOST_ENTROPY, _LEAST_SURE), sureness)
        observed[y, x] = q
        weight_of[y, x] = sure


@wp.func
def _sample(
    camera: Camera,
    x: int,
    y: int,
    observed: wp.array2d(dtype=vec13),
    weight_of: wp.array2d(dtype=wp.float32),
) -> tuple[vec13, float, float]:
    """What a pixel observes times its weight, that weight, and the valid neighbours' share; bilinear over these."""
    width = observed.shape[1]
    height = observed.shape[0]
    # Both images show the same view, with integer pixel centres; the border repeats.
    a = wp.clamp((float(x) + 0.5) * float(width) / float(camera.width) - 0.5, 0.0, float(width - 1))
    b = wp.clamp((float(y) + 0.5) * float(height) / float(camera.height) - 0.5, 0.0, float(height - 1))
    x0 = int(a)
    y0 = int(b)
    a = a - float(x0)
    b = b - float(y0)
    e = vec13()
    weight = float(0.0)
    share = float(0.0)
    for k in range(4):
        xk = wp.min(x0 + k % 2, width - 1)
        yk = wp.min(y0 + k / 2, height - 1)
        s = (a if k % 2 == 1 else 1.0 - a) * (b if k / 2 == 1 else 1.0 - b)
        sure = weight_of[yk, xk]
        if sure > 0.0 and s > 0.0:
            e += (s * sure) * observed[yk, xk]
            weight += s * sure
            share += s
    per_share = 1.0 / wp.max(share, 1.0e-6)
    return per_share * e, per_share * weight, share


@wp.kernel
def _observe(
    s: Slice,
    blocks: wp.array(dtype=wp.int32),
    camera: Camera,
    T_camera_world: wp.mat44,
    gate: Gate,
    is_log: int,
    frame: FrameImages,
    observed: wp.array2d(dtype=vec13),
    weight_of: wp.array2d(dtype=wp.float32),
    m: SurfelArrays,
    evidence: wp.array(dtype=vec13),
):
    first = first_surfel(s, blocks, wp.tid())
    for i in range(first, wp.min(first + s.step, s.count)):
        p, at = surfel_at(camera, T_camera_world, i, gate.t_min, m)
        x = at[0]
        y = at[1]
        if x < 0:
            continue
        d = frame.depth[y, x]
        if d <= 0.0 or frame.edge[y, x] != wp.uint8(0):
            continue
        if wp.abs(p[2] - d) >= wp.max(gate.max_distance, gate.max_distance_z2 * d * d):
            continue
        e, sure, share = _sample(camera, x, y, observed, weight_of)
        if share < 0.5:
            continue
        # Eq. 5-6 in log space: log p(l | K_1..t) = log p(l | K_t) + log p(l | K_1..t-1) - log Z.
        e += evidence[i]
        best = int(0)
        top = e[0]
        for k in range(1, 13):
            if e[k] > top:
                top = e[k]
                best = k
        if is_log == 1:
            # Only differences count: the best class stays at 0, where float32 is finest.
            for k in range(13):
                e[k] = e[k] - top
        evidence[i] = e
        m.observations[i] = m.observations[i] + sure
        m.label[i] = wp.uint8(best + 1)


def _rows_as_vectors(evidence: wp.array) -> wp.array:
    """The evidence array, shape (capacity, 13), as vectors of 13 on the same memory."""
    return wp.array(ptr=evidence.ptr, shape=evidence.shape[0], dtype=vec13, device=evidence.device)


def update_labels(
    surfels: SurfelMap,
    camera: Camera,
    T_world_camera: np.ndarray,
    frame: FrameMaps,
    probabilities: Any,
    *,
    rule: Rule = "bayes",
    floor: float = 1e-3,
    sureness: float = 0.0,
    max_distance: float = 0.05,
    max_distance_z2: float = 0.0,
    t_min: int = 0,
    visible: wp.array | None = None,
) -> None:
    """Fuse one frame's class probabilities into the evidence of every surfel that the camera sees.

    A surfel updated since frame t_min is seen where its depth differs from its pixel's by less than
    max(max_distance [m], max_distance_z2 [1/m] x depth^2), off depth edges. The 13 classes are
    renormalised without void; pixels that are void (> 0.999), NaN or all zero say nothing.
    bayes, geometric: evidence += log max(p, floor) (Eq. 5-6 in log space; the floor keeps one zero from
    killing a class), up to a constant that makes each row's maximum 0. mean: evidence += p.
    Each observation weighs (1 - H / log 13)^sureness for its entropy H, at least 0.02^sureness; 0: all weigh 1. The
    label becomes the class of most evidence, observations grow by the weight.

    frame: the maps of its level 0.
    visible: blocks that may hold surfels in view (see `culling.Blocks`); None walks the whole map.
    probabilities: float32, shape (h, w, 14), NumPy or Warp, or vec14, shape (h, w), any resolution of the
    whole image; sampled bilinearly (log probabilities for bayes and geometric) at the pixel's centre.
    Raises InputError for probabilities of another shape.
    """
    shape = tuple(probabilities.shape)
    if getattr(probabilities, "dtype", None) == vec14:  # of `smooth_probabilities`
        shape = (*shape, NUM_CLASSES)
    if len(shape) != 3 or shape[2] != NUM_CLASSES:
        raise InputError(f"class probabilities have the shape {shape}; expected (h, w, {NUM_CLASSES}).")
    m, device = surfels, surfels.device
    source = probabilities
    if isinstance(source, np.ndarray):
        source = np.ascontiguousarray(source, dtype=np.float32)
    rows = wp.array(source, dtype=vec14, device=device, copy=False)
    observed = wp.empty(shape[:2], dtype=vec13, device=device)
    weight_of = wp.empty(shape[:2], dtype=wp.float32, device=device)
    use_log = int(rule != "mean")
    inputs: list[Any] = [floor, use_log, float(sureness), rows]
    launch_rows(_prepare, shape[0], shape[1], inputs, [observed, weight_of], device)

    gate = Gate()
    gate.max_distance, gate.max_distance_z2, gate.t_min = max_distance, max_distance_z2, t_min
    T_camera_world = to_transform(np.linalg.inv(T_world_camera))
    inputs = [camera, T_camera_world, gate, use_log, frame.images, observed, weight_of, m.arrays]
    launch_blocks(_observe, visible, m.count, inputs, [_rows_as_vectors(m.evidence)], device)


def posterior(
    surfels: SurfelMap, rule: Rule, *, temperature: float = 1.0, first: int = 0, last: int | None = None
) -> np.ndarray:
    """Class probabilities of surfels first .. last - 1 (all by default), float32, shape (N, 13).

    bayes: softmax of the evidence (Eq. 6); geometric: softmax of evidence / observations; mean:
    evidence / observations. `temperature` > 1 flattens them: p^(1 / temperature), renormalised.
    Surfels that were never observed are uniform.
    """
    rows = slice(first, surfels.count if last is None else min(last, surfels.count))
    evidence = (
        surfels.evidence[rows].numpy() if rows.stop > rows.start else np.zeros((0, NUM_EVIDENCE), np.float32)
    )
    n = surfels.observations.numpy()[rows, None] if rows.stop > rows.start else evidence[:, :1]
    per_n = np.where(n > 0, n, 1.0)
    if rule == "mean":
        with np.errstate(divide="ignore"):
            log_p = np.log(np.where(n > 0, evidence / per_n, 1.0))
    else:
        log_p = evidence / per_n if rule == "geometric" else evidence
    log_p = (log_p - log_p.max(axis=1, keepdims=True)) / np.float32(temperature)
    p = np.exp(log_p, dtype=np.float32)
    return p / p.sum(axis=1, keepdims=True)
