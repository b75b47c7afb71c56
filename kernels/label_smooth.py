"""Class probabilities averaged over the surface that a pixel lies on, before they are fused.

A network's mistakes are speckled and its borders lie a few pixels off; one surface, a hand wide, rarely changes its
class. Where depth or normals change, nothing is averaged.
"""

from typing import Any

import numpy as np
import warp as wp

from dsmap.classes import NUM_CLASSES
from dsmap.kernels.camera import Camera
from dsmap.kernels.launch import Slice, launch_rows

vec14 = wp.types.vector(NUM_CLASSES, wp.float32)
_RINGS = wp.constant(2)
_SPOKES = wp.constant(8)
_MOST_PIXELS = wp.constant(12.0)  # of the probability image: near things would reach over all of it
_OFF_PLANE, _OFF_PLANE_Z2 = (
    wp.constant(0.015),
    wp.constant(0.002),
)  # [m], [1/m]: a Kinect's noise grows with z^2
_BEND = wp.constant(0.1)  # spread of 1 - cosine between normals: 26 degrees
_VOID_LIMIT = wp.constant(0.999)


@wp.func
def _says_nothing(p: vec14) -> bool:
    total = float(0.0)
    for k in range(1, 14):
        total += p[k]
    # Written so that NaN says nothing.
    return not (total > 1.0e-6 and p[0] <= _VOID_LIMIT)


@wp.func
def _nearest(at: int, size: int, whole: int) -> int:
    """The pixel of an image of `whole` pixels at the centre of one of `size` pixels."""
    return wp.clamp(int((float(at) + 0.5) * float(whole) / float(size)), 0, whole - 1)


@wp.kernel
def _smooth(
    s: Slice, camera: Camera, radius: float,
    vertex: wp.array2d(dtype=wp.vec3), normal: wp.array2d(dtype=wp.vec3), probabilities: wp.array2d(dtype=vec14),
    out: wp.array2d(dtype=vec14),
):  # fmt: skip
    row, lane = wp.tid()
    y = s.first + s.stride * row
    height, width = probabilities.shape[0], probabilities.shape[1]
    for x in range(lane, width, s.step):
        own = probabilities[y, x]
        v = vertex[_nearest(y, height, vertex.shape[0]), _nearest(x, width, vertex.shape[1])]
        n = normal[_nearest(y, height, vertex.shape[0]), _nearest(x, width, vertex.shape[1])]
        if v[2] <= 0.0 or wp.dot(n, n) == 0.0 or _says_nothing(own):
            out[y, x] = own
            continue
        per_m = camera.fx * float(width) / float(camera.width) / v[2]
        reach = wp.min(radius * per_m, _MOST_PIXELS)
        noise = _OFF_PLANE + _OFF_PLANE_Z2 * v[2] * v[2]
        total = own
        weights = float(1.0)
        for ring in range(_RINGS):
            for spoke in range(_SPOKES):
                angle = (float(spoke) + 0.5 * float(ring)) * 0.7853982
                r = reach * float(ring + 1) / float(_RINGS)
                a = x + int(wp.round(r * wp.cos(angle)))
                b = y + int(wp.round(r * wp.sin(angle)))
                if a < 0 or b < 0 or a >= width or b >= height:
                    continue
                p = probabilities[b, a]
                u = vertex[_nearest(b, height, vertex.shape[0]), _nearest(a, width, vertex.shape[1])]
                m = normal[_nearest(b, height, vertex.shape[0]), _nearest(a, width, vertex.shape[1])]
                if u[2] <= 0.0 or _says_nothing(p):
                    continue
                off = wp.dot(u - v, n) / noise
                bend = (1.0 - wp.dot(n, m)) / _BEND
                w = wp.exp(-0.5 * (off * off + bend * bend))
                total += w * p
                weights += w
        out[y, x] = total / weights


def smooth_probabilities(
    probabilities: Any, camera: Camera, vertex: wp.array, normal: wp.array, *, radius: float
) -> wp.array:
    """Probabilities averaged within `radius` over the surface that each pixel lies on: vec14, shape (h, w).

    The weights fall with the distance from the pixel's plane (15 mm + 2 mm/m^2 z^2) and with the bend of the normal
    (26 degrees). Pixels without depth or normal, and void ones, stay as they are and are nobody's neighbours.

    Args:
        probabilities: float32, shape (h, w, 14), NumPy or Warp, any resolution of the whole image.
        camera: of the maps.
        vertex, normal: vec3, shape (H, W), in the camera's frame.
        radius: [m].
    """
    source = probabilities
    if isinstance(source, np.ndarray):
        source = np.ascontiguousarray(source, dtype=np.float32)
    rows = wp.array(source, dtype=vec14, device=vertex.device, copy=False)
    out = wp.empty_like(rows)
    launch_rows(_smooth, *rows.shape, [camera, float(radius), vertex, normal, rows], [out], vertex.device)
    return out
