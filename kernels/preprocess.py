"""From a camera frame to the maps that tracking and fusion read: vertex, normal, intensity, radius, edges.

On the CPU the plain image filters are OpenCV's (a scalar Warp bilateral filter is 17 times slower); on CUDA
they are `filters`. Everything that is 3D is one Warp source for both.
"""

from collections.abc import Sequence

import cv2
import numpy as np
import warp as wp

from dsmap.kernels import filters
from dsmap.kernels.camera import Camera, ray
from dsmap.kernels.launch import Slice, launch_rows, together
from dsmap.kernels.runtime import stays_on_device
from dsmap.kernels.types import FrameMaps

SIGMA_SPACE = 4.5
"""Bilateral filter: spatial sigma [px]."""
SIGMA_RANGE = 0.03
"""Bilateral filter: range sigma [m]."""
_SQRT2 = wp.constant(1.4142135)
_MAX_SLANT = wp.constant(2.0)  # a slanted surfel's radius grows at most by this factor
_BLOCK_RANGE = wp.constant(
    0.05
)  # pyramid: pixels of a block further than this (per metre) behind the nearest are left out


@wp.func
def _bends(before: float, centre: float, after: float, gate: float) -> bool:
    # The second difference tells a step from a slanted plane, whose first difference may be as large.
    return before > 0.0 and after > 0.0 and wp.abs(before + after - 2.0 * centre) > gate


@wp.func
def _is_edge(depth: wp.array2d(dtype=float), y: int, x: int, z: float) -> bool:
    gate = 0.01 + 0.015 * z
    up, down = depth[y - 1, x], depth[y + 1, x]
    left, right = depth[y, x - 1], depth[y, x + 1]
    jump = 3.0 * gate  # where the other neighbour is missing, only a plain jump can tell
    return (
        _bends(left, z, right, gate)
        or _bends(up, z, down, gate)
        or (left > 0.0 and wp.abs(left - z) > jump)
        or (right > 0.0 and wp.abs(right - z) > jump)
        or (up > 0.0 and wp.abs(up - z) > jump)
        or (down > 0.0 and wp.abs(down - z) > jump)
    )


@wp.func
def _reach(z: float, focal: float) -> int:
    """Pixels to either side that a normal is taken over: about 1 cm x depth^2 in all, as depth noise grows."""
    return wp.clamp(int(2.5 * z * focal / 525.0 + 0.5), 1, 10)


@wp.func
def _difference(before: wp.vec3, centre: wp.vec3, after: wp.vec3) -> wp.vec3:
    # Central difference; one-sided on the smoother side next to a step or a hole; zero where neither side is there.
    if before[2] > 0.0 and after[2] > 0.0:
        if _bends(before[2], centre[2], after[2], 0.01 + 0.015 * centre[2]):
            if wp.abs(after[2] - centre[2]) < wp.abs(centre[2] - before[2]):
                return after - centre
            return centre - before
        return after - before
    if after[2] > 0.0:
        return after - centre
    if before[2] > 0.0:
        return centre - before
    return wp.vec3(0.0, 0.0, 0.0)


