"""Distance from points to a triangle mesh, by closest-point queries on Warp's bounding volume hierarchy."""

from typing import Any

import numpy as np
import warp as wp

from dsmap.kernels.launch import Slice, launch_items


@wp.kernel
def _closest(
    s: Slice,
    mesh: wp.uint64,
    max_distance: float,
    points: wp.array(dtype=wp.vec3),
    out_distance: wp.array(dtype=wp.float32),
    out_face: wp.array(dtype=wp.int32),
    out_closest: wp.array(dtype=wp.vec3),
):
    block = s.first + s.stride * wp.tid()
    for i in range(block * s.step, wp.min((block + 1) * s.step, s.count)):
        p = points[i]
        query = wp.mesh_query_point_no_sign(mesh, p, max_distance)
        if query.result:
            closest = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
            out_distance[i] = wp.length(p - closest)
            out_face[i] = query.face
            out_closest[i] = closest
        else:
            out_distance[i] = max_distance
            out_face[i] = -1
            out_closest[i] = p


def closest_on_mesh(
    points: np.ndarray, vertices: np.ndarray, faces: np.ndarray, *, max_distance: float, device: Any = "cpu"
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The point of a mesh that is nearest to each query point.

    Args:
        points: [m], shape (N, 3).
        vertices, faces: triangles, shapes (V, 3) [m] and (F, 3).
        max_distance: points further from the mesh than this count as this far, on face -1.

    Returns:
        distances [m] (N,), faces int32 (N,), closest points (N, 3).
    """
    mesh = wp.Mesh(
        points=wp.array(vertices, dtype=wp.vec3, device=device),
        indices=wp.array(np.ascontiguousarray(faces).reshape(-1), dtype=wp.int32, device=device),
    )
    count = len(points)
    queries = wp.array(np.ascontiguousarray(points, dtype=np.float32), dtype=wp.vec3, device=device)
    distance = wp.empty(count, dtype=wp.float32, device=device)
    face = wp.empty(count, dtype=wp.int32, device=device)
    closest = wp.empty(count, dtype=wp.vec3, device=device)
    launch_items(_closest, count, [mesh.id, max_distance, queries], [distance, face, closest], device)
    return distance.numpy(), face.numpy(), closest.numpy()
