"""Exponential maps of SE(3) and the Cholesky factor of six unknowns, in kernels and in double precision.

The same series and cases as `fusion/lie.py`, which is their twin.
"""

import warp as wp

vec6d = wp.types.vector(length=6, dtype=wp.float64)
mat66d = wp.types.matrix(shape=(6, 6), dtype=wp.float64)


@wp.func
def hat(w: wp.vec3d) -> wp.mat33d:
    """hat(w) v = w x v."""
    zero = wp.float64(0.0)
    return wp.mat33d(zero, -w[2], w[1], w[2], zero, -w[0], -w[1], w[0], zero)


@wp.func
def rotation_of(T: wp.mat44d) -> wp.mat33d:
    """The rotation of a rigid transform."""
    return wp.mat33d(T[0, 0], T[0, 1], T[0, 2], T[1, 0], T[1, 1], T[1, 2], T[2, 0], T[2, 1], T[2, 2])


@wp.func
def rigid_transform(R: wp.mat33d, t: wp.vec3d) -> wp.mat44d:
    """The rigid transform of a rotation and a translation."""
    zero, one = wp.float64(0.0), wp.float64(1.0)
    return wp.mat44d(
        R[0, 0], R[0, 1], R[0, 2], t[0], R[1, 0], R[1, 1], R[1, 2], t[1], R[2, 0], R[2, 1], R[2, 2], t[2],
        zero, zero, zero, one,
    )  # fmt: skip


@wp.func
def inverse(T: wp.mat44d) -> wp.mat44d:
    """Of a rigid transform."""
    R = wp.transpose(rotation_of(T))
    return rigid_transform(R, -(R * wp.vec3d(T[0, 3], T[1, 3], T[2, 3])))


@wp.func
def exp_se3(xi: vec6d) -> wp.mat44d:
    """exp(xi^) of a twist (translation, rotation)."""
    one = wp.float64(1.0)
    w = wp.vec3d(xi[3], xi[4], xi[5])
    angle = wp.length(w)
    W = hat(w)
    W2 = W * W
    R = wp.identity(n=3, dtype=wp.float64) + W + wp.float64(0.5) * W2
    V = wp.identity(n=3, dtype=wp.float64) + wp.float64(0.5) * W
    if angle >= wp.float64(1.0e-6):
        sine = wp.sin(angle)
        bend = (one - wp.cos(angle)) / (angle * angle)
        R = wp.identity(n=3, dtype=wp.float64) + sine / angle * W + bend * W2
        V = wp.identity(n=3, dtype=wp.float64) + bend * W + (angle - sine) / (angle * angle * angle) * W2
    return rigid_transform(R, V * wp.vec3d(xi[0], xi[1], xi[2]))


@wp.func
def nearly_half_turn(T: wp.mat44d) -> bool:
    """Whether `log_se3` would lose the axis in rounding."""
    return T[0, 0] + T[1, 1] + T[2, 2] - wp.float64(1.0) < wp.float64(-1.9)


@wp.func
def log_se3(T: wp.mat44d) -> vec6d:
    """The twist (translation, rotation) whose exponential is T; not near half turns."""
    one, two = wp.float64(1.0), wp.float64(2.0)
    axis = wp.vec3d(T[2, 1] - T[1, 2], T[0, 2] - T[2, 0], T[1, 0] - T[0, 1])
    twice_sine = wp.length(axis)
    factor = wp.float64(0.5)
    if twice_sine > wp.float64(1.0e-9):
        factor = wp.atan2(twice_sine, T[0, 0] + T[1, 1] + T[2, 2] - one) / twice_sine
    w = factor * axis
    angle = wp.length(w)
    W = hat(w)
    bend = one / wp.float64(12.0)
    if angle >= wp.float64(1.0e-4):
        bend = one / (angle * angle) - (one + wp.cos(angle)) / (two * angle * wp.sin(angle))
    V_inverse = wp.identity(n=3, dtype=wp.float64) - wp.float64(0.5) * W + bend * (W * W)
    t = V_inverse * wp.vec3d(T[0, 3], T[1, 3], T[2, 3])
    return vec6d(t[0], t[1], t[2], w[0], w[1], w[2])


@wp.func
def cholesky(A: mat66d) -> tuple[mat66d, bool]:
    """L with L L^T = A, lower, and whether A is positive definite; what is no number is not."""
    L = mat66d()
    definite = bool(True)
    for j in range(6):
        pivot = A[j, j]
        for k in range(j):
            pivot -= L[j, k] * L[j, k]
        if not (pivot > wp.float64(0.0)):
            definite = False
            pivot = wp.float64(1.0)
        L[j, j] = wp.sqrt(pivot)
        for i in range(j + 1, 6):
            rest = A[i, j]
            for k in range(j):
                rest -= L[i, k] * L[j, k]
            L[i, j] = rest / L[j, j]
    return L, definite


@wp.func
def solve(L: mat66d, b: vec6d) -> vec6d:
    """x with L L^T x = b."""
    x = vec6d()
    for i in range(6):
        rest = b[i]
        for k in range(i):
            rest -= L[i, k] * x[k]
        x[i] = rest / L[i, i]
    for step in range(6):
        i = 5 - step
        rest = x[i]
        for k in range(i + 1, 6):
            rest -= L[k, i] * x[k]
        x[i] = rest / L[i, i]
    return x
