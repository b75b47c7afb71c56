"""Small things dropped onto furniture and floor, and settled by MuJoCo; what falls or never rests is left out."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo fills its module at run time.)

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from dsmap.sim_scenes.physics.colliders import Collider, add_geoms, hull_of
from dsmap.sim_scenes.scene import Assembly

STEP_S, FALL_S, PATIENCE_S = 0.004, 0.8, 2.4
"""Time step; after the first time all are looked at; what has not come to rest after the second is left out."""
_DEEP = 0.004
"""Resting things may sink this far into what they lie on [m]."""
SLIP = 0.12
"""Things that end up this much lower than their support have fallen off [m]."""
SLOW = 0.02
"""At rest, a thing's fastest point moves less than this [m/s]."""


@dataclass
class LooseThing:
    """Something to be dropped, and where."""

    assembly: Assembly
    T_world_start: np.ndarray
    """Just above its support, shape (4, 4)."""
    support: float
    """Height of the surface it is meant for [m]."""


def settle(things: Sequence[LooseThing], static: Sequence[Collider]) -> list[np.ndarray | None]:
    """Let things fall onto static colliders.

    Args:
        things: what falls, not touching each other at the start.
        static: colliders of all that may be hit, in the world.

    Returns:
        Where each thing came to rest, T_world_thing (4, 4); None for one that fell off or never rested.
    """
    poses: list[np.ndarray | None] = [thing.T_world_start for thing in things]
    for _ in range(4):
        alive = [k for k, pose in enumerate(poses) if pose is not None]
        if not alive:
            break
        rested = _simulate([things[k] for k in alive], [poses[k] for k in alive], static)
        for k, pose in zip(alive, rested, strict=True):
            poses[k] = pose
        if all(pose is not None for pose in rested):
            break  # nothing was taken out from under the others
    else:
        return [None] * len(things)
    return poses


def _simulate(
    things: Sequence[LooseThing], poses: Sequence[np.ndarray | None], static: Sequence[Collider]
) -> list[np.ndarray | None]:
    model, data, owner = _world(things, poses, static)
    size = np.array([np.linalg.norm(t.assembly.bounds(), axis=1).max() for t in things])
    rest = np.zeros(len(things), bool)
    while data.time < PATIENCE_S:
        mujoco.mj_step(model, data, round(FALL_S / STEP_S / 2))
        speed = np.abs(data.qvel.reshape(-1, 6))
        rest = speed[:, :3].max(1) + speed[:, 3:].max(1) * size < SLOW
        if data.time >= FALL_S and rest.all():
            break
    mujoco.mj_forward(model, data)
    found: list[np.ndarray | None] = []
    sunk = np.zeros(len(things))
    for (one, two), distance in zip(data.contact.geom, data.contact.dist, strict=True):
        for geom in (one, two):
            if owner[geom] >= 0:
                sunk[owner[geom]] = max(sunk[owner[geom]], -float(distance))
    for k, thing in enumerate(things):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = data.xmat[k + 1].reshape(3, 3), data.xpos[k + 1]
        lowest = min(float((shape.vertices @ T[2, :3]).min()) for shape, *_ in thing.assembly.parts) + T[2, 3]
        good = rest[k] and lowest > thing.support - SLIP and sunk[k] < _DEEP
        found.append(T if good else None)
    return found


def _world(
    things: Sequence[LooseThing], poses: Sequence[np.ndarray | None], static: Sequence[Collider]
) -> tuple[mujoco.MjModel, mujoco.MjData, np.ndarray]:
    """Model, its state, and the thing that each geom belongs to (-1 = static)."""
    spec = mujoco.MjSpec()
    spec.option.timestep = STEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.iterations = 30
    add_geoms(spec, spec.worldbody, static, "static", friction=(0.7, 0.01, 0.002))
    owner = [-1] * len(static)
    for k, (thing, pose) in enumerate(zip(things, poses, strict=True)):
        assert pose is not None
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(pose[:3, :3]).ravel())
        body = spec.worldbody.add_body(pos=pose[:3, 3], quat=quaternion)
        body.add_freejoint()
        add_geoms(
            spec, body, [hull_of(thing.assembly)], f"thing{k}", density=400.0, friction=(0.7, 0.02, 0.004),
            condim=6, solref=(2.5 * STEP_S, 1.0),
        )  # fmt: skip
        owner.append(k)
    model = spec.compile()
    model.dof_damping[:] = 0.02 * np.repeat(model.body_mass[1:], 6)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data, np.array(owner)
