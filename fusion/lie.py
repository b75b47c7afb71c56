"""Exponential maps of SO(3) and SE(3), and the small linear algebra of poses, in NumPy float64."""

import math

import numpy as np
from scipy.spatial.transform import Rotation


def hat(w: np.ndarray) -> np.ndarray:
    """The skew-symmetric matrix of a vector, shape (3, 3): hat(w) @ v = w x v."""
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]], dtype=np.float64)


def exp_so3(w: np.ndarray) -> np.ndarray:
    """Rotation matrix of a rotation vector [rad] (Rodrigues)."""
    angle = float(np.linalg.norm(w))
    W = hat(w)
    if angle < 1e-6:
        return np.eye(3) + W + 0.5 * W @ W
    return np.eye(3) + np.sin(angle) / angle * W + (1 - np.cos(angle)) / angle**2 * W @ W


def log_so3(R: np.ndarray) -> np.ndarray:
    """The rotation vector [rad] whose exponential is R, shape (3,); R may be off a rotation by rounding."""
    x, y, z = float(R[2, 1] - R[1, 2]), float(R[0, 2] - R[2, 0]), float(R[1, 0] - R[0, 1])
    twice_sine, twice_cosine = math.sqrt(x * x + y * y + z * z), float(R[0, 0] + R[1, 1] + R[2, 2]) - 1
    if twice_cosine < -1.9:  # near a half turn the axis is lost in rounding; SciPy takes the time to find it
        return Rotation.from_matrix(R).as_rotvec()
    factor = math.atan2(twice_sine, twice_cosine) / twice_sine if twice_sine > 1e-9 else 0.5
    return np.array([factor * x, factor * y, factor * z])


def exp_se3(xi: np.ndarray) -> np.ndarray:
    """exp(xi^) of a twist (translation, rotation): a rigid transform, shape (4, 4)."""
    t, w = xi[:3], xi[3:]
    angle = float(np.linalg.norm(w))
    W = hat(w)
    if angle < 1e-6:
        V = np.eye(3) + 0.5 * W
    else:
        V = np.eye(3) + (1 - np.cos(angle)) / angle**2 * W + (angle - np.sin(angle)) / angle**3 * W @ W
    T = np.eye(4)
    T[:3, :3] = exp_so3(w)
    T[:3, 3] = V @ t
    return T


def log_se3(T: np.ndarray) -> np.ndarray:
    """The twist (translation, rotation) whose exponential is T, shape (6,); rotations below pi."""
    w = log_so3(T[:3, :3])
    angle = float(np.sqrt(w @ w))
    W = hat(w)
    bend = 1 / 12 if angle < 1e-4 else 1 / angle**2 - (1 + np.cos(angle)) / (2 * angle * np.sin(angle))
    return np.concatenate([(np.eye(3) - 0.5 * W + bend * W @ W) @ T[:3, 3], w])


def adjoint(T: np.ndarray) -> np.ndarray:
    """Ad(T), shape (6, 6): T exp(xi^) = exp((Ad(T) xi)^) T for twists (translation, rotation)."""
    out = np.zeros((6, 6))
    out[:3, :3] = out[3:, 3:] = T[:3, :3]
    out[:3, 3:] = hat(T[:3, 3]) @ T[:3, :3]
    return out


def inverse(T: np.ndarray) -> np.ndarray:
    """Inverse of a rigid transform, shape (4, 4)."""
    out = np.eye(4)
    out[:3, :3] = T[:3, :3].T
    out[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return out


def velocity(T_before: np.ndarray, T_after: np.ndarray, seconds: float) -> np.ndarray:
    """Of a camera that went from pose to pose, in its own frame (translation [m/s], rotation [rad/s]), shape (6,)."""
    return log_se3(inverse(T_before) @ T_after) / seconds


def rotation_angle(T: np.ndarray) -> float:
    """Rotation angle of a transform [rad]."""
    return float(np.arccos(np.clip((np.trace(T[:3, :3]) - 1) / 2, -1, 1)))


def pose_difference(T_a: np.ndarray, T_b: np.ndarray) -> tuple[float, float]:
    """How far two poses are apart: distance [m] and angle [deg]."""
    between = inverse(T_a) @ T_b
    return float(np.linalg.norm(between[:3, 3])), float(np.rad2deg(rotation_angle(between)))


def solve(A: np.ndarray, b: np.ndarray) -> np.ndarray | None:
    """Solution of the normal equations A x = b of a few unknowns, or None where they have none."""
    try:
        x = np.linalg.solve(_regular(A), b)
    except np.linalg.LinAlgError:
        return None
    return x if np.isfinite(x).all() else None


def uncertainty(A: np.ndarray, variance: float = 1.0) -> np.ndarray:
    """variance A^-1 of a normal matrix; very large, not zero as with a pseudo-inverse, where A says nothing."""
    if not np.isfinite(A).all() or not A.any():
        return np.full(A.shape, np.inf)
    return variance * np.linalg.inv(_regular(A))


def _regular(A: np.ndarray) -> np.ndarray:
    return A + 1e-9 * np.trace(A) * np.eye(len(A))
