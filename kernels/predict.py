"""Model prediction: what the surfel map looks like from a pose, as maps in that camera's frame."""

import numpy as np
import warp as wp

from dsmap.kernels.camera import Camera
from dsmap.kernels.index_map import ALWAYS, UNSTABLE_PENALTY, render_index
from dsmap.kernels.launch import Slice, launch_rows
from dsmap.kernels.prefetch import AHEAD, fetch_early
from dsmap.kernels.types import ModelMaps, SurfelArrays, SurfelMap


@wp.kernel
def _resolve(
    s: Slice,
    index: wp.array2d(dtype=wp.int32),
    m: SurfelArrays,
    colour: wp.array2d(dtype=wp.vec3),
    time: wp.array2d(dtype=wp.int32),
):
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, index.shape[1], s.step):
        soon = index[y, wp.min(x + AHEAD, index.shape[1] - 1)]
        fetch_early(m.colour, soon)
        fetch_early(m.t_updated, soon)
        i = index[y, x]
        if i >= 0:
            colour[y, x] = m.colour[i]
            time[y, x] = m.t_updated[i]
        else:
            colour[y, x] = wp.vec3(0.0, 0.0, 0.0)
            time[y, x] = -1


def predict_model(
    surfels: SurfelMap,
    camera: Camera,
    T_world_camera: np.ndarray,
    *,
    max_depth: float,
    maps: ModelMaps,
    min_weight: float = 0.0,
    stable_weight: float = 0.0,
    t_min: int = 0,
    t_max: int = ALWAYS,
    penalty: float = UNSTABLE_PENALTY,
    visible: wp.array | None = None,
    resolution: float = 0.0,
) -> None:
    """Render the map into a camera: `maps` (out, shapes (H, W) of the camera) in that camera's frame.

    The vertex is where the pixel's ray meets the surfel's disc. Which surfels are seen: see `render_index`
    (the active model is t_min = now - window, the inactive one t_max = now - window - 1); `visible` holds
    the blocks to walk (see `culling.Blocks`), None all; `resolution` is the map's. Pixels without
    a surfel have index -1, vertex, normal and colour 0, time -1.
    """
    m = surfels
    render_index(
        m, camera, T_world_camera, max_depth=max_depth, index=maps.index, min_weight=min_weight,
        stable_weight=stable_weight, t_min=t_min, t_max=t_max, penalty=penalty, visible=visible,
        vertex=maps.vertex, normal=maps.normal, resolution=resolution,
    )  # fmt: skip
    launch_rows(_resolve, *maps.index.shape, [maps.index, m.arrays], [maps.colour, maps.time], m.device)
