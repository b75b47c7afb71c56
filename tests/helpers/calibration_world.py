"""A box room with points on its walls, seen by a colour and a depth camera whose calibration is known: no renderer."""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from dsmap.frame import Intrinsics
from dsmap.fusion.calibration.bundle import Tracks, Window
from dsmap.fusion.calibration.depth_planes import depth_planes
from dsmap.lens import project_points, undistort_points
from dsmap.sequences.calibration import Calibration

ROOM = np.array([2.2, 1.6, 1.9])
"""Half its sides [m]."""
FPS = 30.0


@dataclass
class World:
    """What is true of a synthetic recording."""

    truth: Calibration
    seed: int = 0
    frames: int = 40
    pixel_noise: float = 0.15
    """[px]"""
    depth_noise: float = 0.0015
    """Of inverse depth [1/m]."""
    turning: float = 1.0
    """Factor on how far the camera turns."""
    moving: float = 1.0
    """Factor on how far it moves."""
    window: int = 0
    points: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng([self.seed, self.window])
        phase = self.rng.uniform(0, 2 * np.pi, (2, 6))
        self._phase, self._rate = phase, self.rng.uniform(2.0, 5.0, (2, 6))
        points = self.rng.uniform(-1, 1, (600, 3)) * ROOM
        side = self.rng.integers(0, 3, len(points))
        rows = np.arange(len(points))
        points[rows, side] = np.sign(points[rows, side]) * ROOM[side]
        self.points = points

    def pose(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (N, 3, 3) and centres (N, 3) of the colour camera in the world."""
        wave = np.sin(times[:, None, None] * self._rate + self._phase)
        centre = self.moving * 0.18 * wave[:, 0, :3] + 0.08 * self.moving * wave[:, 0, 3:]
        turn = self.turning * (0.22 * wave[:, 1, :3] + 0.05 * wave[:, 1, 3:])
        return Rotation.from_rotvec(turn).as_matrix(), centre

    def colour_pixels(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Which points an image shows, and where."""
        camera, truth = self.truth.stored_colour, self.truth
        row = np.full(len(self.points), camera.height / 2)
        for _ in range(6):
            R, c = self.pose(time + truth.readout_s * (row / (camera.height - 1) - 0.5))
            seen = np.einsum("nji,nj->ni", R, self.points - c)
            ahead = seen[:, 2] > 0.3
            pixel = project_points(np.where(ahead[:, None], seen, (9.0, 9.0, 1.0)), camera)
            row = np.clip(pixel[:, 1], 0, camera.height - 1)
        narrow = (
            np.abs(seen[:, :2]).max(axis=1) < 1.2 * seen[:, 2]
        )  # the lens model folds far outside the image
        size = (camera.width - 1, camera.height - 1)
        shown = np.flatnonzero(ahead & narrow & (pixel >= 0).all(axis=1) & (pixel <= size).all(axis=1))
        return shown, pixel[shown]

    def depth(self, time: float) -> np.ndarray:
        """The depth image whose middle row is read at a time [m]."""
        camera, truth = self.truth.intrinsics, self.truth
        y, x = np.mgrid[: camera.height, : camera.width]
        plane = undistort_points(np.stack([x.ravel(), y.ravel()], -1), camera)
        rays = np.column_stack([plane, np.ones(len(plane))])
        T = np.eye(4) if truth.T_color_depth is None else truth.T_color_depth
        R, c = self.pose(time + truth.readout_s * (y.ravel() / (camera.height - 1) - 0.5))
        origin, direction = c + R @ T[:3, 3], np.einsum("nij,nj->ni", R, rays @ T[:3, :3].T)
        z = ((np.sign(direction) * ROOM - origin) / direction).min(axis=1)  # rays have z = 1: this is depth
        noisy = 1 / z + self.depth_noise * self.rng.standard_normal(len(z))
        return (1 / noisy).reshape(camera.height, camera.width)

    def tracks(self) -> tuple[Tracks, np.ndarray]:
        """What a window of frames shows, with depth stamps that are as stated by nobody (offset 0); the points' ids."""
        times = 0.7 * self.window + np.arange(self.frames) / FPS
        frame, point, pixel, planes = [], [], [], []
        for i, time in enumerate(times):
            ids, where = self.colour_pixels(time)
            frame.append(np.full(len(ids), i))
            point.append(ids)
            pixel.append(where + self.pixel_noise * self.rng.standard_normal(where.shape))
            planes.append(depth_planes(self.depth(time + self.truth.depth_time_offset_s)))
        ids, numbers = np.unique(np.concatenate(point), return_inverse=True)
        tracks = Tracks(
            times, np.zeros(len(times)), np.array(planes), np.concatenate(frame), numbers, np.concatenate(pixel)
        )  # fmt: skip
        return tracks, ids

    def start(self, off: float = 0.02) -> Window:
        """The window with poses and points that are off by about a centimetre and half a degree."""
        tracks, ids = self.tracks()
        R, c = self.pose(tracks.times)
        turn = off / 2 * self.rng.standard_normal((len(R), 3))
        turn[0] = 0
        return Window(
            tracks,
            R @ Rotation.from_rotvec(turn).as_matrix(),
            c + off / 2 * self.rng.standard_normal(c.shape) * (np.arange(len(c)) > 0)[:, None],
            self.points[ids] + off * self.rng.standard_normal((len(ids), 3)),
        )


def camera(focal: float = 131.0, k1: float = -0.04) -> Intrinsics:
    return Intrinsics(160, 120, focal, focal, 79.5, 59.5, (k1, 0.0, 0.0, 0.0, 0.0))
