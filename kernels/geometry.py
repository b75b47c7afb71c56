"""What a network sees of a frame's geometry: inverse depth, the angle to gravity's up, height above the floor.

The useful part of HHA (Gupta et al., ECCV 2014), from the vertex and normal maps that a frame has anyway. The
channels are scaled to about zero mean and unit spread; 0 is what a pixel without depth shows.
"""

import numpy as np
import warp as wp

from dsmap.kernels.launch import Slice, launch_rows

_NEAREST = wp.constant(0.3)  # [m]
_MEAN_INVERSE_DEPTH = wp.constant(0.45)  # [1/m], of indoor views: things between 1 and 5 m away
_SPREAD_INVERSE_DEPTH = wp.constant(0.25)
_LOWEST = wp.constant(-0.3)  # [m] above the floor; what lies further down is a wrong floor or a mirror
_HIGHEST = wp.constant(3.5)
_MEAN_HEIGHT = wp.constant(1.0)
_SPREAD_HEIGHT = wp.constant(0.8)


@wp.func
def _geometry(v: wp.vec3, n: wp.vec3, up: wp.vec3, floor_height: float) -> wp.vec4:
    """The four channels of a point in the camera's frame; an invalid normal is 0, and so is its cosine."""
    if v[2] <= 0.0:
        return wp.vec4(0.0, 0.0, 0.0, 0.0)
    inverse_depth = 1.0 / wp.max(v[2], _NEAREST)
    height = wp.clamp(wp.dot(v, up) - floor_height, _LOWEST, _HIGHEST)
    return wp.vec4(
        (inverse_depth - _MEAN_INVERSE_DEPTH) / _SPREAD_INVERSE_DEPTH,
        wp.dot(n, up),
        (height - _MEAN_HEIGHT) / _SPREAD_HEIGHT,
        1.0,
    )


@wp.kernel
def _channels(
    s: Slice, up: wp.vec3, floor_height: float,
    vertex: wp.array2d(dtype=wp.vec3), normal: wp.array2d(dtype=wp.vec3),
    channels: wp.array2d(dtype=wp.vec4),
):  # fmt: skip
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, vertex.shape[1], s.step):
        channels[y, x] = _geometry(vertex[y, x], normal[y, x], up, floor_height)


def geometry_channels(vertex: wp.array, normal: wp.array, up: np.ndarray, floor_height: float) -> wp.array:
    """Geometry of a frame as a network takes it: vec4, shape (H, W); its `numpy()` has the shape (H, W, 4).

    The channels are (1 / max(z, 0.3 m) - 0.45) / 0.25; the cosine between the normal (towards the camera) and up,
    0 where there is no normal: floors +1, walls 0, ceilings -1; (h - 1 m) / 0.8 m for the height h above the floor,
    kept within -0.3 and 3.5 m; and 1 where there is depth. Pixels without depth are 0 in all four.

    Args:
        vertex, normal: vec3, shape (H, W), in the camera's frame, as `preprocess` makes them.
        up: unit vector in the camera's frame, shape (3,); (0, -1, 0) for a level camera.
        floor_height: where the floor lies along `up`, seen from the camera [m]; negative for a floor below it.
    """
    out = wp.empty(vertex.shape, dtype=wp.vec4, device=vertex.device)
    inputs = [wp.vec3(*(float(v) for v in up)), float(floor_height), vertex, normal]
    launch_rows(_channels, *vertex.shape, inputs, [out], vertex.device)
    return out
