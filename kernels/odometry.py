"""Residuals of frame-to-model tracking and their normal equations: point-to-plane and photometric.

One pass over the current frame's pixels serves both terms, because both project the same point into the
same model view. T_view_camera takes points of the current camera into the model view (T_prev_cur of the paper).
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import warp as wp

from dsmap.kernels.camera import Camera, pixel_of, project, ray, rotate, to_transform, transform
from dsmap.kernels.launch import Slice, launch_rows, record_rows
from dsmap.kernels.pixel_min import scratch
from dsmap.kernels.runtime import struct
from dsmap.kernels.shutter import Shutter, make_shutter, moved_by_rows
from dsmap.kernels.types import Surface, SurfaceImages

SUMS = wp.constant(64)
"""Sums a residual term: (J, r)^T (J, r, 0) in 7 rows of 8, number of residuals, of ICP the number of points with depth,
and a rest that is not used."""
SEEN = wp.constant(57)
"""Where the number of points with depth stands."""
CUDA_LANES = 32
_COST = 4
"""A point of `_joint` is about as much work as this many pixels of other kernels: worth a second thread early."""
_sums3 = wp.types.vector(length=11, dtype=wp.float32)


@struct
class TrackingGates:
    """What a residual must pass to count."""

    max_distance: float  # [m] between associated points
    min_cosine: float  # of the angle between associated normals
    min_gradient: float  # of the model's intensity [1 / px]
    max_intensity: float  # difference of intensities beyond which a pixel is an occlusion or a highlight
    huber_icp: float  # [m] residual from which the weight falls; 0: plain least squares
    huber_rgb: float  # likewise for intensity
    gain: float  # factor that brings the frame's intensities to the model's exposure
    noise_z: float  # depth noise grows with z^2: weight 1 / (1 + noise_z z^2)^2; 0: all alike
    stride: int  # every stride-th pixel of the frame in both directions


@wp.func_native(
    """
    float* sum = sums.data + at * 64;
    const float row[8] = {d[0], d[1], d[2], moment[0], moment[1], moment[2], r, 0.0f};
#if defined(__CUDA_ARCH__)
    for (int i = 0; i < 7; ++i)
        for (int k = 0; k < 8; ++k)
            sum[8 * i + k] += w * row[i] * row[k];
#else
    typedef float Row __attribute__((vector_size(32), aligned(4)));
    const Row all = *(const Row*)row;
    for (int i = 0; i < 7; ++i)
        ((Row*)sum)[i] += w * row[i] * all;
#endif
    sum[56] += 1.0f;
