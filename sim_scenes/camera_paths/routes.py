"""Where planned walks go: from one viewpoint to the next at random, and round trips back to the start."""

from collections.abc import Callable

import numpy as np

from dsmap.sim_scenes.camera_paths.tours import VIEWPOINT_CLEARANCE, Tour
from dsmap.sim_scenes.scene import Scene
from dsmap.sim_scenes.space.free_space import FreeSpace

LOOP_M = 16.0
"""A round trip through a flat is at least this long, before corners are cut [m]."""
ENOUGH_M = 30.0
"""Once it is this long, rooms that are left are not visited any more [m]."""
FAR_M, FAR_A_ROOM_M = 150.0, 11.0
"""A round trip through several flats is at least this long, or this long for each of their rooms: comfort counts as
length, so about seven tenths of it are walked [m]."""
MOST_ROOMS = 8
"""No single flat has more rooms."""
REST_S = 0.6
"""A round trip begins and ends at rest for this long [s]."""


def wander(
    scene: Scene,
    space: FreeSpace,
    rng: np.random.Generator,
    seconds: float,
    attention: Callable[[float], np.ndarray] | None = None,
) -> Tour:
    """A walk without end from viewpoint to viewpoint, through all rooms in turn, at least `seconds` long.

    Where something moves (`attention`: its place (3,) at a time), the walk stays about it.
    """
    tour, stops = Tour(scene, space, rng, attention), Viewpoints(scene, space)
    if attention is not None:
        return _watch(tour, stops, rng, seconds)
    start = stops.draw(rng, stops.room_of_most())
    tour.begin(space.ways.points[start], stops.target_from(start, rng))
    tour.stand(float(rng.uniform(0.3, 0.8)))
    queue: list[int] = []
    while tour.duration() < seconds:
        queue = queue or [int(k) for k in rng.permutation(len(stops.rooms))]
        room = queue.pop()
        for _ in range(int(rng.integers(1, 4))):
            tour.walk_to(stops.draw(rng, room, away_from=tour.now.xy))
            tour.stand(float(rng.uniform(0.3, 1.6)))
    return tour


def _watch(tour: Tour, stops: "Viewpoints", rng: np.random.Generator, seconds: float) -> Tour:
    """From one place to another from which the tour's `attention` can be seen."""
    assert tour.attention is not None
    target = tour.attention(0.0)
    start = stops.about(rng, target)
    tour.begin(stops.space.ways.points[start], target)
    tour.stand(float(rng.uniform(0.5, 1.0)), (tour.now.yaw, tour.now.pitch))
    tour.now.follows = True
    while tour.duration() < seconds:
        tour.walk_to(stops.about(rng, tour.attention(tour.now.time), away_from=tour.now.xy))
        tour.stand(float(rng.uniform(0.5, 2.0)))
    return tour


def round_trip(scene: Scene, space: FreeSpace, rng: np.random.Generator, seconds: float = 0.0) -> Tour:
    """A walk through rooms (or around one) that ends where and as it began; repeated until `seconds` are full.

    The end has the eye and the heading of the start to within a few millimetres and tenths of a degree.
    """
    stops, ways = Viewpoints(scene, space), space.ways
    start = stops.draw(rng, stops.room_of_most())
    target = stops.target_from(start, rng)
    tour = Tour(scene, space, rng)
    tour.begin(ways.points[start], target)
    heading, height = (tour.now.yaw, tour.now.pitch), tour.now.height
    tour.stand(REST_S, heading)
    vias = _around(stops, start, rng) if len(stops.rooms) == 1 else _through_rooms(stops, start, rng)
    while True:
        for via in vias:
            tour.walk_to(via)
            if rng.random() < 0.4:
                tour.stand(float(rng.uniform(0.3, 1.2)))
        home = heading[0] + 2 * np.pi * np.round((tour.now.yaw - heading[0]) / (2 * np.pi))
        tour.walk_to(start, (float(home), heading[1]))
        home = heading[0] + 2 * np.pi * np.round((tour.now.yaw - heading[0]) / (2 * np.pi))
        tour.level_to(height)
        tour.turn_to((float(home), heading[1]))
        tour.stand(REST_S, (float(home), heading[1]))
        if tour.duration() >= seconds:
            return tour


