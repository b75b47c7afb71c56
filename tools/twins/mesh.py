"""Slow twin of kernels/mesh_distance.py: every point against every triangle."""

import numpy as np


def closest_on_mesh(
    points: np.ndarray, vertices: np.ndarray, faces: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Distance of every point to the mesh, shape (N,), and the nearest point of the mesh, shape (N, 3)."""
    nearest = np.array([[_on_triangle(p, *vertices[face]) for face in faces] for p in points])
    distance = np.linalg.norm(nearest - points[:, None], axis=2)
    best = distance.argmin(axis=1)
    rows = np.arange(len(points))
    return distance[rows, best], nearest[rows, best]


def _on_triangle(p: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Its point nearest to p: below p if that is inside, else on an edge."""
    normal = np.cross(b - a, c - a)
    below = p - (p - a) @ normal / (normal @ normal) * normal
    turns = [np.cross(v - u, below - u) @ normal for u, v in ((a, b), (b, c), (c, a))]
    if min(turns) >= 0:
        return below
    edges = [
        u + np.clip((p - u) @ (v - u) / ((v - u) @ (v - u)), 0, 1) * (v - u)
        for u, v in ((a, b), (b, c), (c, a))
    ]
    return min(edges, key=lambda q: np.linalg.norm(q - p))