"""
)
def _add(sums: wp.array(dtype=float), at: int, d: wp.vec3, moment: wp.vec3, r: float, w: float):
    """Add a residual with the Jacobian (d, moment) to the sums that begin at SUMS * at.

    A row is a register of a CPU, which compilers do not see in Warp's vectors nor in a loop over single numbers.
    """


@wp.func
def _huber(r: float, k: float) -> float:
    if k > 0.0 and wp.abs(r) > k:
        return k / wp.abs(r)
    return 1.0


@wp.func
def _bilinear(image: wp.array2d(dtype=float), u: wp.vec2, x0: int, y0: int) -> float:
    a = u[0] - float(x0)
    b = u[1] - float(y0)
    top = (1.0 - a) * image[y0, x0] + a * image[y0, x0 + 1]
    bottom = (1.0 - a) * image[y0 + 1, x0] + a * image[y0 + 1, x0 + 1]
    return (1.0 - b) * top + b * bottom


@wp.func
def _bilinear2(image: wp.array2d(dtype=wp.vec2), u: wp.vec2, x0: int, y0: int) -> wp.vec2:
    a = u[0] - float(x0)
    b = u[1] - float(y0)
    top = (1.0 - a) * image[y0, x0] + a * image[y0, x0 + 1]
    bottom = (1.0 - a) * image[y0 + 1, x0] + a * image[y0 + 1, x0 + 1]
    return (1.0 - b) * top + b * bottom


@wp.func
def add_row(
    s: Slice,
    row: int,
    lane: int,
    camera: Camera,
    T: wp.mat44,
    shutter: Shutter,
    gates: TrackingGates,
    frame: SurfaceImages,
    model: SurfaceImages,
    icp: wp.array(dtype=float),
    rgb: wp.array(dtype=float),
):
    """The residuals of the points that a thread of `launch_rows` walks, summed into its own SUMS of both terms."""
    y = (s.first + s.stride * row) * gates.stride
    own = (s.first + s.stride * row) * s.step + lane  # this thread's sums: nobody else adds to them
    for k in range(SUMS):
        icp[own * SUMS + k] = 0.0
        rgb[own * SUMS + k] = 0.0
    seen = float(0.0)
    for x in range(lane * gates.stride, camera.width, s.step * gates.stride):
        v = frame.vertex[y, x]
        if v[2] <= 0.0:
            continue
        seen += 1.0
        p = transform(T, moved_by_rows(shutter, v, float(y) - shutter.middle))
        if p[2] <= 0.0:
            continue
        u = project(camera, p)
        px = pixel_of(u[0])
        py = pixel_of(u[1])
        if px < 0 or py < 0 or px >= camera.width or py >= camera.height:
            continue
        mv = model.vertex[py, px]
        gap = mv - p
        if mv[2] <= 0.0 or wp.dot(gap, gap) > gates.max_distance * gates.max_distance:
            continue
        noise = 1.0 / (1.0 + gates.noise_z * v[2] * v[2])
        mn = model.normal[py, px]
        if wp.dot(rotate(T, frame.normal[y, x]), mn) > gates.min_cosine:
            # Eq. 1: ((v^k - exp(xi^) T v_t^k) . n^k)^2, with d(exp(xi^) p) = t + omega x p
            r = wp.dot(gap, mn)
            _add(icp, own, mn, wp.cross(p, mn), r, noise * noise * _huber(r, gates.huber_icp))
        x0 = int(wp.floor(u[0]))
        y0 = int(wp.floor(u[1]))
        if x0 < 0 or y0 < 0 or x0 + 1 >= camera.width or y0 + 1 >= camera.height:
            continue
        g = _bilinear2(model.gradient, u, x0, y0)
        if wp.dot(g, g) < gates.min_gradient * gates.min_gradient:
            continue
        # Eq. 2, I(u, c_t) at the model's exposure: (I(u, c_t) - I(pi(K exp(xi^) T p(u, D_t)), c^a_{t-1}))^2
        r = gates.gain * frame.intensity[y, x] - _bilinear(model.intensity, u, x0, y0)
        if wp.abs(r) > gates.max_intensity:
            continue
        gx = g[0] * camera.fx / p[2]
        gy = g[1] * camera.fy / p[2]
        d = wp.vec3(gx, gy, -(gx * p[0] + gy * p[1]) / p[2])
        _add(rgb, own, d, wp.cross(p, d), r, _huber(r, gates.huber_rgb))
    icp[own * SUMS + SEEN] = seen


@wp.kernel
def _joint(
    s: Slice,
    camera: Camera,
    T: wp.mat44,
    shutter: Shutter,
    gates: TrackingGates,
    frame: SurfaceImages,
    model: SurfaceImages,
    icp: wp.array(dtype=float),
    rgb: wp.array(dtype=float),
):
    row, lane = wp.tid()
    add_row(s, row, lane, camera, T, shutter, gates, frame, model, icp, rgb)


@wp.kernel
def _rotation(
    s: Slice,
    camera: Camera,
    R: wp.mat44,
    intensity: wp.array2d(dtype=float),
    last_intensity: wp.array2d(dtype=float),
    last_gradient: wp.array2d(dtype=wp.vec2),
    partial: wp.array2d(dtype=_sums3),
):
    row, lane = wp.tid()
    y = s.first + s.stride * row
    sums = _sums3()
    for x in range(lane, camera.width, s.step):
        q = rotate(R, ray(camera, float(x), float(y)))
        if q[2] <= 0.1:
            continue
        u = project(camera, q)
        x0 = int(wp.floor(u[0]))
        y0 = int(wp.floor(u[1]))
        if x0 < 0 or y0 < 0 or x0 + 1 >= camera.width or y0 + 1 >= camera.height:
            continue
        r = intensity[y, x] - _bilinear(last_intensity, u, x0, y0)
        g = _bilinear2(last_gradient, u, x0, y0)
        gx = g[0] * camera.fx / q[2]
        gy = g[1] * camera.fy / q[2]
        J = wp.cross(q, wp.vec3(gx, gy, -(gx * q[0] + gy * q[1]) / q[2]))
        w = _huber(r, 0.1)
        k = int(0)
        for i in range(3):
            for j in range(i, 3):
                sums[k] += w * J[i] * J[j]
                k += 1
        for i in range(3):
            sums[6 + i] += w * J[i] * r
        sums[9] += w * r * r
        sums[10] += 1.0
    partial[s.first + s.stride * row, lane] = sums


@wp.kernel
def _gradient(
    s: Slice,
    masked: int,
    intensity: wp.array2d(dtype=float),
    vertex: wp.array2d(dtype=wp.vec3),
    gradient: wp.array2d(dtype=wp.vec2),
):
    row, lane = wp.tid()
    y = s.first + s.stride * row
    height, width = intensity.shape[0], intensity.shape[1]
    for x in range(lane, width, s.step):
        g = wp.vec2(0.0, 0.0)
        inside = x > 0 and y > 0 and x < width - 1 and y < height - 1
        if inside and masked != 0:
            # A hole has no colour: its border would be the strongest gradient of the image.
            for k in range(9):
                if vertex[y - 1 + k / 3, x - 1 + k % 3][2] <= 0.0:
                    inside = False
        if inside:
            ne, nw = intensity[y - 1, x + 1], intensity[y - 1, x - 1]
            se, sw = intensity[y + 1, x + 1], intensity[y + 1, x - 1]
            dx = ne - nw + 2.0 * (intensity[y, x + 1] - intensity[y, x - 1]) + se - sw
            dy = sw - nw + 2.0 * (intensity[y + 1, x] - intensity[y - 1, x]) + se - ne
            g = wp.vec2(dx, dy) / 8.0
        gradient[y, x] = g


@dataclass(frozen=True)
class NormalEquations:
    """Of a least squares problem in n numbers: A x = b is solved by its Gauss-Newton step."""

    A: np.ndarray
    """J^T J, shape (n, n)."""
    b: np.ndarray
    """J^T r, shape (n,)."""
    squares: float
    """Sum of the squared residuals."""
    count: int
    """Of the residuals."""
    seen: int = 0
    """Of the points that might have had one, since there is depth; of ICP alone."""

    def __add__(self, other: "NormalEquations") -> "NormalEquations":
        return NormalEquations(
            self.A + other.A, self.b + other.b, self.squares + other.squares, self.count + other.count
        )

    def __rmul__(self, weight: float) -> "NormalEquations":
        """The same with every residual's square weighted."""
        return NormalEquations(weight * self.A, weight * self.b, weight * self.squares, self.count)


