"""Camera paths through the free space of a room: hand-held walks, and scattered single views."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.spatial import KDTree

from dsmap.errors import InputError
from dsmap.sim_scenes.scene import Scene
from dsmap.sim_scenes.textures import Rng

CLEARANCE = 0.42
"""A walk keeps this far from every surface [m]."""
KNOT_S = 1.6
"""Time between control points of a walk [s]."""
STEP_M = (0.65, 1.2)
"""Distance between neighbouring control points [m]."""
TURN = np.radians((22.0, 80.0))
"""Change of heading between neighbouring control points [rad]."""
PATHS = ("walk", "views")


class FreeSpace:
    """Distance from any point of a room to the nearest surface."""

    def __init__(self, scene: Scene) -> None:
        vertices, faces, _, _ = scene.surface()
        self._tree = KDTree(surface_samples(vertices, faces, 0.04, np.random.default_rng(scene.seed)))
        self.low = np.array([*(-scene.size[:2] / 2), 0.0]) + 0.1
        self.high = np.array([*(scene.size[:2] / 2), scene.size[2]]) - 0.1

    def clearance(self, points: np.ndarray) -> np.ndarray:
        """Distance to the nearest surface [m] of points (N, 3); 0 outside the room; good to about 2 cm."""
        inside = ((points > self.low) & (points < self.high)).all(1)
        return np.where(inside, self._tree.query(points)[0], 0.0)

    def sample(self, rng: Rng, count: int, heights: tuple[float, float], clearance: float) -> np.ndarray:
        """Up to `count` random points [m], shape (N, 3), at eye heights and clear of all surfaces."""
        low, high = self.low.copy(), self.high.copy()
        low[2], high[2] = heights
        points = rng.uniform(low, high, (8 * count, 3))
        return points[self.clearance(points) >= clearance][:count]


def surface_samples(vertices: np.ndarray, faces: np.ndarray, spacing: float, rng: Rng) -> np.ndarray:
    """Random points on triangles, about one per `spacing` squared [m], and every vertex; shape (N, 3)."""
    corner = vertices[faces]
    area = 0.5 * np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    owner = rng.choice(len(faces), int(area.sum() / spacing**2), p=area / area.sum())
    u, v = rng.random((2, len(owner), 1))
    flip = u + v > 1
    u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
    a, b, c = corner[owner].transpose(1, 0, 2)
    return np.concatenate([a + u * (b - a) + v * (c - a), vertices])


def look(eye: np.ndarray, yaw: np.ndarray, pitch: np.ndarray, roll: np.ndarray) -> np.ndarray:
    """Camera poses T_world_camera, shape (N, 4, 4): x right, y down, z along (yaw, pitch up), turned by roll."""
    forward = np.stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)], -1)
    right = np.stack([np.sin(yaw), -np.cos(yaw), np.zeros_like(yaw)], -1)
    down = np.cross(forward, right)
    c, s = np.cos(roll)[:, None], np.sin(roll)[:, None]
    pose = np.tile(np.eye(4), (len(eye), 1, 1))
    pose[:, :3, 0], pose[:, :3, 1] = c * right + s * down, c * down - s * right
    pose[:, :3, 2], pose[:, :3, 3] = forward, eye
    return pose


def camera_path(scene: Scene, kind: str, frames: int, fps: float, seed: int) -> np.ndarray:
    """Poses T_world_camera of every frame, float64, shape (frames, 4, 4).

    Raises:
        InputError: unknown kind, or a room without free space.
    """
    if kind not in PATHS:
        raise InputError(f"unknown camera path {kind!r}; expected one of: {', '.join(PATHS)}")
    space = FreeSpace(scene)
    rng = np.random.default_rng([seed, 77])
    return views(scene, space, frames, rng) if kind == "views" else walk(scene, space, frames, fps, rng)


@dataclass
class _Walk:
    """Control points of the spline: eye (3), yaw, pitch each."""

    eye: list[np.ndarray]
    yaw: list[float]
    pitch: list[float]
    turn: float = 1.0

    def sampled(self, t: np.ndarray) -> np.ndarray:
        """Eye, yaw and pitch at times [s] from the walk's start, shape (N, 5): a uniform cubic B-spline."""
        control = np.column_stack([np.array(self.eye), self.yaw, self.pitch])
        knots = np.arange(len(control) + 4) - 3.0
        return BSpline(knots, control, 3)(t / KNOT_S)


