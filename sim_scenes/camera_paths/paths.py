"""Camera paths through the free space of a scene: hand-held walks, round trips, trials, scattered single views."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from dsmap.errors import InputError
from dsmap.sim_scenes.camera_paths.hand import tremor
from dsmap.sim_scenes.camera_paths.routes import round_trip, wander
from dsmap.sim_scenes.camera_paths.trials import Sampler, carried_times, shaken, with_bursts
from dsmap.sim_scenes.physics.bodies import Motion
from dsmap.sim_scenes.scene import Scene
from dsmap.sim_scenes.space.free_space import FreeSpace

CLEARANCE = 0.42
"""A walk keeps this far from every surface [m]."""
KNOT_S = 1.6
"""Time between control points of a walk [s]."""
_STEP_M = (0.65, 1.2)
"""Distance between neighbouring control points [m]."""
TURN = np.radians((22.0, 80.0))
"""Change of heading between neighbouring control points [rad]."""
CRAMPED = 0.3
"""Where a freely drawn walk comes closer to things than this [m], a planned one takes its place."""
FAVOURED = ("chair", "objects", "picture", "tv")
"""Classes that photographs of rooms show more of than a room's own share: views are aimed at them more often."""
LEAN = np.radians(-2.0)
"""Views look down by this much more than at the middle of their subject, as people hold cameras."""
PATHS = ("walk", "views", "loop", "fast", "shake", "cover", "jump")
"""walk = hand-held video; views = unrelated viewpoints; loop = a round trip back to the first view; fast = a walk
with bursts of over 120 degrees a second; shake = a walk with fast turns about all axes, up to 250 degrees a second;
cover = a walk with the lens covered for a second (`covered_frames`); jump = a walk during which the camera is carried
to places seen before."""


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


def camera_path(
    scene: Scene, kind: str, frames: int, fps: float, seed: int, motion: Motion | None = None
) -> np.ndarray:
    """Poses T_world_camera of every frame, float64, shape (frames, 4, 4).

    Args:
        kind: one of `PATHS`.
        frames: how many; 0 = as many as the round trip takes (kind `loop` only). A round trip that is given
            more frames goes around again, with fewer it stays unfinished.
        motion: what moves in the scene: the camera keeps away from everywhere it comes, and walks watch it.

    Raises:
        InputError: unknown kind, no number of frames, or a scene without free space.
    """
    if kind not in PATHS:
        raise InputError(f"unknown camera path {kind!r}; expected one of: {', '.join(PATHS)}")
    if frames < 1 and kind != "loop":
        raise InputError(
            f"frames is {frames}; expected at least 1 (0 only for path loop: as many as it takes)"
        )
    space = FreeSpace(scene, motion.swept() if motion else None)
    rng = np.random.default_rng([seed, 77])
    if kind == "views":
        return views(scene, space, frames, rng)
    if kind == "loop":
        tour = round_trip(scene, space, rng, frames / fps)
        frames = frames or int(tour.duration() * fps)
        sampler: Sampler = tour.sampled
    else:
        sampler = walk(scene, space, frames / fps, rng, motion)
    t = np.arange(frames) / fps
    hands, trial = (np.random.default_rng([seed, k]) for k in (79, 80))
    state = sampler(carried_times(sampler, t, frames / fps, trial) if kind == "jump" else t)
    if kind == "fast":
        state = with_bursts(state, t, frames / fps, trial)
    shake = tremor(hands, t)
    state = state + shake[:, :5]
    roll = np.radians(0.8) * np.sin(0.9 * t + state[0, 3]) * np.minimum(1.0, t) + shake[:, 5]
    if kind == "shake":
        turns = shaken(t, frames / fps, trial)
        state[:, 3:5] += turns[:, :2]
        roll += turns[:, 2]
    return look(state[:, :3], state[:, 3], state[:, 4], roll)


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