def lanes_of(device: wp.Device) -> int:
    """Threads a row of a reduction."""
    return CUDA_LANES if device.is_cuda else 1


@functools.cache
def _symmetric(n: int) -> np.ndarray:
    """Where the entries of a symmetric matrix lie in its upper triangle, row by row: shape (n, n)."""
    at = np.zeros((n, n), dtype=np.intp)
    at[np.triu_indices(n)] = np.arange(n * (n + 1) // 2)
    return np.maximum(at, at.T)


def _unpack(sums: np.ndarray, n: int) -> NormalEquations:
    triangle = n * (n + 1) // 2
    A = sums[_symmetric(n)]
    return NormalEquations(
        A, sums[triangle : triangle + n], float(sums[triangle + n]), int(sums[triangle + n + 1])
    )


def joint_equations(sums: np.ndarray) -> NormalEquations:
    """Of a term's SUMS, shape (SUMS,)."""
    products = sums[:56].reshape(7, 8)
    count, seen = int(sums[56]), int(sums[SEEN])
    return NormalEquations(products[:6, :6], products[:6, 6], float(products[6, 6]), count, seen)


def gradient(intensity: wp.array, vertex: wp.array | None = None) -> wp.array:
    """Sobel gradient of an intensity image [1 / px] (the 3x3 sum divided by 8), vec2, shape (H, W).

    Zero on the border and, where a vertex map is given, next to its holes.
    """
    out = wp.empty(intensity.shape, dtype=wp.vec2, device=intensity.device)
    mask = vertex if vertex is not None else wp.empty((1, 1), dtype=wp.vec3, device=intensity.device)
    inputs = [int(vertex is not None), intensity, mask]
    launch_rows(_gradient, *intensity.shape, inputs, [out], intensity.device)
    return out


def joint_normal_equations(
    camera: Camera, gates: TrackingGates, frame: Surface, model: Surface, readout_s: float = 0.0
) -> Callable[..., tuple[NormalEquations, NormalEquations]]:
    """Normal equations of Eq. 1 and Eq. 2 between a frame and a model view, as a function of the pose.

    Args:
        frame: the current frame.
        model: as predicted from the active model, with its gradient.
        readout_s: time from the frame's first row to its last [s].

    Returns:
        A function of T_view_camera, shape (4, 4), and, optionally, of the camera's velocity in its own frame while the
        rows are read (translation [m/s], rotation [rad/s]), shape (6,). It gives the equations of ICP and of the
        photometric term. Their twist is (translation [m], rotation [rad]), applied on the left: exp(xi^) T.
    """
    device = frame.vertex.device
    rows = (camera.height + gates.stride - 1) // gates.stride
    lanes = lanes_of(device)
    partial = [scratch(name, (rows * lanes * SUMS,), float, device) for name in ("icp", "rgb")]
    inputs = [camera, wp.mat44(), make_shutter(camera, None, 0.0), gates, frame.images, model.images]
    launch = record_rows(_joint, rows, _COST * camera.width // gates.stride, inputs, partial, device, lanes)

    def at(
        T_view_camera: np.ndarray, twist: np.ndarray | None = None
    ) -> tuple[NormalEquations, NormalEquations]:
        launch.change(1, to_transform(T_view_camera))
        if twist is not None:
            launch.change(2, make_shutter(camera, twist, readout_s))
        launch()
        # Summed in row order, so that the result does not depend on the number of slices.
        icp, rgb = (p.numpy().reshape(-1, SUMS).sum(axis=0, dtype=np.float64) for p in partial)
        return joint_equations(icp), joint_equations(rgb)

    return at


def rotation_normal_equations(
    camera: Camera, intensity: wp.array, last_intensity: wp.array, last_gradient: wp.array
) -> Callable[[np.ndarray], NormalEquations]:
    """Normal equations of rotation-only alignment of two intensity images (SO(3) pre-alignment).

    Returns:
        A function of R_prev_cur, shape (3, 3), that gives the equations of its turn.
    """
    device = intensity.device
    lanes = lanes_of(device)
    partial = scratch("rotation", (camera.height, lanes), _sums3, device)
    inputs = [camera, wp.mat44(), intensity, last_intensity, last_gradient]
    launch = record_rows(_rotation, camera.height, camera.width, inputs, [partial], device, lanes)

    def at(R_prev_cur: np.ndarray) -> NormalEquations:
        T = np.eye(4)
        T[:3, :3] = R_prev_cur
        launch.change(1, to_transform(T))
        launch()
        return _unpack(partial.numpy().reshape(-1, 11).sum(axis=0, dtype=np.float64), 3)

    return at
