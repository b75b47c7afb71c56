"""Planned walks of a person with a camera: from viewpoint to viewpoint by comfortable ways, through doors, looking
at things on the way. All of it is simulated forward in time, so a longer walk begins like a shorter one.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline

from dsmap.sim_scenes.camera_paths.hand import step_height
from dsmap.sim_scenes.scene import Scene
from dsmap.sim_scenes.space.free_space import FreeSpace

DT = 0.02
"""Step of the simulation [s]."""
CRUISE = (0.42, 0.58)
"""Walking speed, drawn for each leg [m/s]."""
ACCELERATION = 0.45
"""[m/s^2]"""
TURN_RATE = np.radians(42.0)
"""Fastest turn of the head [rad/s]; it gets there at `TURN_ACCELERATION` [rad/s^2]."""
TURN_ACCELERATION = np.radians(110.0)
CADENCE_HZ = 1.4
"""Steps a second at a slow walk."""
CARRIED = 0.4
"""Share of the body's bounce that the hands pass on to the camera."""
GLANCE_S = (1.8, 3.6)
"""How long one thing is looked at [s]."""
SEEN_M = (1.1, 4.5)
"""Distance of things worth looking at [m]."""
VIEWPOINT_CLEARANCE = 0.42
"""Room that a place to stop has on all sides [m], where there is such a place."""


@dataclass
class _Now:
    """What the walker does at the end of the tour so far."""

    xy: np.ndarray
    height: float
    yaw: float
    pitch: float
    speed: float = 0.0
    yaw_rate: float = 0.0
    pitch_rate: float = 0.0
    stride: float = 0.0
    """Phase of the step [rad]."""
    gaze: np.ndarray | None = None
    """Point looked at (3,), or None: along the way."""
    gaze_until: float = 0.0
    follows: bool = False
    """Whether it looks at the tour's `attention`."""
    time: float = 0.0


