"""Pinhole camera in kernels: projection and back-projection with integer pixel centres."""

from typing import Any

import warp as wp

from dsmap.kernels.runtime import struct
from dsmap.kernels.types import SurfelArrays


@struct
class Camera:
    """Pinhole intrinsics [px] and image size; integer pixel centres (see dsmap.frame)."""

    fx: float
    fy: float
    cx: float
    cy: float
    inv_fx: float  # 1 / fx and 1 / fy: a division costs a CPU as much as five products
    inv_fy: float
    width: int
    height: int


def make_camera(intrinsics: Any) -> Camera:
    """The kernel struct of a `dsmap.frame.Intrinsics`."""
    i = intrinsics
    return _camera(i.fx, i.fy, i.cx, i.cy, i.width, i.height)


def _camera(fx: float, fy: float, cx: float, cy: float, width: int, height: int) -> Camera:
    camera = Camera()
    camera.fx, camera.fy, camera.inv_fx, camera.inv_fy = fx, fy, 1 / fx, 1 / fy
    camera.cx, camera.cy = cx, cy
    camera.width, camera.height = width, height
    return camera


def half_camera(camera: Camera) -> Camera:
    """The camera of the next pyramid level: every pixel is the mean of a 2x2 block."""
    cx, cy = (camera.cx + 0.5) / 2 - 0.5, (camera.cy + 0.5) / 2 - 0.5
    return _camera(camera.fx / 2, camera.fy / 2, cx, cy, camera.width // 2, camera.height // 2)


def to_transform(T: Any) -> wp.mat44:
    """A NumPy pose, shape (4, 4), as a kernel argument."""
    return wp.mat44(*[float(v) for v in T.reshape(16)])


@wp.func
def project(camera: Camera, p: wp.vec3) -> wp.vec2:
    """pi(K p): image coordinates [px] of a camera-frame point with p.z > 0."""
    inv_z = 1.0 / p[2]
    return wp.vec2(camera.fx * p[0] * inv_z + camera.cx, camera.fy * p[1] * inv_z + camera.cy)


@wp.func
def pixel_of(coordinate: float) -> int:
    """The pixel whose area contains an image coordinate."""
    return int(wp.floor(coordinate + 0.5))


@wp.func
def pixel_at(camera: Camera, p: wp.vec3) -> wp.vec2i:
    """(x, y) of the pixel that a camera-frame point projects to; (-1, -1) outside the image or behind it."""
    outside = wp.vec2i(-1, -1)
    if p[2] <= 0.0:
        return outside
    u = project(camera, p)
    # Before the conversion, which is undefined for values beyond the integers.
    if u[0] < -0.5 or u[1] < -0.5 or u[0] >= float(camera.width) or u[1] >= float(camera.height):
        return outside
    at = wp.vec2i(pixel_of(u[0]), pixel_of(u[1]))
    if at[0] >= camera.width or at[1] >= camera.height:
        return outside
    return at


@wp.func
def surfel_at(
    camera: Camera,
    T_camera_world: wp.mat44,
    i: int,
    t_min: int,
    m: SurfelArrays,
) -> tuple[wp.vec3, wp.vec2i]:
    """Camera-frame position and pixel of surfel i; pixel (-1, -1) if dead, last updated before t_min, or outside."""
    p = wp.vec3(0.0, 0.0, 0.0)
    at = wp.vec2i(-1, -1)
    if m.weight[i] > 0.0 and m.t_updated[i] >= t_min:
        p = transform(T_camera_world, m.position[i])
        at = pixel_at(camera, p)
    return p, at


@wp.func
def ray(camera: Camera, x: float, y: float) -> wp.vec3:
    """Viewing ray K^-1 (x, y, 1) with z = 1."""
    return wp.vec3((x - camera.cx) * camera.inv_fx, (y - camera.cy) * camera.inv_fy, 1.0)


@wp.func
def rotate(T: wp.mat44, v: wp.vec3) -> wp.vec3:
    """Rotation part of a rigid transform applied to a direction."""
    return wp.vec3(
        T[0, 0] * v[0] + T[0, 1] * v[1] + T[0, 2] * v[2],
        T[1, 0] * v[0] + T[1, 1] * v[1] + T[1, 2] * v[2],
        T[2, 0] * v[0] + T[2, 1] * v[1] + T[2, 2] * v[2],
    )


@wp.func
def transform(T: wp.mat44, p: wp.vec3) -> wp.vec3:
    """A rigid transform applied to a point."""
    return rotate(T, p) + wp.vec3(T[0, 3], T[1, 3], T[2, 3])
