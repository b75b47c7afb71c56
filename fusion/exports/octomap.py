"""OctoMap (Hornung et al., Autonomous Robots 2013): free and occupied voxels of space as `.bt` or `.ot`.

Occupied are the voxels that surfels lie in; free those that a camera looked through on its way to one. The format is
that of OctoMap's `AbstractOcTree::write` and `OcTree::writeBinary`: nodes from the root on, children before siblings.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.files import atomic_path
from dsmap.frame import Intrinsics
from dsmap.fusion.exports.level import transformed
from dsmap.fusion.runs.map_renderer import MapRenderer
from dsmap.fusion.runs.read_run import SavedRun, evenly_spread

OCTREE_VOXEL_M = 0.05
"""Edge of a voxel by default [m]."""
_DEPTH = 16
"""Levels below the root; the world's origin lies in the middle of 2^16 voxels an axis."""
_RAYS = (80, 60)
"""Rays of a frame that free space is looked for along."""
_FRAMES = 150
_LOG_ODDS = {True: 3.5, False: -2.0}
"""Of occupied and of free voxels: OctoMap's clamping thresholds, 0.97 and 0.12."""


@dataclass
class Voxels:
    """Keys of voxels, int64, shape (N, 3): whole voxels from the lowest corner of OctoMap's space."""

    occupied: np.ndarray
    free: np.ndarray
    voxel: float


def octomap_voxels(run: SavedRun, T_level_world: np.ndarray, voxel: float = OCTREE_VOXEL_M) -> Voxels:
    """What the run's cameras saw of space, in the level frame.

    Raises:
        InputError: the map has no surfels, or spans more than OctoMap's space at this size of a voxel.
    """
    surfels = run.surfels.numpy()
    alive = surfels["weight"] > 0
    if not alive.any():
        raise InputError(f"{run.path}: the map has no surfels, expected some")
    occupied = _keys(transformed(T_level_world, surfels["position"][alive].astype(np.float64)), voxel)
    camera = _small(run.intrinsics)
    render = MapRenderer(run, camera)
    free = [np.zeros((0, 3), np.int64)]
    tracked = np.flatnonzero(run.tracked)
    for i in tracked[evenly_spread(len(tracked), _FRAMES)]:
        index = render.index(run.poses[i])
        ends = transformed(
            T_level_world, surfels["position"][np.unique(index[index >= 0])].astype(np.float64)
        )
        free.append(_through((T_level_world @ run.poses[i])[:3, 3], ends, voxel))
    looked_through = np.unique(np.concatenate(free), axis=0)
    return Voxels(occupied, looked_through[~np.isin(_morton(looked_through), _morton(occupied))], voxel)


def write_octomap(path: Path, voxels: Voxels) -> int:
    """Write `.ot` (log-odds) or `.bt` (free or occupied), by the path's suffix; returns the number of leaves."""
    codes = np.concatenate([_morton(voxels.occupied), _morton(voxels.free)])
    full = np.concatenate([np.ones(len(voxels.occupied), bool), np.zeros(len(voxels.free), bool)])
    order = np.argsort(codes)
    codes, full = codes[order], full[order]
    binary = path.suffix == ".bt"
    data, nodes = (_binary_tree if binary else _full_tree)(codes, full)
    kind = "OcTree binary file" if binary else "OcTree file"
    header = f"# Octomap {kind}\n# written by dsmap\nid OcTree\nsize {nodes}\nres {voxels.voxel:g}\ndata\n"
    with atomic_path(path) as temporary:
        temporary.write_bytes(header.encode("ascii") + data)
    return len(codes)


def _binary_tree(codes: np.ndarray, full: np.ndarray) -> tuple[bytes, int]:
    """Two bytes an inner node: two bits a child, 01 free, 10 occupied, 11 with children, lowest child first."""
    bits, places, levels, nodes = [], [], [], 1
    child, state = codes, np.where(full, 2, 1)
    for level in range(_DEPTH - 1, -1, -1):
        parent, inverse = np.unique(child >> 3, return_inverse=True)
        value = np.zeros(len(parent), np.int64)
        np.bitwise_or.at(value, inverse, state << 2 * (child & 7))
        nodes += len(child)
        bits.append(value)
        places.append(parent << 3 * (_DEPTH - level))
        levels.append(np.full(len(parent), level))
        child, state = parent, np.full(len(parent), 3)
    order = np.lexsort((np.concatenate(levels), np.concatenate(places)))
    return np.concatenate(bits)[order].astype("<u2").tobytes(), nodes


def _full_tree(codes: np.ndarray, full: np.ndarray) -> tuple[bytes, int]:
    """Five bytes a node: log-odds (of an inner node its children's largest), and which children there are."""
    record = np.dtype([("value", "<f4"), ("children", "u1")])
    value = np.where(full, _LOG_ODDS[True], _LOG_ODDS[False]).astype(np.float32)
    child, mask = codes, np.zeros(len(codes), np.int64)
    rows, places, levels = [], [], []
    for level in range(_DEPTH, -1, -1):
        table = np.zeros(len(child), record)
        table["value"], table["children"] = value, mask
        rows.append(table)
        places.append(child << 3 * (_DEPTH - level))
        levels.append(np.full(len(child), level))
        if level == 0:
            break
        parent, inverse = np.unique(child >> 3, return_inverse=True)
        mask = np.zeros(len(parent), np.int64)
        np.bitwise_or.at(mask, inverse, 1 << (child & 7))
        best = np.full(len(parent), -np.inf, np.float32)
        np.maximum.at(best, inverse, value)
        child, value = parent, best
    order = np.lexsort((np.concatenate(levels), np.concatenate(places)))
    table = np.concatenate(rows)[order]
    return table.tobytes(), len(table)


def _keys(points: np.ndarray, voxel: float) -> np.ndarray:
    """Different keys of the voxels that points lie in."""
    keys = np.unique(np.floor(points / voxel).astype(np.int64), axis=0) + (1 << _DEPTH - 1)
    if len(keys) and (keys.min() < 0 or keys.max() >= 1 << _DEPTH):
        raise InputError(f"a map of this extent does not fit voxels of {voxel} m, expected larger ones")
    return keys


def _morton(keys: np.ndarray) -> np.ndarray:
    """The bits of x, y and z by turns, x lowest: the path from the root to each voxel."""
    code = np.zeros(len(keys), np.int64)
    for bit in range(_DEPTH):
        for axis in range(3):
            code |= (keys[:, axis] >> bit & 1) << 3 * bit + axis
    return code


def _through(eye: np.ndarray, ends: np.ndarray, voxel: float) -> np.ndarray:
    """Keys of the voxels between an eye and points, the last voxel before each point left out."""
    way = ends - eye
    length = np.linalg.norm(way, axis=1)
    steps = np.arange(0.5 * voxel, max(length.max(initial=0.0) - 1.5 * voxel, 0.0), 0.7 * voxel)
    inside = steps[None] < length[:, None] - 1.5 * voxel
    ray, step = np.nonzero(inside)
    return _keys(eye + way[ray] * (steps[step] / length[ray])[:, None], voxel)


def _small(camera: Intrinsics) -> Intrinsics:
    share = min(_RAYS[0] / camera.width, _RAYS[1] / camera.height, 1.0)
    return camera.scaled(max(round(camera.width * share), 1), max(round(camera.height * share), 1))
