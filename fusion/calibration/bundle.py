"""Bundle adjustment of one window of frames: poses, points, and the cameras' corrections that all windows share.

Two kinds of residuals: where a point is seen in the colour image against where it is projected to [px], and the inverse
depth of the depth image against that of the point [1/m]. Each is taken at its own time: rows one after the other,
depth by its own stamp (the calibration of a rolling shutter by bundle adjustment is Hedborg, Forssen, Felsberg,
Ringaby, Rolling Shutter Bundle Adjustment, CVPR 2012). Points and poses are eliminated (Schur complement), so that a
window gives the others a small system in the corrections alone.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.spatial.transform import Rotation

from dsmap.frame import Intrinsics
from dsmap.fusion.calibration.depth_planes import look_up
from dsmap.fusion.calibration.pose_spline import PoseSpline
from dsmap.fusion.calibration.rig import Cameras, Rig
from dsmap.lens import project_points

_NEAREST_M = 0.05
"""Points are kept so far before the camera."""
_DAMPING = 1e-7
"""Levenberg's share of the diagonal."""
_HUBER, _WRONG = 2.5, 15.0
"""Standard deviations from which residuals count as lengths, not squares, and from which hardly at all. Weights that
fall faster make the result depend on where the search began."""


@dataclass
class Tracks:
    """What is seen in a window of frames."""

    times: np.ndarray
    """Stamps of the colour images [s], shape (F,)."""
    depth_after_s: np.ndarray
    """How much later depth is by its stamps with the given offset [s], shape (F,)."""
    planes: np.ndarray
    """Of `depth_planes` for every frame, shape (F, H, W, 3)."""
    frame: np.ndarray
    """Of every observation, in the order of the frames, shape (N,)."""
    point: np.ndarray
    """Which point is seen, 0 to P - 1, shape (N,)."""
    pixel: np.ndarray
    """Where in the colour image (x, y), shape (N, 2)."""
    given_centres: np.ndarray | None = None
    """Of the frames' cameras by poses that came with the recording, at the depth stamps [m], shape (F, 3), NaN where
    there is none."""


@dataclass
class ResidualScale:
    """How large residuals are: robust standard deviations."""

    pixel: float
    inverse_depth: float


@dataclass
class Reduced:
    """A window's normal equations H step = g in the corrections alone, and the way back to its poses and points."""

    H: np.ndarray
    g: np.ndarray
    by_track: np.ndarray
    """What every track adds to g, shape (P, S): its residuals share the drift of its patch and are not independent."""
    _window: "Window"
    _poses: tuple[np.ndarray, np.ndarray]
    _points: tuple[np.ndarray, np.ndarray, np.ndarray]

    def apply(self, step: np.ndarray) -> None:
        """Move the window's poses and points along with a step of the corrections, shape (S,)."""
        free, per_correction = self._poses
        moved = free - per_correction @ step
        inverse, coupling, gradient = self._points
        all_moved = np.concatenate([moved, step])
        points = np.einsum("pij,pj->pi", inverse, gradient - (coupling.T @ all_moved).reshape(-1, 3))
        self._window.move(moved, points)


class Seen(NamedTuple):
    """Points at the time when they are read, one an observation."""

    points: np.ndarray
    """In the colour camera's frame then [m], shape (N, 3)."""
    rotations: np.ndarray
    """Of the colour camera in the world then, shape (N, 3, 3)."""
    which: np.ndarray
    shares: np.ndarray
    """Control poses that count then, and how much, shapes (N, 4)."""


