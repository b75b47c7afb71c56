"""The surface that surfels lie on, as a signed distance at grid points: the input of marching cubes.

The distance is that of implicit moving least squares (Kolluri, "Provably good moving least squares", ACM TALG 2008,
Eq. 1): the mean of the distances to the surfels' planes, weighted by a Gaussian of the distance to their centres and
by their confidence. Only surfels that face the way of the nearest one take part, so that both sides of a thin board
keep apart. Beyond the rim of the surfels there is no distance: the surface ends where what was seen ends.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from dsmap.classes import NUM_CLASSES
from dsmap.kernels.launch import Slice, launch_items

AGREE = wp.constant(0.5)
"""Cosine to the nearest surfel's normal from which a surfel takes part."""
RIM = wp.constant(1.25)
"""So many radii beside the nearest surfel's centre the surface ends: neighbours are about 0.7 radii apart."""
UNKNOWN = wp.constant(1.0e9)
"""Value of a grid point that no surfel is near enough to."""
_votes = wp.types.vector(length=NUM_CLASSES, dtype=wp.float32)


@dataclass
class SurfelPoints:
    """Surfels in a hash grid, on one device; rows as given."""

    position: wp.array
    normal: wp.array
    colour: wp.array
    weight: wp.array
    radius: wp.array
    label: wp.array
    grid: wp.HashGrid
    reach: float
    """Surfels further away than this say nothing [m]."""


def surfel_points(surfels: dict[str, np.ndarray], reach: float, device: Any = "cpu") -> SurfelPoints:
    """Living surfels, by the names of `SurfelMap`, made ready for queries within `reach` [m]."""

    def array(name: str, kind: Any) -> wp.array:
        return wp.array(np.ascontiguousarray(surfels[name]), dtype=kind, device=device)

    position = array("position", wp.vec3)
    grid = wp.HashGrid(128, 128, 128, device=device)
    grid.build(position, reach)
    return SurfelPoints(
        position, array("normal", wp.vec3), array("colour", wp.vec3), array("weight", wp.float32),
        array("radius", wp.float32), array("label", wp.uint8), grid, reach,
    )  # fmt: skip


@wp.func
def _nearest(grid: wp.uint64, x: wp.vec3, reach: float, position: wp.array(dtype=wp.vec3)) -> int:
    """The surfel whose centre is nearest to x, -1 where none is within reach; of two as near the first."""
    best = int(-1)
    best_square = reach * reach
    query = wp.hash_grid_query(grid, x, reach)
    i = int(0)
    while wp.hash_grid_query_next(query, i):
        square = wp.length_sq(position[i] - x)
        if square < best_square or (square == best_square and i < best):
            best = i
            best_square = square
    return best


