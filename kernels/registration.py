"""Registration without the host: sums, the solve, the step and its end, all iterations of all levels, then one read.

On a CPU the host solves the six equations, which costs nothing there. On a GPU each of its looks at the sums would
wait for everything that was launched before. So the pose, and whether a level has converged, stay on the device: an
iteration that is not needed any more finds that out itself and does nothing. Where a frame leaves a direction open
(`fusion/tracking/observability.py`), or the equations have no solution, nothing is decided here: the host begins again.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from dsmap.kernels.camera import Camera
from dsmap.kernels.launch import Slice, launch_items, launch_rows
from dsmap.kernels.odometry import SUMS, NormalEquations, TrackingGates, add_row, joint_equations, lanes_of
from dsmap.kernels.pixel_min import scratch
from dsmap.kernels.runtime import struct
from dsmap.kernels.se3 import cholesky, exp_se3, inverse, log_se3, mat66d, nearly_half_turn, solve, vec6d
from dsmap.kernels.shutter import Shutter
from dsmap.kernels.types import Surface, SurfaceImages

_POSE = wp.constant(0)
"""The state, float64: T_target_source in rows,"""
_TOTAL = wp.constant(16)
"""the sums of ICP and of the photometric term as they were used last,"""
_UNDECIDED = wp.constant(16 + 2 * 64)
"""whether the host has to begin again,"""
_ENDED = wp.constant(16 + 2 * 64 + 1)
"""and, from here on, for each level whether it has converged."""
_RIDGE = wp.constant(wp.float64(1e-9))
"""As in `lie.solve`: this share of the trace is added to the diagonal."""


@struct
class StepRules:
    """What a Gauss-Newton step is made of."""

    w_rgb: wp.float64  # weight of the photometric term, at most
    rgb_balance: wp.float64  # see TrackConfig
    held: wp.float64  # information a residual from which a direction is held in any case
    seconds: wp.float64  # since the frame at T_last; 0: all rows are taken at once
    coloured: int  # whether colour takes part
    expects: int  # whether there is a pose that is expected


@struct
class StepArrays:
    """What else a step reads and writes."""

    state: wp.array(dtype=wp.float64)
    T_expected: wp.array(dtype=wp.mat44d)
    information: wp.array(dtype=mat66d)  # of what is expected, in units of the variance of a residual
    from_metres: wp.array(dtype=mat66d)  # twist of motions that are all in metres
    T_last: wp.array(dtype=wp.mat44d)  # pose of the last frame
    pose: wp.array(dtype=wp.mat44)  # out, as the next iteration takes it
    twist: wp.array(dtype=wp.vec3)  # out: velocity [m/s] and turning [rad/s] while rows are read


@wp.func
def _over(state: wp.array(dtype=wp.float64), level: int) -> bool:
    return state[_UNDECIDED] != wp.float64(0.0) or state[_ENDED + level] != wp.float64(0.0)


@wp.kernel
def _joint_at_state(
    s: Slice,
    camera: Camera,
    level: int,
    per_row: float,
    a: StepArrays,
    gates: TrackingGates,
    frame: SurfaceImages,
    model: SurfaceImages,
    icp: wp.array(dtype=float),
    rgb: wp.array(dtype=float),
):
    row, lane = wp.tid()
    if _over(a.state, level):
        return
    shutter = Shutter()
    shutter.velocity = a.twist[0]
    shutter.turning = a.twist[1]
    shutter.per_row = per_row
    shutter.middle = 0.5 * float(camera.height - 1)
    add_row(s, row, lane, camera, a.pose[0], shutter, gates, frame, model, icp, rgb)


@wp.kernel
def _total(
    s: Slice, level: int, rows: int, a: StepArrays, icp: wp.array(dtype=float), rgb: wp.array(dtype=float)
):
    # A sum a thread, in row order, as the host adds them.
    block = s.first + s.stride * wp.tid()
    for i in range(block * s.step, wp.min((block + 1) * s.step, s.count)):
        if not _over(a.state, level):
            total = wp.float64(0.0)
            for row in range(rows):
                if i < SUMS:
                    total += wp.float64(icp[row * SUMS + i])
                else:
                    total += wp.float64(rgb[row * SUMS + i - SUMS])
            a.state[_TOTAL + i] = total


@wp.func
def _pose(state: wp.array(dtype=wp.float64)) -> wp.mat44d:
    T = wp.mat44d()
    for i in range(4):
        for k in range(4):
            T[i, k] = state[_POSE + 4 * i + k]
    return T


@wp.func
def _finite(xi: vec6d) -> bool:
    fine = bool(True)
    for k in range(6):
        fine = fine and wp.isfinite(xi[k])
    return fine


@wp.func
def _move_to(T: wp.mat44d, rules: StepRules, a: StepArrays):
    """Make a pose the guess of the next step, and the camera's motion that it tells that of its rows."""
    pose = wp.mat44()
    for i in range(4):
        for k in range(4):
            a.state[_POSE + 4 * i + k] = T[i, k]
            pose[i, k] = wp.float32(T[i, k])
    a.pose[0] = pose
    if rules.seconds > wp.float64(0.0):
        between = inverse(a.T_last[0]) * T
        if nearly_half_turn(between):
            a.state[_UNDECIDED] = wp.float64(1.0)
        motion = log_se3(between) / rules.seconds
        a.twist[0] = wp.vec3(wp.float32(motion[0]), wp.float32(motion[1]), wp.float32(motion[2]))
        a.twist[1] = wp.vec3(wp.float32(motion[3]), wp.float32(motion[4]), wp.float32(motion[5]))