class Window:
    """The poses and points of a window, and what is seen of them.

    Args:
        tracks: the observations.
        rotations, centres: T_world_camera of the frames to start from, shapes (F, 3, 3) and (F, 3); the first stays
            where it is.
        points: in the world [m], shape (P, 3).
    """

    def __init__(self, tracks: Tracks, rotations: np.ndarray, centres: np.ndarray, points: np.ndarray):
        self.tracks, self.points = tracks, points
        self._spline = PoseSpline(tracks.times)
        self.rotations, self.centres = self._spline.controls(rotations, centres)
        """Of the control poses in the world, shapes (F, 3, 3) and (F, 3)."""
        self._row = tracks.pixel[:, 1].copy()
        self._planes = np.zeros((len(tracks.frame), 3))
        self._known: dict[float | tuple[float, float], Seen] = {}
        self._where = tracks.pixel.copy()
        self.has_depth = np.zeros(len(tracks.frame), bool)
        """Whether a plane of depth lies where an observation's point is, (N,); of `read_depth`."""

    def pose_at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (N, 3, 3) and centres (N, 3) of the colour camera in the window's world at times (N,) [s]."""
        return self._spline.at(self.rotations, self.centres, *self._spline.shares(times))

    def move(self, poses: np.ndarray, points: np.ndarray) -> None:
        """Add a step of Gauss-Newton: (6 (F - 1),) of centre and rotation a frame, and (P, 3)."""
        step = np.concatenate([np.zeros((1, 6)), poses.reshape(-1, 6)])
        self.centres = self.centres + step[:, :3]
        self.rotations = self.rotations @ Rotation.from_rotvec(step[:, 3:]).as_matrix()
        self.points = self.points + points
        self._known.clear()

    def read_depth(self, cameras: Cameras) -> None:
        """Look up the depth images where the points are now; `residuals` takes the planes found for whole ones."""
        seen, pixel = np.empty((0, 3)), np.empty((0, 2))
        for _ in range(2):  # the row that sees a point depends on where it is seen
            seen = _in_depth_camera(self._when_measured(cameras).points, cameras)
            pixel = project_points(seen, cameras.depth)
            self._row = np.clip(pixel[:, 1], 0, cameras.depth.height - 1)
            self._known.clear()
        self._planes, found = look_up(self.tracks.planes, self.tracks.frame, pixel)
        self._where, self.has_depth = pixel, found & (seen[:, 2] > _NEAREST_M)

    def residuals(self, cameras: Cameras) -> tuple[np.ndarray, np.ndarray]:
        """Reprojection [px], (N, 2), and inverse depth [1/m], (N,); the latter counts where `has_depth`."""
        colour = self._when_coloured(cameras).points
        depth = _in_depth_camera(self._when_measured(cameras).points, cameras)
        return self._pixels_off(cameras.colour, colour), self._depth_off(cameras.depth, depth)

    def reduced(self, rig: Rig, vector: np.ndarray, scale: ResidualScale) -> Reduced:
        """The window's normal equations at some corrections (S,).

        Args:
            scale: what residuals are divided by.
        """
        cameras = rig.cameras(vector)
        off, depth_off = self.residuals(cameras)
        off, depth_off = off / scale.pixel, depth_off / scale.inverse_depth
        by_vector = np.stack([
            (np.column_stack([a / scale.pixel, b / scale.inverse_depth])
             - np.column_stack([off, depth_off])) / step
            for step, (a, b) in self._varied(rig, vector)
        ], axis=-1)  # fmt: skip
        weight = np.stack([_weight((off**2).sum(axis=1))] * 2 + [_weight(depth_off**2)], axis=1)
        weight[:, 2] *= self.has_depth
        root = np.sqrt(weight)
        by_point, by_pose, which = self._geometry(cameras)
        size = np.array([scale.pixel, scale.pixel, scale.inverse_depth])
        by_point, by_pose = by_point / size[:, None], by_pose / size[:, None, None]
        residual = root * np.column_stack([off, depth_off])
        by_point, by_vector = root[..., None] * by_point, root[..., None] * by_vector
        by_pose = root[..., None, None] * by_pose
        return self._eliminate(residual, by_point, by_pose, which, by_vector)

    def _varied(self, rig: Rig, vector: np.ndarray):
        """Residuals with each correction a little larger in turn."""
        for k, step in enumerate(rig.steps):
            changed = vector.copy()
            changed[k] += step
            yield step, self.residuals(rig.cameras(changed))

    def _eliminate(self, residual, by_point, by_pose, which, by_vector) -> Reduced:
        """Schur complements: first of the points, then of the poses."""
        t, frames, count = self.tracks, len(self.centres), len(self.points)
        observations, corrections = len(t.frame), by_vector.shape[-1]
        rows = np.arange(observations * 3).reshape(-1, 3)
        columns = which[..., None] * 6 + np.arange(6)  # of (N, 3, 4 poses, 6)
        camera = sparse.csr_matrix(
            (by_pose.ravel(), (np.broadcast_to(rows[:, :, None, None], by_pose.shape).ravel(),
                               np.broadcast_to(columns, by_pose.shape).ravel())),
            shape=(observations * 3, frames * 6),
        )[:, 6:]  # fmt: skip
        C = sparse.hstack([camera, sparse.csr_matrix(by_vector.reshape(-1, corrections))]).tocsr()
        X = sparse.csr_matrix(
            (by_point.ravel(), (np.broadcast_to(rows[..., None], by_point.shape).ravel(),
                                np.broadcast_to(t.point[:, None, None] * 3 + np.arange(3), by_point.shape).ravel())),
            shape=(observations * 3, count * 3),
        )  # fmt: skip
        r = residual.ravel()
        H, coupling = (C.T @ C).toarray(), (C.T @ X).toarray()
        g, gradient = -(C.T @ r), -(X.T @ r).reshape(-1, 3)
        blocks = np.zeros((count, 3, 3))
        np.add.at(blocks, t.point, np.einsum("nri,nrj->nij", by_point, by_point))
        trace = np.trace(blocks, axis1=1, axis2=2)
        blocks += (_DAMPING * trace + 1e-9)[:, None, None] * np.eye(3)
        inverse = np.linalg.inv(blocks)
        weighted = np.einsum("cpi,pij->cpj", coupling.reshape(len(H), count, 3), inverse).reshape(len(H), -1)
        H, g = H - weighted @ coupling.T, g - weighted @ gradient.ravel()
        n = camera.shape[1]
        poses = H[:n, :n] + _DAMPING * np.diag(np.diag(H[:n, :n])) + 1e-9 * np.eye(n)
        solved = np.linalg.solve(poses, np.column_stack([g[:n], H[:n, n:]]))
        free, per_correction = solved[:, 0], solved[:, 1:]
        # How residuals change with the corrections while poses and points follow.
        following = C @ np.concatenate([-per_correction, np.eye(corrections)])
        pull = np.einsum("pij,pjc->pic", inverse, (X.T @ following).reshape(count, 3, -1))
        following = following - X @ pull.reshape(count * 3, -1)
        by_track = np.zeros((count, corrections))
        np.add.at(by_track, np.repeat(t.point, 3), -following * r[:, None])
        return Reduced(
            H[n:, n:] - H[n:, :n] @ per_correction,
            g[n:] - H[n:, :n] @ free,
            by_track,
            self,
            (free, per_correction),
            (inverse, coupling, gradient),
        )

    def _when_coloured(self, cameras: Cameras) -> Seen:
        """Points when the colour camera reads them."""
        rows = self.tracks.pixel[:, 1] / (cameras.colour.height - 1) - 0.5
        return self._seen(cameras.readout_s, cameras.readout_s * rows)

    def _when_measured(self, cameras: Cameras) -> Seen:
        """Points when the depth camera reads them; still in the colour camera's frame."""
        rows = self._row / (cameras.depth.height - 1) - 0.5
        stamps = self.tracks.depth_after_s[self.tracks.frame]
        key = (cameras.readout_s, cameras.offset_s)
        return self._seen(key, stamps + cameras.offset_s + cameras.readout_s * rows)

    def _seen(self, key: float | tuple[float, float], seconds: np.ndarray) -> Seen:
        """Points in the colour camera's frame some seconds after their frames' times; kept until anything moves."""
        if key not in self._known:
            t = self.tracks
            which, shares = self._spline.shares(t.times[t.frame] + seconds)
            R, centre = self._spline.at(self.rotations, self.centres, which, shares)
            self._known[key] = Seen(
                np.einsum("nji,nj->ni", R, self.points[t.point] - centre), R, which, shares
            )
        return self._known[key]

    def _pixels_off(self, camera: Intrinsics, seen: np.ndarray) -> np.ndarray:
        return project_points(_ahead(seen), camera) - self.tracks.pixel

    def _depth_off(self, camera: Intrinsics, seen: np.ndarray) -> np.ndarray:
        seen = _ahead(seen)
        off = project_points(seen, camera) - self._where
        there = self._planes[:, 0] + (self._planes[:, 1:] * off).sum(axis=1)
        return there - 1 / seen[:, 2]

    def _geometry(self, cameras: Cameras) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives of the residuals, (N, 3): by the point, (N, 3, 3), by four poses, (N, 3, 4, 6); which poses.

        How a pose between frames depends on control poses is taken to the first order of the turns between these.
        """
        coloured, measured = self._when_coloured(cameras), self._when_measured(cameras)
        in_depth = _in_depth_camera(measured.points, cameras)
        of_colour = _slope(lambda p: self._pixels_off(cameras.colour, p), coloured.points)
        of_depth = _slope(lambda p: self._depth_off(cameras.depth, p)[:, None], in_depth)
        points, poses, which = [], [], []
        for slope, seen in ((of_colour, coloured), (of_depth @ cameras.R_color_depth.T, measured)):
            by_point = slope @ np.swapaxes(seen.rotations, 1, 2)
            one = np.concatenate([-by_point, slope @ _hats(seen.points)], axis=2)
            points.append(by_point)
            poses.append(seen.shares[:, None, :, None] * one[:, :, None, :])
            which.append(np.repeat(seen.which[:, None], slope.shape[1], axis=1))
        return np.concatenate(points, axis=1), np.concatenate(poses, axis=1), np.concatenate(which, axis=1)


def _in_depth_camera(seen: np.ndarray, cameras: Cameras) -> np.ndarray:
    """Points of the colour camera's frame in that of the depth camera."""
    return (seen - cameras.t_color_depth) @ cameras.R_color_depth


def _ahead(seen: np.ndarray) -> np.ndarray:
    """Points that came behind the camera during a search, before it."""
    out = seen.copy()
    out[:, 2] = np.maximum(out[:, 2], _NEAREST_M)
    return out


def _hats(v: np.ndarray) -> np.ndarray:
    """Skew-symmetric matrices, (N, 3, 3), of vectors (N, 3)."""
    x, y, z = v.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)


def _slope(function, at: np.ndarray) -> np.ndarray:
    """Derivative of a function (N, 3) -> (N, K) of each point alone, shape (N, K, 3)."""
    step = 1e-5
    start = function(at)
    return np.stack([(function(at + step * axis) - start) / step for axis in np.eye(3)], axis=-1)


def _weight(squared: np.ndarray) -> np.ndarray:
    """Huber's weight of squared residuals [standard deviations]; those far beyond count nothing."""
    huber = np.minimum(1.0, _HUBER / np.sqrt(np.maximum(squared, 1e-12)))
    return huber / (1 + squared / _WRONG**2) ** 2
