"""A small random scene for the surfel-map kernels: a frame of a bumpy wall, and surfels of every kind."""

from typing import Any

import numpy as np
import warp as wp

from dsmap.frame import Intrinsics
from dsmap.kernels.camera import make_camera
from dsmap.kernels.types import FrameMaps, SurfelMap

SCENE_INTRINSICS = Intrinsics(64, 48, 55.0, 56.0, 31.2, 23.9)
CAMERA = make_camera(SCENE_INTRINSICS)
TIME = 40
"""Frame number of the scene's frame."""


def pose(seed: int = 0) -> np.ndarray:
    """A random rigid transform, shape (4, 4)."""
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = q * np.sign(np.linalg.det(q)), rng.normal(size=3)
    return T


def frame_arrays(seed: int = 0) -> dict[str, np.ndarray]:
    """Maps of the frame by FrameMaps name, NumPy: a bumpy wall at 1.5 m, a box at 1 m, holes, an edge map."""
    rng = np.random.default_rng(seed)
    h, w = SCENE_INTRINSICS.height, SCENE_INTRINSICS.width
    y, x = np.mgrid[:h, :w]
    depth = 1.5 + 0.05 * np.sin(x / 9) + 0.002 * y
    depth[12:30, 20:41] = 1.0
    depth[rng.random((h, w)) < 0.05] = 0
    view = np.stack(
        [
            (x - SCENE_INTRINSICS.cx) / SCENE_INTRINSICS.fx,
            (y - SCENE_INTRINSICS.cy) / SCENE_INTRINSICS.fy,
            np.ones((h, w)),
        ],
        -1,
    )
    normal = rng.normal(0, 0.15, (h, w, 3)) - [0, 0, 1]
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    normal[rng.random((h, w)) < 0.05] = 0
    normal[depth == 0] = 0
    slant = np.maximum(np.abs(normal[..., 2]), 0.5)
    arrays = {
        "depth": depth,
        "vertex": view * depth[..., None],
        "normal": normal,
        "intensity": np.zeros((h, w)),
        "radius": np.sqrt(2) * depth / SCENE_INTRINSICS.fx / slant,
        "colour": rng.random((h, w, 3)),
        "edge": (rng.random((h, w)) < 0.05),
    }
    return {name: a.astype(np.uint8 if name == "edge" else np.float32) for name, a in arrays.items()}


def frame_maps(arrays: dict[str, np.ndarray], device: Any = "cpu") -> FrameMaps:
    """The frame in Warp."""
    dtypes = {"vertex": wp.vec3, "normal": wp.vec3, "colour": wp.vec3, "edge": wp.uint8}
    return FrameMaps(
        **{name: wp.array(a, dtype=dtypes.get(name, wp.float32), device=device) for name, a in arrays.items()}
    )


def surfel_map(
    T_world_camera: np.ndarray, count: int = 3000, seed: int = 0, capacity: int = 0, device: Any = "cpu"
) -> SurfelMap:
    """Surfels near the frame's surface and elsewhere; some dead, unstable, old, facing away, behind, huge."""
    rng = np.random.default_rng(seed + 100)
    near = frame_arrays(seed)["vertex"].reshape(-1, 3)
    p = near[rng.integers(len(near), size=count)] + rng.normal(0, 0.015, (count, 3))
    far = rng.random(count) < 0.15
    p[far] = rng.uniform([-2, -2, -1], [2, 2, 4], (far.sum(), 3))
    n = rng.normal(0, 0.2, (count, 3)) - [0, 0, 1]
    n[rng.random(count) < 0.1] *= -1
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    R, t = T_world_camera[:3, :3], T_world_camera[:3, 3]
    labelled = rng.random(count) < 0.7
    values = {
        "position": p @ R.T + t,
        "normal": n @ R.T,
        "colour": rng.random((count, 3)),
        "weight": np.where(rng.random(count) < 0.1, 0, rng.uniform(0.3, 20, count)),
        "radius": rng.uniform(0.005, 0.04, count) * np.where(rng.random(count) < 0.05, 6, 1),
        "t_created": rng.integers(0, 5, count),
        "t_updated": rng.integers(5, TIME, count),
        "label": labelled * rng.integers(1, 14, count),
        "observations": labelled * rng.integers(1, 9, count),
        "evidence": labelled[:, None] * -rng.random((count, 13)),
        "segment": labelled * np.arange(count),
    }
    surfels = SurfelMap.empty(device, capacity=capacity or count)
    surfels.count = count
    for name, value in surfels.numpy().items():
        value[:] = values[name]
        wp.copy(getattr(surfels, name), wp.array(value, dtype=getattr(surfels, name).dtype, device="cpu"))
    return surfels


def softmax_image(seed: int, h: int, w: int) -> np.ndarray:
    """Random probabilities, shape (h, w, 14), some pixels void, zero or NaN."""
    rng = np.random.default_rng(seed)
    p = rng.dirichlet(np.full(14, 0.3), (h, w)).astype(np.float32)
    p[rng.random((h, w)) < 0.05] = np.eye(14, dtype=np.float32)[0]
    p[rng.random((h, w)) < 0.05] = 0
    p[rng.random((h, w)) < 0.02] = np.nan
    return p