@wp.kernel
def _step(s: Slice, level: int, converged: wp.float64, rules: StepRules, a: StepArrays):
    thread = s.first + s.stride * wp.tid()
    if thread == 0:
        state = a.state
        if _over(state, level):
            return
        one = wp.float64(1.0)
        icp_count = state[_TOTAL + 56]
        rgb_count = wp.float64(0.0)
        icp_squares = state[_TOTAL + 54]
        rgb_squares = wp.float64(0.0)
        if rules.coloured != 0:
            rgb_count = state[_TOTAL + SUMS + 56]
            rgb_squares = state[_TOTAL + SUMS + 54]
        # Eq. 3: E = E_icp + w_rgb E_rgb; the weight is less where the depth is much better than the colour.
        ratio = (icp_squares / wp.max(icp_count, one)) / wp.max(
            rgb_squares / wp.max(rgb_count, one), wp.float64(1e-12)
        )
        w = wp.min(rules.w_rgb, rules.rgb_balance * ratio)
        A = mat66d()
        b = vec6d()
        for i in range(6):
            b[i] = state[_TOTAL + 8 * i + 6]
            if rules.coloured != 0:
                b[i] += w * state[_TOTAL + SUMS + 8 * i + 6]
            for k in range(6):
                A[i, k] = state[_TOTAL + 8 * i + k]
                if rules.coloured != 0:
                    A[i, k] += w * state[_TOTAL + SUMS + 8 * i + k]
        # The smallest eigenvalue is above the bound if what is left without it is positive definite.
        X = a.from_metres[0]
        bound = rules.held * icp_count * wp.identity(n=6, dtype=wp.float64)
        factor, held = cholesky(wp.transpose(X) * A * X - bound)
        T = _pose(state)
        undecided = icp_count <= wp.float64(0.0) or not held
        if rules.expects != 0:
            between = a.T_expected[0] * inverse(T)
            undecided = undecided or nearly_half_turn(between)
            variance = (icp_squares + w * rgb_squares) / wp.max(icp_count + rgb_count, one)
            Lambda = variance * a.information[0]
            A += Lambda
            b += Lambda * log_se3(between)
        ridge = _RIDGE * wp.trace(A) * wp.identity(n=6, dtype=wp.float64)
        L, definite = cholesky(A + ridge)
        xi = solve(L, b)
        if undecided or not definite or not _finite(xi):
            state[_UNDECIDED] = one
            return
        _move_to(exp_se3(xi) * T, rules, a)
        largest = wp.float64(0.0)
        for k in range(6):
            largest = wp.max(largest, wp.abs(xi[k]))
        if largest < converged:
            state[_ENDED + level] = one


@dataclass(frozen=True)
class Level:
    """One pyramid level of a registration."""

    camera: Camera
    gates: TrackingGates
    frame: Surface
    model: Surface
    """With its gradient."""
    iterations: int
    """At most."""
    converged: float
    """A step below this (metres and radians alike) ends the level."""


