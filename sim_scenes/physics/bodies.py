"""Things that move while a scene is filmed: which there are, and where they are at any time."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from dsmap.sim_scenes.scene import Body, Part, Scene
from dsmap.sim_scenes.space.free_space import surface_samples

STEP_S = 0.02
"""Time between the poses that a motion keeps [s]."""
SPAN_S = 60.0
"""Things move during this time at least, whatever the length of the recording: how long it is changes nothing."""
FIRST_S = 2.5
"""Nothing moves before [s]: the still scene is seen first."""


@dataclass(frozen=True)
class Motion:
    """The moving bodies of a scene over time."""

    scene: Scene
    """The scene with its moving bodies; `parts` and `bodies` show them at rest."""
    T_world_body: np.ndarray
    """Poses every `STEP_S` seconds, shape (steps, bodies, 4, 4)."""

    def at(self, t: np.ndarray) -> np.ndarray:
        """Poses T_world_body at times (N,) [s], shape (N, bodies, 4, 4); after the last step all is at rest."""
        last = len(self.T_world_body) - 1
        place = np.clip(np.asarray(t) / STEP_S, 0, last)
        low = np.minimum(place.astype(int), max(last - 1, 0))
        part = (place - low)[:, None]
        before, after = self.T_world_body[low], self.T_world_body[np.minimum(low + 1, last)]
        poses = before.copy()
        poses[..., :3, 3] += part[..., None] * (after[..., :3, 3] - before[..., :3, 3])
        for k in range(poses.shape[1]):
            first = Rotation.from_matrix(before[:, k, :3, :3])
            turn = (first.inv() * Rotation.from_matrix(after[:, k, :3, :3])).as_rotvec()
            poses[:, k, :3, :3] = (first * Rotation.from_rotvec(part * turn)).as_matrix()
        return poses

    def centre(self, t: float) -> np.ndarray:
        """Middle of the first body at a time [s], (3,): what one looks at."""
        points = np.concatenate([p.shape.vertices for p in self.scene.parts if p.body == 1])
        middle = (points.min(0) + points.max(0)) / 2
        body = self.at(np.array([t]))[0, 0] @ np.linalg.inv(self.scene.bodies[0].T_world_rest)
        return body[:3, :3] @ middle + body[:3, 3]

    def swept(self) -> np.ndarray:
        """Points on the surfaces of moving bodies wherever they come, five times a second, shape (N, 3)."""
        rng, found = np.random.default_rng(0), []
        for number, body in enumerate(self.scene.bodies, 1):
            shapes = [p.shape for p in self.scene.parts if p.body == number]
            points = np.concatenate([surface_samples(s.vertices, s.faces, 0.06, rng) for s in shapes])
            path = self.T_world_body[:: round(0.2 / STEP_S), number - 1]
            moved = path @ np.linalg.inv(body.T_world_rest)
            # A standing body would count over and over.
            still = np.linalg.norm(np.diff(moved[:, :3].reshape(-1, 12), axis=0), axis=1) < 1e-3
            moved = moved[np.concatenate([[True], ~still])]
            found.append(np.einsum("kij,nj->kni", moved[:, :3, :3], points) + moved[:, None, :3, 3])
        return np.concatenate([f.reshape(-1, 3) for f in found])


def with_body(
    scene: Scene, name: str, parts: list[int], T_world_rest: np.ndarray, added: list[Part] | None = None
) -> Scene:
    """A copy of a scene in which some of its parts (indices), or new ones, are one moving body."""
    number = len(scene.bodies) + 1
    every = [replace(p, body=number) if i in set(parts) else p for i, p in enumerate(scene.parts)]
    every += [replace(p, body=number) for p in added or []]
    instance = next(p.instance for p in every if p.body == number)
    return replace(
        scene,
        parts=every,
        bodies=[*scene.bodies, Body(name, instance, T_world_rest)],
        instances=max(scene.instances, *(p.instance for p in every)),
    )