@dataclass
class Tour:
    """A walk through the free space of a scene, sampled every `DT` seconds."""

    scene: Scene
    space: FreeSpace
    rng: np.random.Generator
    attention: Callable[[float], np.ndarray] | None = None
    """Something that moves and is looked at more than anything else: where it is (3,) at a time [s]."""
    states: list[tuple[float, ...]] = field(default_factory=list)
    """x, y, z, yaw, pitch of each step."""

    def begin(self, xy: np.ndarray, target: np.ndarray | None) -> None:
        """Stand at a floor point (2,), looking at a point (3,)."""
        height = float(self.rng.uniform(1.38, 1.55))
        self.now = _Now(np.array(xy, float), height, 0.0, np.radians(-12.0))
        self.now.yaw, self.now.pitch = self._widest() if target is None else self._towards(target)
        self.now.gaze = target

    def duration(self) -> float:
        """Seconds so far."""
        return len(self.states) * DT

    def sampled(self, t: np.ndarray) -> np.ndarray:
        """Eye (3), yaw and pitch at times [s], shape (N, 5)."""
        return np.column_stack(
            [np.interp(t, np.arange(len(self.states)) * DT, column) for column in np.array(self.states).T]
        )

    def stand(self, seconds: float, heading: tuple[float, float] | None = None) -> None:
        """Stay and look around, or turn to a heading (yaw, pitch)."""
        for _ in range(round(seconds / DT)):
            self._step(0.0, np.zeros(2), heading)

    def turn_to(self, heading: tuple[float, float]) -> None:
        """Stay until the camera looks along (yaw, pitch) and rests."""
        for _ in range(2000):
            self._step(0.0, np.zeros(2), heading)
            off = np.hypot(_wrapped(heading[0] - self.now.yaw), heading[1] - self.now.pitch)
            if off < np.radians(0.2) and abs(self.now.yaw_rate) < np.radians(0.5):
                return

    def level_to(self, height: float) -> None:
        """Stay until the camera is at a height [m]."""
        for _ in range(500):
            off = height - self.now.height
            if abs(off) < 0.002:
                return
            self.now.height += float(np.clip(1.2 * off, -0.15, 0.15)) * DT
            self._step(0.0, np.zeros(2), (self.now.yaw, self.now.pitch))

    def walk_to(self, goal: int, arrive: tuple[float, float] | None = None) -> float:
        """Walk to a walkable column and stop there; returns the length [m].

        `arrive`: the heading (yaw, pitch) to have at the end; it is taken up over the last metre.
        """
        ways = self.space.ways
        route = ways.way(ways.nearest(self.now.xy), goal)
        route = np.concatenate([self.now.xy[None], route[1:]]) if len(route) > 1 else route
        path = smoothed(self.space, route)
        steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(steps)])
        if along[-1] < 0.05:
            return 0.0
        curve = CubicSpline(along, path)
        cruise, height = self.rng.uniform(*CRUISE), self.rng.uniform(1.36, 1.56)
        room = ways.clearance_at(path)
        s = 0.0
        while along[-1] - s > 0.004:
            remaining = along[-1] - s
            ahead = curve(min(s + 0.5, along[-1])) - curve(s)
            wanted = min(cruise, np.sqrt(2 * ACCELERATION * remaining) + 0.01)
            if np.interp(s, along, room) < 0.4:
                wanted = min(wanted, 0.8 * cruise)
            heading = arrive if arrive is not None and remaining < 1.0 else None
            narrow = bool(np.interp(min(s + 0.35, along[-1]), along, room) < 0.38)
            self._step(wanted, ahead, heading, narrow)
            s = min(s + self.now.speed * DT, along[-1])
            self.now.xy = curve(s)
            self.now.height += 0.4 * DT * (height - self.now.height)
        self.now.speed = 0.0
        return float(along[-1])

    def _step(
        self, speed: float, ahead: np.ndarray, heading: tuple[float, float] | None, narrow: bool = False
    ) -> None:
        """One step in time: speed and head follow what is wanted, and the camera's state is written down."""
        now = self.now
        now.speed += float(np.clip(speed - now.speed, -2 * ACCELERATION * DT, ACCELERATION * DT))
        yaw, pitch = heading if heading is not None else self._wanted_gaze(ahead, narrow)
        now.yaw_rate = _follow(now.yaw_rate, float(_wrapped(yaw - now.yaw)), TURN_RATE)
        now.pitch_rate = _follow(now.pitch_rate, pitch - now.pitch, 0.5 * TURN_RATE)
        now.yaw += now.yaw_rate * DT
        now.pitch += now.pitch_rate * DT
        now.stride += 2 * np.pi * CADENCE_HZ * DT * min(1.0, now.speed / CRUISE[0])
        bounce = CARRIED * float(step_height(np.array(now.speed), CADENCE_HZ)) / 2 * np.sin(now.stride)
        now.time += DT
        self.states.append((*now.xy, now.height + bounce, now.yaw, now.pitch))

    def _wanted_gaze(self, ahead: np.ndarray, narrow: bool) -> tuple[float, float]:
        """Heading towards what is being looked at; chooses something new when its time is over."""
        now, walking = self.now, bool(np.linalg.norm(ahead) > 0.05)
        if now.follows and self.attention is not None:
            now.gaze = self.attention(now.time)
        if narrow and walking and not now.follows:
            now.gaze, now.gaze_until = None, now.time + 0.5
        elif now.time >= now.gaze_until or (
            now.gaze is not None and not now.follows and not self._worth(now.gaze[None])[0]
        ):
            now.follows = self._drawn()
            now.gaze = self.attention(now.time) if now.follows and self.attention else None
            now.gaze = self._next_gaze(ahead if walking else None) if now.gaze is None else now.gaze
            now.gaze_until = now.time + float(self.rng.uniform(*GLANCE_S))
            if now.gaze is None and not walking:
                yaw, pitch = self._widest()
                now.gaze = self._eye() + 2.0 * _direction(np.array([yaw]), np.array([pitch]))[0]
        if now.gaze is not None:
            return self._towards(now.gaze)
        # Slightly down, as one carries a sensor, and down to earth where the way is soon at a wall.
        return float(np.arctan2(ahead[1], ahead[0])) if walking else now.yaw, np.radians(-13.0)

    def _eye(self) -> np.ndarray:
        return np.array([*self.now.xy, self.now.height])

    def _towards(self, target: np.ndarray) -> tuple[float, float]:
        offset = target - self._eye()
        pitch = np.arctan2(offset[2], max(float(np.hypot(offset[0], offset[1])), 0.3))
        return float(np.arctan2(offset[1], offset[0])), float(np.clip(pitch, np.radians(-38), np.radians(4)))

    def _worth(self, targets: np.ndarray) -> np.ndarray:
        """Which points (N, 3) are in sight and at a distance worth looking, bool (N,)."""
        offset = targets - self._eye()
        distance = np.linalg.norm(offset, axis=1)
        flat = np.linalg.norm(offset[:, :2], axis=1)
        good = (flat > SEEN_M[0]) & (distance < SEEN_M[1])
        if good.any():
            unit = offset[good] / distance[good, None]
            eyes = np.broadcast_to(self._eye(), unit.shape)
            good[good] = self.space.reach(eyes, unit, SEEN_M[1]) > distance[good] - 0.5
        return good

    def _drawn(self) -> bool:
        """Whether the next look goes to what moves, if that is in sight."""
        if self.attention is None or self.rng.random() < 0.1:
            return False
        offset = self.attention(self.now.time) - self._eye()
        distance = float(np.linalg.norm(offset))
        # Furniture around it is no reason to look away, a wall between is.
        seen = self.space.reach(self._eye()[None], offset[None] / max(distance, 1e-6), SEEN_M[1])[0]
        return 0.5 < distance < SEEN_M[1] and seen > distance - 1.6

    def _next_gaze(self, ahead: np.ndarray | None) -> np.ndarray | None:
        """Something in sight, preferably on the way and not far off the present heading."""
        targets = np.array(self.scene.targets).reshape(-1, 3)
        targets = targets + self.rng.normal(0, 0.15, targets.shape)
        skip = ahead is not None and self.rng.random() < 0.3
        seen = targets[self._worth(targets)]
        if skip or len(seen) == 0:
            return None
        angle = np.arctan2(seen[:, 1] - self.now.xy[1], seen[:, 0] - self.now.xy[0])
        cost = np.abs(np.abs(_wrapped(angle - self.now.yaw)) - np.radians(40)) + self.rng.uniform(
            0, 1.0, len(seen)
        )
        if ahead is not None:
            off = np.abs(_wrapped(angle - np.arctan2(ahead[1], ahead[0])))
            cost = cost + np.where(off > np.radians(80), 3.0, 0.0)
            if cost.min() > 3.0:
                return None
        return seen[int(np.argmin(cost))]

    def _widest(self) -> tuple[float, float]:
        """The level direction that reaches farthest."""
        yaw = np.linspace(0, 2 * np.pi, 24, endpoint=False) + self.rng.uniform(0, 0.2)
        eyes = np.broadcast_to(self._eye(), (24, 3))
        far = self.space.reach(eyes, _direction(yaw, np.zeros(24)), 5.0)
        return float(yaw[int(np.argmax(far))]), float(np.radians(-12.0))


