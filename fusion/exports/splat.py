"""3D Gaussians (Kerbl et al., SIGGRAPH 2023) that begin at the surfels, as PLY in the layout of their program."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dsmap.files import atomic_path

_SH_C0 = 0.28209479177387814
"""The constant spherical harmonic, 1 / (2 sqrt(pi)): colour = 0.5 + _SH_C0 f_dc."""
_SH_REST = 45
"""Coefficients of degree 1 to 3 for three channels; 0 at the beginning."""
_FLAT = 0.1
"""Thickness of a Gaussian by its width: a surfel is a disc."""
_OPACITY = (0.1, 0.95)
"""Opacity of a surfel that was seen once, and of a stable one."""
PROPERTIES = [
    *("x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"),
    *(f"f_rest_{i}" for i in range(_SH_REST)),
    *("opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
]
"""Properties of a vertex, all float32, in this order."""


def write_splat(path: Path | str, surfels: dict[str, np.ndarray], stable_weight: float) -> int:
    """Write a Gaussian for each living surfel; returns their number.

    A Gaussian's standard deviation in the plane is half the surfel's radius, so that the disc is its 2-sigma ellipse.

    Args:
        surfels: arrays by the names of `SurfelMap`.
        stable_weight: confidence from which a surfel is opaque.
    """
    rows = np.flatnonzero(surfels["weight"] > 0)
    table = np.zeros((len(rows), len(PROPERTIES)), dtype="<f4")
    column = {name: i for i, name in enumerate(PROPERTIES)}
    normal = surfels["normal"][rows].astype(np.float64)
    table[:, 0:3], table[:, 3:6] = surfels["position"][rows], normal
    table[:, 6:9] = (surfels["colour"][rows].clip(0, 1) - 0.5) / _SH_C0
    sure = np.clip(surfels["weight"][rows] / stable_weight, 0, 1)
    opacity = _OPACITY[0] + (_OPACITY[1] - _OPACITY[0]) * sure
    table[:, column["opacity"]] = np.log(opacity / (1 - opacity))
    deviation = np.maximum(surfels["radius"][rows] / 2, 1e-5)
    for axis, factor in enumerate((1.0, 1.0, _FLAT)):
        table[:, column[f"scale_{axis}"]] = np.log(factor * deviation)
    table[:, column["rot_0"] :] = _turns(normal)
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    header += [*(f"property float {name}" for name in PROPERTIES), "end_header"]
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(("\n".join(header) + "\n").encode("ascii"))
        table.tofile(file)
    return len(rows)


def _turns(normal: np.ndarray) -> np.ndarray:
    """Quaternions w x y z that turn the z axis to unit normals, shape (N, 4)."""
    if not len(normal):
        return np.zeros((0, 4))
    first = np.where(np.abs(normal[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    x = np.cross(first, normal)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    axes = np.stack([x, np.cross(normal, x), normal], axis=2)
    return Rotation.from_matrix(axes).as_quat(scalar_first=True)