class Viewpoints:
    """Columns of the floor where one may stop, by room."""

    def __init__(self, scene: Scene, space: FreeSpace) -> None:
        self.scene, self.space = scene, space
        ways = space.ways
        every = np.arange(len(ways.points))
        boxes = [(room.low, room.high) for room in scene.rooms] or [(space.low[:2], space.high[:2])]
        inside = [every[((ways.points > low) & (ways.points < high)).all(1)] for low, high in boxes]
        self.rooms = [room for room in inside if len(room) >= 20] or [every]
        """Columns of each room that can be walked in, (N,) each."""

    def room_of_most(self) -> int:
        """The room with the most floor to walk on."""
        return int(np.argmax([len(room) for room in self.rooms]))

    def draw(self, rng: np.random.Generator, room: int, away_from: np.ndarray | None = None) -> int:
        """A random column of a room with space around it, 1 m or more `away_from` a floor point if there is one."""
        columns, ways = self.rooms[room], self.space.ways
        wide = columns[ways.room_left[columns] >= min(VIEWPOINT_CLEARANCE, ways.room_left[columns].max())]
        if away_from is not None:
            far = np.linalg.norm(ways.points[wide] - away_from, axis=1)
            wide = wide[far >= min(1.0, far.max())]
        return int(rng.choice(wide))

    def about(self, rng: np.random.Generator, target: np.ndarray, away_from: np.ndarray | None = None) -> int:
        """A random column from 1.3 to 3.2 m away from a point (3,) that sees it; any column where there is none."""
        ways = self.space.ways
        eyes = np.column_stack([ways.points, np.full(len(ways.points), 1.45)])
        offset = target - eyes
        distance = np.linalg.norm(offset, axis=1)
        good = (distance > 1.3) & (distance < 3.2) & (ways.room_left >= min(0.36, ways.room_left.max()))
        if away_from is not None:
            good &= np.linalg.norm(ways.points - away_from, axis=1) > 0.6
        reach = self.space.reach(eyes[good], offset[good] / distance[good, None], 3.2)
        good[good] = reach > distance[good] - 0.9
        if good.any():
            return int(rng.choice(np.flatnonzero(good)))
        return int(np.argmin(np.abs(distance - 2.0)))

    def target_from(self, column: int, rng: np.random.Generator) -> np.ndarray | None:
        """One of the scene's targets that is in full sight from a column, (3,)."""
        eye = np.array([*self.space.ways.points[column], 1.45])
        targets = np.array(self.scene.targets).reshape(-1, 3)
        offset = targets - eye
        distance = np.linalg.norm(offset, axis=1)
        good = (distance > 1.2) & (distance < 4.0)
        unit = offset / np.maximum(distance, 1e-6)[:, None]
        good &= self.space.reach(np.broadcast_to(eye, unit.shape), unit, 4.2) > distance - 0.5
        return targets[rng.choice(np.flatnonzero(good))] if good.any() else None


def _through_rooms(stops: Viewpoints, start: int, rng: np.random.Generator) -> list[int]:
    """Viewpoints of room after room, nearest first with some chance, until the way there and back is long enough."""
    ways, here, total = stops.space.ways, start, 0.0
    vias: list[int] = []
    count = len(stops.rooms)
    left = [k for k in range(count) if start not in stops.rooms[k]]
    far = max(FAR_M, FAR_A_ROOM_M * count) if count > MOST_ROOMS else 0.0
    while True:
        costs = ways.costs(here)
        if total + costs[start] >= max(far, ENOUGH_M if left else LOOP_M):
            return vias
        left = left or list(range(len(stops.rooms)))
        draws = [stops.draw(rng, room, away_from=ways.points[here]) for room in left]
        k = int(np.argmin([costs[d] * rng.uniform(0.6, 1.4) for d in draws]))
        total += float(costs[draws[k]])
        vias.append(draws[k])
        here = draws[k]
        del left[k]


def _around(stops: Viewpoints, start: int, rng: np.random.Generator) -> list[int]:
    """Viewpoints all around one room: the farthest walkable column in each of six directions from its middle."""
    ways, columns = stops.space.ways, stops.rooms[0]
    middle = ways.points[columns].mean(0)
    angle = np.arctan2(*(ways.points[columns] - middle).T[::-1])
    first = float(np.arctan2(*(ways.points[start] - middle)[::-1]))
    sense, vias = float(rng.choice([-1.0, 1.0])), []
    for k in range(1, 6):
        off = np.abs((angle - first - sense * k * np.pi / 3 + np.pi) % (2 * np.pi) - np.pi)
        near = columns[off < np.radians(25)]
        if len(near) == 0:
            continue
        room = np.minimum(ways.room_left[near], VIEWPOINT_CLEARANCE) * 6
        score = room + 0.5 * np.linalg.norm(ways.points[near] - middle, axis=1)
        vias.append(int(near[np.argmax(score + rng.uniform(0, 0.3, len(near)))]))
    return vias