@dataclass(frozen=True)
class Prior:
    """A pose that is expected, and its information, shapes (4, 4) and (6, 6): see `motion_filter.Expected`."""

    T: np.ndarray
    information: np.ndarray


@dataclass(frozen=True)
class MovingRows:
    """How the poses tell the camera's motion while rows are read: see `rolling_shutter.RowMotion`."""

    readout_s: float
    T_last: np.ndarray
    seconds: float
    twist: np.ndarray
    """At the first guess, shape (6,)."""


def register_on_device(
    levels: Sequence[Level],
    T_target_source: np.ndarray,
    *,
    w_rgb: float,
    rgb_balance: float,
    held: float,
    from_metres: np.ndarray,
    coloured: bool,
    prior: Prior | None,
    rows: MovingRows | None,
) -> tuple[np.ndarray, NormalEquations, NormalEquations] | None:
    """All Gauss-Newton iterations of Eq. 3, coarse to fine; the host reads once, at the end.

    Args:
        levels: in the order in which they are used, coarsest first.
        T_target_source: first guess, shape (4, 4).
        w_rgb, rgb_balance: see TrackConfig.
        held: information a residual from which a direction is held in any case.
        from_metres: twist of motions that are all in metres, shape (6, 6).
        coloured: whether the photometric term takes part.

    Returns:
        T_target_source and the equations of ICP and of the photometric term as they were used last; None where the
        frame leaves a direction open or the equations have no solution: then the host has to look at every step.
    """
    device = levels[0].frame.vertex.device
    a, rules = _arrays(levels, T_target_source, from_metres, prior, rows, device), StepRules()
    rules.w_rgb, rules.rgb_balance, rules.held = w_rgb, rgb_balance, held
    rules.coloured, rules.expects = int(coloured), int(prior is not None)
    rules.seconds = rows.seconds if rows is not None else 0.0
    lanes = lanes_of(device)
    for number, level in enumerate(levels):
        camera: Any = level.camera  # Warp's int32 is an int here
        lines = (camera.height + level.gates.stride - 1) // level.gates.stride
        per_row = rows.readout_s / (camera.height - 1) if rows is not None else 0.0
        partial = [scratch(name, (lines * lanes * int(SUMS),), float, device) for name in ("icp", "rgb")]
        inputs = [camera, number, per_row, a, level.gates, level.frame.images, level.model.images]
        for _ in range(level.iterations):
            launch_rows(
                _joint_at_state, lines, camera.width // level.gates.stride, inputs, partial, device, lanes
            )
            launch_items(_total, 2 * int(SUMS), [number, lines * lanes, a, *partial], [], device)
            launch_items(_step, 1, [number, level.converged, rules, a], [], device)
    state = a.state.numpy()  # type: ignore[attr-defined]  # an array, within a struct
    if state[_UNDECIDED]:
        return None
    icp, rgb = (joint_equations(sums) for sums in state[_TOTAL:_UNDECIDED].reshape(2, SUMS))
    if not coloured:
        rgb = NormalEquations(np.zeros((6, 6)), np.zeros(6), 0.0, 0)
    return state[:16].reshape(4, 4).copy(), icp, rgb


def _arrays(
    levels: Sequence[Level],
    T: np.ndarray,
    from_metres: np.ndarray,
    prior: Prior | None,
    rows: MovingRows | None,
    device: Any,
) -> StepArrays:
    def one(value: np.ndarray, dtype: Any) -> wp.array:
        return wp.array(np.ascontiguousarray(value)[None], dtype=dtype, device=device)

    a, state = StepArrays(), np.zeros(int(_ENDED) + len(levels))
    state[:16] = T.reshape(16)
    twist = rows.twist if rows is not None else np.zeros(6)
    a.state = wp.array(state, dtype=wp.float64, device=device)
    a.T_expected = one(prior.T if prior is not None else np.eye(4), wp.mat44d)
    a.information = one(prior.information if prior is not None else np.eye(6), mat66d)
    a.from_metres = one(from_metres, mat66d)
    a.T_last = one(rows.T_last if rows is not None else np.eye(4), wp.mat44d)
    a.pose = one(T.astype(np.float32), wp.mat44)
    a.twist = wp.array(twist.reshape(2, 3).astype(np.float32), dtype=wp.vec3, device=device)
    return a
