"""What can be set in motion in a scene, by name."""

from collections.abc import Callable

import numpy as np

from dsmap.errors import InputError
from dsmap.sim_scenes.physics.bodies import Motion
from dsmap.sim_scenes.physics.movers import opening_door, pushed_chair, rolling_ball
from dsmap.sim_scenes.physics.person import walking_person
from dsmap.sim_scenes.scene import Scene

MOVERS: dict[str, Callable[[Scene, float, np.random.Generator], Motion]] = {
    "chair": pushed_chair,
    "door": opening_door,
    "ball": rolling_ball,
    "person": walking_person,
}
"""Each: (scene, seconds, rng) -> motion of a copy of the scene. All but the person, who is kinematic, are physics."""
MOVING = ("none", *MOVERS)


def set_in_motion(scene: Scene, kind: str, seconds: float, seed: int) -> Motion:
    """A scene with something that moves in it for `seconds` and at least a minute; the scene itself stays as it is.

    Raises:
        InputError: unknown kind, or a scene where nothing of the kind can move.
    """
    if kind not in MOVERS:
        raise InputError(f"unknown moving thing {kind!r}; expected one of: {', '.join(MOVING)}")
    return MOVERS[kind](scene, seconds, np.random.default_rng([seed, 81, list(MOVERS).index(kind)]))
