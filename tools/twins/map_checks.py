"""Kernels that work on whole maps, or on views of them, and plain filters: each against its twin."""

from typing import Any

import numpy as np
import warp as wp

from dsmap.fusion.config import CrfConfig, GraphConfig
from dsmap.fusion.lie import exp_se3
from dsmap.fusion.loops.deformation_graph import DeformationGraph
from dsmap.fusion.objects.crf import gaussian_kernels
from dsmap.kernels import filters
from dsmap.kernels.dense_crf import find_neighbours
from dsmap.kernels.dense_crf import mean_field as kernel_mean_field
from dsmap.kernels.geometry import geometry_channels
from dsmap.kernels.mesh_distance import closest_on_mesh
from dsmap.kernels.moving import carried_over, was_free_space
from dsmap.kernels.reactivate import reactivate
from dsmap.kernels.segment_graph import join_cells
from dsmap.kernels.surface import UNKNOWN, paint_points, surface_distance, surfel_points
from dsmap.tools.twins import deform, dense_crf, images, mesh, segment_graph, surface, views
from dsmap.tools.twins.check import BORDERLINE, Check, apart
from dsmap.tools.twins.scene import CAMERA, TIME, frame_arrays, pose, surfel_map

_SHAPE = (CAMERA.height, CAMERA.width)


def _vectors(array: np.ndarray, device: Any) -> wp.array:
    return wp.array(np.ascontiguousarray(array, np.float32), dtype=wp.vec3, device=device)


def _share(different: np.ndarray) -> float:
    """Share of entries that differ, beyond those that may be borderline."""
    return max(float(np.mean(different)) - BORDERLINE, 0.0)


def _bilateral(device: Any) -> float:
    depth = frame_arrays()["depth"]
    out = wp.empty(_SHAPE, dtype=float, device=device)
    filters.bilateral(wp.array(depth, dtype=float, device=device), 3.0, 0.03, out)
    return apart(out, images.bilateral(depth, 3.0, 0.03, filters.BILATERAL_RADIUS))