def walk(scene: Scene, space: FreeSpace, frames: int, fps: float, rng: Rng) -> np.ndarray:
    """A hand-held walk at a calm pace that looks at one piece of furniture after another.

    Its first 10 s are drawn again (up to 40 times) until they cover 4.4 m and 200 degrees; what follows
    continues the tour, so a longer recording begins like a shorter one.
    """
    best, best_score = None, -1.0
    for attempt in range(40):
        trial = np.random.default_rng([int(rng.integers(2**31)), attempt])
        tour = _started(scene, space, trial)
        while len(tour.eye) < 11:
            _extend(tour, scene, space, trial)
        t = np.arange(300) / 30
        smooth = tour.sampled(t)
        length, turned = path_length(smooth[:, :3]), rotation_sum(look(*_split(smooth)))
        score = (
            min(length / 4.4, 1.0)
            + min(turned / 200, 1.0)
            + min(space.clearance(smooth[:, :3]).min() / 0.4, 1.0)
        )
        if score > best_score:
            best, best_score = (tour, trial), score
        if score >= 3.0:
            break
    assert best is not None
    tour, trial = best
    while (len(tour.eye) - 3) * KNOT_S < frames / fps + KNOT_S:
        _extend(tour, scene, space, trial)
    t = np.arange(frames) / fps
    state = tour.sampled(t) + _tremor(np.random.default_rng([int(rng.integers(2**31))]), t)[:, :5]
    return look(*_split(state))