def walk(
    scene: Scene, space: FreeSpace, seconds: float, rng: np.random.Generator, motion: Motion | None = None
) -> Sampler:
    """A hand-held walk at a calm pace that looks at one piece of furniture after another.

    Its first 10 s are drawn again (up to 40 times) until they cover 4.4 m and 200 degrees; what follows
    continues the tour, so a longer recording begins like a shorter one. Scenes of several rooms, and rooms too
    narrow for it, have a planned walk (`routes.wander`), and so have scenes in which something moves.
    """
    if motion is not None:
        return wander(scene, space, rng, seconds + 1, motion.centre).sampled
    if len(scene.rooms) > 1:
        return wander(scene, space, rng, seconds + 1).sampled
    best, best_score, best_room = None, -1.0, 0.0
    for attempt in range(40):
        trial = np.random.default_rng([int(rng.integers(2**31)), attempt])
        tour = _started(scene, space, trial)
        if tour is None:
            break
        while len(tour.eye) < 11:
            _extend(tour, scene, space, trial)
        smooth = tour.sampled(np.arange(300) / 30)
        length, turned = walked_length(smooth[:, :3]), rotation_sum(_level(smooth))
        room = float(space.clearance(smooth[:, :3]).min())
        score = min(length / 4.4, 1.0) + min(turned / 200, 1.0) + min(room / 0.4, 1.0)
        if score > best_score:
            best, best_score, best_room = (tour, trial), score, room
        if score >= 3.0:
            break
    if best is None or best_room < CRAMPED:
        return wander(scene, space, rng, seconds + 1).sampled
    tour, trial = best
    while (len(tour.eye) - 3) * KNOT_S < seconds + KNOT_S:
        _extend(tour, scene, space, trial)
    return tour.sampled


def _level(state: np.ndarray) -> np.ndarray:
    return look(state[:, :3], state[:, 3], state[:, 4], np.zeros(len(state)))


def _started(scene: Scene, space: FreeSpace, rng: np.random.Generator) -> _Walk | None:
    """At rest, looking at the room's main piece from 1.3 to 3 m; None where there is no place for that."""
    candidates = space.sample(rng, 60, (1.2, 1.55), CLEARANCE + 0.08)
    if len(candidates) == 0 or len(scene.targets) == 0:
        return None
    distance = np.linalg.norm(candidates[:, :2] - scene.targets[0][:2], axis=1)
    eye = candidates[np.argmin(np.abs(distance - rng.uniform(1.6, 2.6)))]
    yaw, pitch = _heading(eye, scene.targets[0])
    turn = float(rng.choice([-1.0, 1.0]))
    return _Walk([eye, eye, eye], [yaw, yaw, yaw], [pitch, pitch, pitch], turn)


def _heading(eye: np.ndarray, target: np.ndarray) -> tuple[float, float]:
    offset = target - eye
    pitch = np.arctan2(offset[2], np.hypot(offset[0], offset[1]))
    return float(np.arctan2(offset[1], offset[0])), float(np.clip(pitch, np.radians(-42), np.radians(22)))


def _extend(tour: _Walk, scene: Scene, space: FreeSpace, rng: np.random.Generator) -> None:
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


def _next_eye(tour: _Walk, space: FreeSpace, rng: np.random.Generator) -> np.ndarray:
    """The best of 40 steps: clear of surfaces along the spline, then onwards rather than back."""
    last = tour.eye[-1]
    angle = rng.uniform(-np.pi, np.pi, 40)
    reach = rng.uniform(*_STEP_M, 40)
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


def views(scene: Scene, space: FreeSpace, frames: int, rng: np.random.Generator) -> np.ndarray:
    """Unrelated viewpoints for training: varied heights, distances, pitch and roll; shape (frames, 4, 4)."""
    eyes = space.sample(rng, 6 * frames + 60, (0.8, 1.85), 0.35)
    if len(eyes) == 0:
        raise InputError(f"scene {scene.name} seed {scene.seed} leaves the camera no free space")
    eyes = eyes[np.arange(frames) % len(eyes)]
    subjects = _subjects(scene)
    targets = subjects[rng.integers(len(subjects), size=(frames, 6))]
    distance = np.linalg.norm(targets[..., :2] - eyes[:, None, :2], axis=-1)
    good = (distance > 0.9) & (distance < 3.4)
    at = targets[np.arange(frames), np.argmax(good, axis=1)] + rng.normal(0, 0.35, (frames, 3))
    heading = np.array([_heading(eye, point) for eye, point in zip(eyes, at, strict=True)])
    pitch = heading[:, 1] + rng.normal(LEAN, np.radians(6), frames)
    pitch = np.clip(pitch, np.radians(-55), np.radians(25))
    return look(eyes, heading[:, 0], pitch, rng.normal(0, np.radians(2.5), frames))


def _subjects(scene: Scene) -> np.ndarray:
    """What views are aimed at [m], shape (N, 3): what is worth looking at, and what pictures show more often."""
    pieces = [piece for piece in scene.pieces if piece.assembly.label in FAVOURED]
    middles = [
        piece.T_world_piece[:3, :3] @ piece.assembly.bounds().mean(0) + piece.T_world_piece[:3, 3]
        for piece in pieces
    ]
    return np.array([*scene.targets, *middles, *middles])


def walked_length(points: np.ndarray) -> float:
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