def _wrapped(angle):
    """An angle in [-pi, pi)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _direction(yaw: np.ndarray, pitch: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)], -1)


def _follow(rate: float, error: float, fastest: float) -> float:
    """The next turning rate [rad/s] of a head that wants to turn by `error` [rad] and gets there softly."""
    # The square root is the rate from which it can still stop in time.
    wanted = np.sign(error) * min(fastest, 1.8 * abs(error), np.sqrt(1.2 * TURN_ACCELERATION * abs(error)))
    return rate + float(np.clip(wanted - rate, -TURN_ACCELERATION * DT, TURN_ACCELERATION * DT))


def smoothed(space: FreeSpace, route: np.ndarray) -> np.ndarray:
    """A route over columns (M, 2) as a supple line that keeps clear of things, a point every 8 cm; ends hold still."""
    steps = np.linalg.norm(np.diff(route, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    count = max(4, int(along[-1] / 0.08) + 1)
    at = np.linspace(0, along[-1], count)
    line = np.column_stack([np.interp(at, along, route[:, k]) for k in (0, 1)])
    start, ways = line.copy(), space.ways
    for _ in range(160):
        bend = (line[:-2] + line[2:]) / 2 - line[1:-1]
        room = ways.clearance_at(line[1:-1])
        reach = 0.06
        slope = np.column_stack(
            [
                ways.clearance_at(line[1:-1] + step) - ways.clearance_at(line[1:-1] - step)
                for step in (np.array([reach, 0]), np.array([0, reach]))
            ]
        ) / (2 * reach)
        line[1:-1] += 0.5 * bend + 0.15 * np.clip(0.48 - room, 0, 0.2)[:, None] * slope
    tight = ways.clearance_at(line).min() < min(0.27, ways.clearance_at(start).min())
    return start if tight else line