@wp.kernel
def _surface(
    s: Slice, camera: Camera, depth: wp.array2d(dtype=float),
    vertex: wp.array2d(dtype=wp.vec3), normal: wp.array2d(dtype=wp.vec3),
    radius: wp.array2d(dtype=float), edge: wp.array2d(dtype=wp.uint8),
):  # fmt: skip
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, camera.width, s.step):
        z = depth[y, x]
        v = z * ray(camera, float(x), float(y))
        n = wp.vec3(0.0, 0.0, 0.0)
        size = float(0.0)
        on_edge = int(0)
        if z > 0.0 and x > 0 and y > 0 and x < camera.width - 1 and y < camera.height - 1:
            k = _reach(z, camera.fx)
            west, east = wp.max(x - k, 0), wp.min(x + k, camera.width - 1)
            north, south = wp.max(y - k, 0), wp.min(y + k, camera.height - 1)
            dx = _difference(
                depth[y, west] * ray(camera, float(west), float(y)), v,
                depth[y, east] * ray(camera, float(east), float(y)),
            )  # fmt: skip
            dy = _difference(
                depth[north, x] * ray(camera, float(x), float(north)), v,
                depth[south, x] * ray(camera, float(x), float(south)),
            )  # fmt: skip
            n = wp.normalize(wp.cross(dy, dx))  # towards the camera: n_z < 0
            if _is_edge(depth, y, x, z):
                on_edge = 1
            slant = wp.min(1.0 / wp.max(-n[2], 0.1), _MAX_SLANT)
            size = _SQRT2 * z / camera.fx * slant
        vertex[y, x] = v
        normal[y, x] = n
        radius[y, x] = size
        edge[y, x] = wp.uint8(on_edge)


@wp.kernel
def _half_surface(
    s: Slice,
    vertex: wp.array2d(dtype=wp.vec3), normal: wp.array2d(dtype=wp.vec3), intensity: wp.array2d(dtype=float),
    vertex_out: wp.array2d(dtype=wp.vec3), normal_out: wp.array2d(dtype=wp.vec3),
    intensity_out: wp.array2d(dtype=float),
):  # fmt: skip
    row, lane = wp.tid()
    y = s.first + s.stride * row
    for x in range(lane, vertex_out.shape[1], s.step):
        nearest = float(1.0e6)
        for k in range(4):
            z = vertex[2 * y + k / 2, 2 * x + k % 2][2]
            if z > 0.0:
                nearest = wp.min(nearest, z)
        v = wp.vec3(0.0, 0.0, 0.0)
        n = wp.vec3(0.0, 0.0, 0.0)
        light = float(0.0)
        count = float(0.0)
        for k in range(4):
            p = vertex[2 * y + k / 2, 2 * x + k % 2]
            # Never average over a depth step: the mean would float between two surfaces.
            if p[2] > 0.0 and p[2] < nearest * (1.0 + _BLOCK_RANGE):
                v += p
                n += normal[2 * y + k / 2, 2 * x + k % 2]
                light += intensity[2 * y + k / 2, 2 * x + k % 2]
                count += 1.0
        if count > 0.0:
            v = v / count
            light = light / count
        vertex_out[y, x] = v
        normal_out[y, x] = wp.normalize(n)
        intensity_out[y, x] = light


def depth_in_range(depth: np.ndarray, depth_min: float, depth_max: float) -> np.ndarray:
    """Depth [m], shape (H, W), with everything outside the range, NaN and infinity set to 0."""
    with np.errstate(invalid="ignore"):
        inside = (depth >= depth_min) & (depth <= depth_max)
    return np.where(inside, depth, np.float32(0.0)).astype(np.float32, copy=False)


def smooth_depth(depth: np.ndarray, device: wp.Device) -> wp.array:
    """Bilateral filter of clean depth [m], shape (H, W), on the device."""
    if stays_on_device(device):
        raw = wp.array(depth, dtype=float, device=device)
        out = wp.empty_like(raw)
        filters.bilateral(raw, SIGMA_SPACE, SIGMA_RANGE, out)
        return out
    smooth = cv2.bilateralFilter(depth, 2 * filters.BILATERAL_RADIUS + 1, SIGMA_RANGE, SIGMA_SPACE)
    smooth[depth == 0] = 0
    return wp.array(smooth, dtype=float, device=device, copy=False)


def colour_map(rgb: np.ndarray, device: wp.Device) -> wp.array:
    """uint8 RGB, shape (H, W, 3), to vec3 in [0, 1], shape (H, W)."""
    if stays_on_device(device):
        out = wp.empty(rgb.shape[:2], dtype=wp.vec3, device=device)
        filters.colour(wp.array(rgb, dtype=wp.uint8, device=device), out)
        return out
    scaled = cv2.multiply(rgb, (1 / 255, 1 / 255, 1 / 255, 0), dtype=cv2.CV_32F)
    return wp.array(scaled, dtype=wp.vec3, device=device, copy=False)