def _split(state: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    roll = np.radians(0.8) * np.sin(0.9 * np.arange(len(state)) / 30 + state[0, 3])
    return state[:, :3], state[:, 3], state[:, 4], roll


def _tremor(rng: Rng, t: np.ndarray) -> np.ndarray:
    """Sum of sines at 0.5-5 Hz, amplitude falling with frequency: metres and radians, shape (N, 5)."""
    frequency = rng.uniform(0.5, 5.0, (12, 5))
    phase = rng.uniform(0, 2 * np.pi, (12, 5))
    waves = (np.sin(2 * np.pi * frequency * t[:, None, None] + phase) / frequency).sum(1)
    return waves * np.array([0.0016, 0.0016, 0.0022, np.radians(0.13), np.radians(0.13)])


def _started(scene: Scene, space: FreeSpace, rng: Rng) -> _Walk:
    """At rest, looking at the room's main piece from 1.3 to 3 m."""
    candidates = space.sample(rng, 60, (1.2, 1.55), CLEARANCE + 0.08)
    if len(candidates) == 0:
        candidates = space.sample(rng, 60, (1.2, 1.7), 0.2)
    if len(candidates) == 0:
        raise InputError(f"scene {scene.name} seed {scene.seed} leaves the camera no free space")
    distance = np.linalg.norm(candidates[:, :2] - scene.targets[0][:2], axis=1)
    eye = candidates[np.argmin(np.abs(distance - rng.uniform(1.6, 2.6)))]
    yaw, pitch = _heading(eye, scene.targets[0])
    turn = float(rng.choice([-1.0, 1.0]))
    return _Walk([eye, eye, eye], [yaw, yaw, yaw], [pitch, pitch, pitch], turn)


def _heading(eye: np.ndarray, target: np.ndarray) -> tuple[float, float]:
    offset = target - eye
    pitch = np.arctan2(offset[2], np.hypot(offset[0], offset[1]))
    return float(np.arctan2(offset[1], offset[0])), float(np.clip(pitch, np.radians(-42), np.radians(22)))


def _extend(tour: _Walk, scene: Scene, space: FreeSpace, rng: Rng) -> None:
    """One more control point: a step through free space and the next thing to look at."""
    tour.eye.append(_next_eye(tour, space, rng))
    if rng.random() < 0.12:
        tour.turn = -tour.turn
    targets = np.array(scene.targets)
    offset = targets[:, :2] - tour.eye[-1][:2]
    distance = np.linalg.norm(offset, axis=1)
    step = (np.arctan2(offset[:, 1], offset[:, 0]) - tour.yaw[-1] + np.pi) % (2 * np.pi) - np.pi
    wanted = rng.uniform(*TURN)
    cost = np.abs(step * tour.turn - wanted) + np.where((distance > 0.9) & (distance < 3.6), 0.0, 0.6)
    k = int(np.argmin(cost))
    _, pitch = _heading(tour.eye[-1], targets[k] + [0, 0, rng.uniform(-0.3, 0.3)])
    tour.yaw.append(tour.yaw[-1] + tour.turn * float(np.clip(step[k] * tour.turn, *TURN)))
    if rng.random() < 0.12:
        pitch = np.radians(rng.uniform(12, 24))
    tour.pitch.append(float(np.clip(pitch, tour.pitch[-1] - 0.6, tour.pitch[-1] + 0.6)))


def _next_eye(tour: _Walk, space: FreeSpace, rng: Rng) -> np.ndarray:
    """The best of 40 steps: clear of surfaces along the spline, then onwards rather than back."""
    last = tour.eye[-1]
    angle = rng.uniform(-np.pi, np.pi, 40)
    reach = rng.uniform(*STEP_M, 40)
    ends = last + np.column_stack(
        [reach * np.cos(angle), reach * np.sin(angle), rng.uniform(-0.15, 0.15, 40)]
    )
    ends[:, 2] = np.clip(ends[:, 2], 1.2, 1.65)
    fraction = np.array([0.25, 0.5, 0.75, 1.0])
    between = last + fraction[:, None, None] * (ends - last)
    clear = space.clearance(between.reshape(-1, 3)).reshape(4, 40).min(0)
    before = last - tour.eye[-2]
    onwards = (ends - last) @ before / (np.linalg.norm(before) + 1e-9) / reach
    score = np.minimum(clear, CLEARANCE + 0.06) * 20 + 0.5 * onwards + 0.4 * reach + rng.uniform(0, 0.5, 40)
    return ends[int(np.argmax(score))]


def views(scene: Scene, space: FreeSpace, frames: int, rng: Rng) -> np.ndarray:
    """Unrelated viewpoints for training: varied heights, distances, pitch and roll; shape (frames, 4, 4)."""
    eyes = space.sample(rng, 6 * frames + 60, (0.8, 1.85), 0.35)
    if len(eyes) == 0:
        raise InputError(f"scene {scene.name} seed {scene.seed} leaves the camera no free space")
    eyes = eyes[np.arange(frames) % len(eyes)]
    targets = np.array(scene.targets)[rng.integers(len(scene.targets), size=(frames, 6))]
    distance = np.linalg.norm(targets[..., :2] - eyes[:, None, :2], axis=-1)
    good = (distance > 1.0) & (distance < 4.2)
    at = targets[np.arange(frames), np.argmax(good, axis=1)] + rng.normal(0, 0.35, (frames, 3))
    heading = np.array([_heading(eye, point) for eye, point in zip(eyes, at, strict=True)])
    pitch = np.clip(heading[:, 1] + rng.normal(0, np.radians(6), frames), np.radians(-55), np.radians(28))
    return look(eyes, heading[:, 0], pitch, rng.normal(0, np.radians(2.5), frames))


def path_length(points: np.ndarray) -> float:
    """Sum of the steps between points (N, 3) [m]."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def frame_rotations(poses: np.ndarray) -> np.ndarray:
    """Angle between neighbouring poses [deg], shape (N - 1,)."""
    relative = np.einsum("nji,njk->nik", poses[:-1, :3, :3], poses[1:, :3, :3])
    cosine = (np.trace(relative, axis1=1, axis2=2) - 1) / 2
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def rotation_sum(poses: np.ndarray) -> float:
    """Accumulated rotation along poses (N, 4, 4) [deg]."""
    return float(frame_rotations(poses).sum())