@wp.kernel
def _distances(
    s: Slice, grid: wp.uint64, first: wp.vec3i, corners: int, side: float, spread: float, reach: float,
    position: wp.array(dtype=wp.vec3), normal: wp.array(dtype=wp.vec3), weight: wp.array(dtype=wp.float32),
    radius: wp.array(dtype=wp.float32), value: wp.array(dtype=wp.float32),
):  # fmt: skip
    block = s.first + s.stride * wp.tid()
    for item in range(block * s.step, wp.min((block + 1) * s.step, s.count)):
        cx = first[0] + item // (corners * corners)
        cy = first[1] + (item // corners) % corners
        cz = first[2] + item % corners
        x = wp.vec3(float(cx) * side, float(cy) * side, float(cz) * side)
        near = _nearest(grid, x, reach, position)
        out = float(UNKNOWN)
        if near >= 0:
            n = normal[near]
            off = wp.dot(n, x - position[near])
            along = wp.length_sq(x - position[near]) - off * off
            rim = wp.max(RIM * radius[near], side)
            if along <= rim * rim:
                total = float(0.0)
                weights = float(0.0)
                query = wp.hash_grid_query(grid, x, reach)
                i = int(0)
                while wp.hash_grid_query_next(query, i):
                    away = x - position[i]
                    square = wp.length_sq(away)
                    cosine = wp.dot(normal[i], n)
                    if square < reach * reach and cosine > AGREE:
                        w = weight[i] * cosine * wp.exp(-square / (2.0 * spread * spread))
                        total += w * wp.dot(normal[i], away)
                        weights += w
                if weights > 0.0:
                    out = total / weights
        value[item] = out


@wp.kernel
def _paint(
    s: Slice, grid: wp.uint64, spread: float, reach: float, points: wp.array(dtype=wp.vec3),
    position: wp.array(dtype=wp.vec3), normal: wp.array(dtype=wp.vec3), colour: wp.array(dtype=wp.vec3),
    weight: wp.array(dtype=wp.float32), radius: wp.array(dtype=wp.float32), label: wp.array(dtype=wp.uint8),
    out_normal: wp.array(dtype=wp.vec3), out_colour: wp.array(dtype=wp.vec3), out_label: wp.array(dtype=wp.uint8),
    out_off: wp.array(dtype=wp.float32),
):  # fmt: skip
    block = s.first + s.stride * wp.tid()
    for item in range(block * s.step, wp.min((block + 1) * s.step, s.count)):
        x = points[item]
        near = _nearest(grid, x, reach, position)
        n = wp.vec3(0.0, 0.0, 0.0)
        c = wp.vec3(0.0, 0.0, 0.0)
        weights = float(0.0)
        off = float(UNKNOWN)
        votes = _votes()
        if near >= 0:
            off = wp.length(x - position[near]) / (RIM * radius[near])
            query = wp.hash_grid_query(grid, x, reach)
            i = int(0)
            while wp.hash_grid_query_next(query, i):
                square = wp.length_sq(x - position[i])
                cosine = wp.dot(normal[i], normal[near])
                if square < reach * reach and cosine > AGREE:
                    w = weight[i] * cosine * wp.exp(-square / (2.0 * spread * spread))
                    n += w * normal[i]
                    c += w * colour[i]
                    weights += w
                    votes[int(label[i])] += w
            if weights > 0.0:
                c = c / weights
            else:
                c = colour[near]
                n = normal[near]
        best = int(0)
        for k in range(1, NUM_CLASSES):  # void only where no surfel has a class
            if votes[k] > 0.0 and (best == 0 or votes[k] > votes[best]):
                best = k
        out_normal[item] = wp.normalize(n)
        out_colour[item] = c
        out_label[item] = wp.uint8(best)
        out_off[item] = off


def surface_distance(
    points: SurfelPoints, first: tuple[int, int, int], corners: int, side: float, spread: float
) -> np.ndarray:
    """Signed distance to the surface at the corners of a cube of voxels.

    Args:
        first: the first corner in whole voxels from the world's origin.
        corners: number of corners an axis.
        side: edge of a voxel [m].
        spread: standard deviation of the Gaussian [m].

    Returns:
        [m], float32, shape (corners, corners, corners), positive in front; UNKNOWN where no surfel is near.
    """
    device = points.position.device
    value = wp.empty(corners**3, dtype=wp.float32, device=device)
    inputs = [points.grid.id, wp.vec3i(*first), corners, side, spread, points.reach]
    surfels = [points.position, points.normal, points.weight, points.radius]
    launch_items(_distances, corners**3, [*inputs, *surfels], [value], device)
    return value.numpy().reshape(corners, corners, corners)


def paint_points(
    points: SurfelPoints, vertices: np.ndarray, spread: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Normals (N, 3), colours RGB in [0, 1] (N, 3), classes uint8 (N,) of points on the surface, shape (N, 3) [m],
    and how far they are from the nearest surfel's centre (N,), in its radius out to its rim: more than 1 is beyond it.

    Normal and colour are means of the surfels about a point, weighted as in `surface_distance`; the class is the one
    with the most weight, 0 where none has a class.
    """
    device, count = points.position.device, len(vertices)
    at = wp.array(np.ascontiguousarray(vertices, dtype=np.float32), dtype=wp.vec3, device=device)
    out = [wp.empty(count, dtype=kind, device=device) for kind in (wp.vec3, wp.vec3, wp.uint8, wp.float32)]
    surfels = [points.position, points.normal, points.colour, points.weight, points.radius, points.label]
    launch_items(_paint, count, [points.grid.id, spread, points.reach, at, *surfels], out, device)
    normal, colour, label, off = (array.numpy() for array in out)
    return normal, colour, label, off