def intensity_map(colour: wp.array) -> wp.array:
    """Intensity (Rec. 601) of a colour map in [0, 1], shapes (H, W)."""
    if stays_on_device(colour.device):
        out = wp.empty(colour.shape, dtype=float, device=colour.device)
        filters.intensity(colour, out)
        return out
    return wp.array(cv2.cvtColor(colour.numpy(), cv2.COLOR_RGB2GRAY), dtype=float, device="cpu", copy=False)


def half_image(image: wp.array) -> wp.array:
    """The next pyramid level of an intensity image: the mean of each 2x2 block."""
    height, width = image.shape[0] // 2, image.shape[1] // 2
    if stays_on_device(image.device):
        out = wp.empty((height, width), dtype=float, device=image.device)
        filters.half(image, out)
        return out
    block = image.numpy()[: 2 * height, : 2 * width]
    return wp.array(
        cv2.resize(block, (width, height), interpolation=cv2.INTER_AREA),
        dtype=float,
        device="cpu",
        copy=False,
    )


def half_surface(
    vertex: wp.array, normal: wp.array, intensity: wp.array
) -> tuple[wp.array, wp.array, wp.array]:
    """Vertex, normal and intensity maps of the next pyramid level: means that never cross a depth step.

    A block without any vertex is invalid in all three maps. Shapes (H, W) to (H // 2, W // 2).
    """
    shape = (vertex.shape[0] // 2, vertex.shape[1] // 2)
    out = [wp.empty(shape, dtype=dtype, device=vertex.device) for dtype in (wp.vec3, wp.vec3, float)]
    launch_rows(_half_surface, shape[0], shape[1], [vertex, normal, intensity], out, vertex.device)
    return out[0], out[1], out[2]


def surface_maps(smooth: wp.array, camera: Camera) -> tuple[wp.array, wp.array, wp.array, wp.array]:
    """Vertex [m], normal, radius [m] and edge map of filtered depth (see `smooth_depth`), all of shape (H, W)."""
    shape, device = smooth.shape, smooth.device
    vertex, normal = (wp.empty(shape, dtype=wp.vec3, device=device) for _ in range(2))
    radius = wp.empty(shape, dtype=float, device=device)
    edge = wp.empty(shape, dtype=wp.uint8, device=device)
    launch_rows(_surface, *shape, [camera, smooth], [vertex, normal, radius, edge], device)
    return vertex, normal, radius, edge


def preprocess(
    rgb: np.ndarray, depth: np.ndarray, cameras: Sequence[Camera], device: wp.Device
) -> list[FrameMaps]:
    """All maps of a frame, finest level first.

    Normals, radii and edges come from the filtered depth. Level 0 carries colour, radius and edge as well;
    intensities of every level are those of the whole image, also where there is no depth.

    Args:
        rgb: uint8, shape (H, W, 3).
        depth: clean depth [m] (see `depth_in_range`), float32, shape (H, W).
        cameras: one camera a level, each half the size of the one before.
    """

    def colours() -> tuple[wp.array, wp.array]:
        colour = colour_map(rgb, device)
        return colour, intensity_map(colour)

    smooth, (colour, light) = together(lambda: smooth_depth(depth, device), colours, device)
    vertex, normal, radius, edge = surface_maps(smooth, cameras[0])
    levels = [FrameMaps(smooth, vertex, normal, light, radius, colour, edge)]
    for _ in cameras[1:]:
        last = levels[-1]
        vertex, normal, _ = half_surface(last.vertex, last.normal, last.intensity)
        levels.append(FrameMaps(None, vertex, normal, half_image(last.intensity)))
    return levels