def _colour(device: Any) -> float:
    rgb = np.random.default_rng(0).integers(0, 256, (*_SHAPE, 3), dtype=np.uint8)
    colour = wp.full(_SHAPE, wp.vec3(), dtype=wp.vec3, device=device)
    grey = wp.empty(_SHAPE, dtype=float, device=device)
    half = wp.empty((_SHAPE[0] // 2, _SHAPE[1] // 2), dtype=float, device=device)
    filters.colour(wp.array(rgb, dtype=wp.uint8, device=device), colour)
    filters.intensity(colour, grey)
    filters.half(grey, half)
    light = rgb @ np.array([0.299, 0.587, 0.114]) / 255
    blocks = light.reshape(half.shape[0], 2, half.shape[1], 2).mean(axis=(1, 3))
    return max(apart(colour, rgb / 255), apart(grey, light), apart(half, blocks))


def _geometry(device: Any) -> float:
    arrays, up = frame_arrays(), np.array([0.36, -0.8, -0.48])
    found = geometry_channels(
        _vectors(arrays["vertex"], device), _vectors(arrays["normal"], device), up, -1.2
    )
    return apart(found, images.geometry_channels(arrays["vertex"], arrays["normal"], up, -1.2))


def _free_space(device: Any) -> float:
    rng, vertex = np.random.default_rng(0), frame_arrays()["vertex"]
    poses = [exp_se3(rng.normal(0, 0.05, 6)) for _ in range(3)]
    past = [frame_arrays(k)["depth"] + np.float32(0.03 * k) for k in range(1, 4)]
    near, far = 0.04, 0.03
    free, known = (wp.full(_SHAPE, 0, dtype=wp.uint8, device=device) for _ in range(2))
    was_free_space(
        CAMERA, _vectors(vertex, device), poses, past, free=free, known=known, margin=near, margin_z2=far
    )
    expected = views.was_free_space(CAMERA, vertex.astype(np.float64), poses, past, near, far)
    return max(_share(a.numpy() != e) for a, e in zip((free, known), expected, strict=True))


def _things(device: Any) -> float:
    rng, vertex = np.random.default_rng(0), frame_arrays()["vertex"]
    T, things = exp_se3(rng.normal(0, 0.02, 6)), rng.integers(0, 2, _SHAPE, dtype=np.uint8)
    depth = (vertex[..., 2] + rng.normal(0, 0.1, _SHAPE)).astype(np.float32)
    found = carried_over(CAMERA, _vectors(vertex, device), T, depth, things, 0.1)
    return _share(found != views.carried_over(CAMERA, vertex.astype(np.float64), T, depth, things, 0.1))


def _reactivation(device: Any) -> float:
    T, gates = pose(1), {"t_min": 20, "distance": 0.02, "distance_z2": 0.01}
    m = surfel_map(T, count=800, seed=1, device=device)
    before = {name: np.array(values) for name, values in m.numpy().items()}
    inactive = frame_arrays(1)["vertex"]
    active = inactive + np.array([0, 0, 0.03], np.float32) * (np.arange(_SHAPE[1]) % 3 - 1)[None, :, None]
    active[inactive[..., 2] == 0] = 0
    expected = views.reactivate(before, CAMERA, T, inactive, active, **gates)
    reactivate(m, CAMERA, T, _vectors(inactive, device), _vectors(active, device), time=TIME, **gates)
    return _share((m.numpy()["t_updated"] == TIME) != expected)


def _deformation(device: Any) -> float:
    rng, m = np.random.default_rng(0), surfel_map(pose(1), count=500, device=device)
    before = {name: values.astype(np.float64) for name, values in m.numpy().items()}
    before["t_created"] = before["t_created"].astype(int)
    config = GraphConfig(spacing=400, min_nodes=8)
    graph = DeformationGraph(rng.uniform(-2, 2, (40, 3)), np.sort(rng.integers(0, 5, 40)), config)
    graph.deformation = rng.normal(0, 0.1, graph.deformation.shape)
    expected = deform.deform(graph, before)
    graph.apply_to_surfels(m)
    return max(apart(m.numpy()[name], e) for name, e in expected.items())


def _mesh(device: Any) -> float:
    rng = np.random.default_rng(0)
    vertices, faces = rng.random((30, 3)).astype(np.float32), rng.permutation(30).reshape(10, 3)
    points = (rng.random((60, 3)) * 2 - 0.5).astype(np.float32)
    distance, face, closest = closest_on_mesh(points, vertices, faces, max_distance=10.0, device=device)
    off, nearest = mesh.closest_on_mesh(points.astype(np.float64), vertices.astype(np.float64), faces)
    return max(float(face.min() < 0), apart(distance, off), apart(closest, nearest))


def _sheets() -> dict[str, np.ndarray]:
    """Two crossing sheets and loose surfels, some without a class."""
    rng = np.random.default_rng(4)
    position = rng.uniform(-0.4, 0.4, (700, 3))
    position[:300, 2], position[300:600, 0] = 0.01 * rng.normal(size=300), 0.1
    normal = rng.normal(size=(700, 3))
    normal[:300] = [0, 0, 1] + 0.1 * normal[:300]
    normal[300:600] = [-1, 0, 0]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    values = {
        "position": position, "normal": normal, "colour": rng.uniform(0, 1, (700, 3)),
        "weight": rng.uniform(1, 50, 700), "radius": rng.uniform(0.01, 0.06, 700),
    }  # fmt: skip
    label = rng.integers(0, 3, 700).astype(np.uint8) * 5
    return {name: value.astype(np.float32) for name, value in values.items()} | {"label": label}


def _surface(device: Any) -> float:
    """Largest difference of distances [m]; more than a metre where more than a few corners are known to one alone."""
    arrays, side, spread, reach, first = _sheets(), 0.05, 0.05, 0.15, np.array([-4, -5, -4])
    found = surface_distance(surfel_points(arrays, reach, device), tuple(first), 9, side, spread).ravel()
    at = (np.stack(np.meshgrid(*[np.arange(9)] * 3, indexing="ij"), -1).reshape(-1, 3) + first) * side
    expected = surface.surface_distance(arrays, at, side, spread, reach)
    known = (found < UNKNOWN, expected < UNKNOWN)
    both = known[0] & known[1]
    return _share(known[0] != known[1]) * 100 + apart(found[both], expected[both])


def _paint(device: Any) -> float:
    arrays, at = _sheets(), np.random.default_rng(1).uniform(-0.4, 0.4, (200, 3)).astype(np.float32)
    normal, colour, label, _ = paint_points(surfel_points(arrays, 0.15, device), at, 0.05)
    expected = surface.paint_points(arrays, at, 0.05, 0.15)
    return max(apart(normal, expected[0]), apart(colour, expected[1]), _share(label != expected[2]))


def _crf(device: Any) -> float:
    rng, config = np.random.default_rng(0), CrfConfig()
    position, colour = rng.uniform(0, 0.4, (300, 3)), rng.random((300, 3))
    normal = rng.normal(0, 0.1, (300, 3)) + [0, 0, 1]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    mass, log_p = rng.integers(1, 9, 300), np.log(rng.dirichlet(np.full(13, 0.4), 300) + 1e-3)
    log_p -= np.log(np.exp(log_p).sum(axis=1, keepdims=True))
    neighbours = find_neighbours(gaussian_kernels(config), position, colour, normal, mass, device)
    found, _ = kernel_mean_field(neighbours, log_p, config.iterations)
    return apart(found, dense_crf.mean_field(position, colour, normal, mass, log_p, config))


def _segments(_: Any) -> float:
    """It runs on the CPU whatever the device: one edge after the other."""
    rng = np.random.default_rng(0)
    edges, cost = rng.integers(0, 60, (80, 2)), rng.random(80).astype(np.float32)
    options = {"scale": 0.4, "small": 3, "small_cost": 0.5}
    found = join_cells(edges, cost, np.ones(60), **options)
    return float(np.count_nonzero(found != segment_graph.join_cells(edges, cost, 60, **options)))


MAP_CHECKS: dict[str, Check] = {
    "bilateral filter, kernel": Check(_bilateral, 1e-5),
    "colour, intensity, half image": Check(_colour, 1e-6),
    "geometry channels": Check(_geometry, 2e-5),
    "free space": Check(_free_space, 0.0),
    "moving things": Check(_things, 0.0),
    "reactivation": Check(_reactivation, 0.0),
    "deformation": Check(_deformation, 1e-5),
    "distance to a mesh": Check(_mesh, 1e-5),
    "distance to the surface": Check(_surface, 2e-5),
    "painted points": Check(_paint, 1e-4),
    "CRF": Check(_crf, 1e-3),
    "segments": Check(_segments, 0.0),
}
"""By the name that a report gives them."""
