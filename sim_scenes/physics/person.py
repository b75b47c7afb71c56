"""A person made of capsules who walks back and forth through a room."""

import numpy as np

from dsmap.classes import CLASS_NAMES
from dsmap.errors import InputError
from dsmap.sim_scenes.geometry.shapes import Shape, lathe, merged, rotation_x, rotation_z
from dsmap.sim_scenes.physics.bodies import FIRST_S, SPAN_S, STEP_S, Motion, with_body
from dsmap.sim_scenes.scene import Material, Part, Scene
from dsmap.sim_scenes.space.floor_plan import FloorPlan
from dsmap.sim_scenes.textures.patterns import noise

SPEED_M_S = 0.7
"""Of the walk [m/s]."""
_STEP_M = 0.5
"""Length of a step [m]."""
RADIUS_M = 0.34
"""Room that a walking person takes [m]."""
HIP_M = 0.86
"""Height of the legs' joints [m]."""


def capsule(radius: float, bottom: float, top: float, at: tuple[float, float] = (0.0, 0.0)) -> Shape:
    """An upright capsule between two heights [m]."""
    bow = np.linspace(0, np.pi / 2, 7)
    foot = [(max(radius * np.sin(a), 1e-3), bottom + radius * (1 - np.cos(a))) for a in bow]
    head = [(max(radius * np.sin(a), 1e-3), top - radius * (1 - np.cos(a))) for a in bow[::-1]]
    return lathe(foot + head, (*at, 0.0), 24)


def walking_person(scene: Scene, seconds: float, rng: np.random.Generator) -> Motion:
    """Walks the longest straight free way of up to 3.5 m, turns round, comes back, and so on.

    Kinematic (no forces), unlike what `movers` has: torso with head and arms, and two legs that swing.
    """
    plan = FloorPlan(scene, (0.05, 1.8))
    spots = plan.spots(rng, RADIUS_M, 60)
    if len(spots) == 0:
        raise InputError(
            f"scene {scene.name} seed {scene.seed} has no free floor for a person; expected another seed"
        )
    angles = np.arange(16) * np.pi / 8
    runs = np.array([plan.runs(spot, angles, RADIUS_M, 3.5, 0.0) for spot in spots])
    spot, way = np.unravel_index(int(np.argmax(runs)), runs.shape)
    scene = _with_person(scene, np.array([*spots[spot], 0.0]), rng)
    return Motion(scene, _walk(spots[spot], float(angles[way]), float(runs.max()), max(seconds, SPAN_S)))


def _with_person(scene: Scene, at: np.ndarray, rng: np.random.Generator) -> Scene:
    """A copy of the scene with the three bodies standing at a floor point, facing +y."""
    cloth = rng.uniform(0.15, 0.75, (2, 3))
    woven = noise(rng, (24, 24), (64, 64))[..., None]
    skin = rng.uniform(90, 215) * np.array([1.0, 0.8, 0.68])
    looks = {
        "moving_shirt": Material((255 * np.clip(cloth[0] * (1 + 0.15 * woven), 0, 1)).astype(np.uint8), 0.5),
        "moving_trousers": Material(
            (255 * np.clip(cloth[1] * (1 + 0.1 * woven), 0, 1)).astype(np.uint8), 0.5
        ),
        "moving_skin": Material(np.tile(skin.astype(np.uint8), (8, 8, 1)), 1.0),
    }
    torso = merged(
        [capsule(0.16, HIP_M - 0.06, 1.46)] + [capsule(0.05, 0.8, 1.42, (x, 0.0)) for x in (-0.22, 0.22)]
    )
    head = merged([capsule(0.105, 1.46, 1.74), capsule(0.055, 1.38, 1.55)])
    label, instance = CLASS_NAMES.index("objects"), scene.instances + 1
    for name, shapes in (
        ("person", (("moving_shirt", torso), ("moving_skin", head))),
        ("left_leg", (("moving_trousers", capsule(0.085, 0.0, HIP_M + 0.08, (-0.1, 0.0))),)),
        ("right_leg", (("moving_trousers", capsule(0.085, 0.0, HIP_M + 0.08, (0.1, 0.0))),)),
    ):
        rest = np.eye(4)
        rest[:3, 3] = at
        parts = [Part(shape.moved(at), look, label, instance) for look, shape in shapes]
        scene = with_body(scene, name, [], rest, parts)
    scene.materials = scene.materials | looks
    return scene


def _walk(start: np.ndarray, angle: float, length: float, seconds: float) -> np.ndarray:
    """Poses of torso and legs every `STEP_S`, shape (steps, 3, 4, 4)."""
    t = np.arange(round(seconds / STEP_S) + 1) * STEP_S
    there, turn = max(length, 0.3) / SPEED_M_S + 0.6, 1.4
    now = np.maximum(0.0, t - FIRST_S)
    lap, phase = np.divmod(now, there + turn)
    back = lap % 2 == 1
    # Half a second to get going and to stop: the way is a smooth step in time.
    u = np.clip(phase / there, 0, 1)
    u = np.where(u < 1, u * u * u * (u * (6 * u - 15) + 10), 1.0)
    way = np.where(back, 1 - u, u) * length
    turned = np.clip((phase - there) / turn, 0, 1)
    turned = turned * turned * (3 - 2 * turned)
    heading = angle - np.pi / 2 + np.pi * (lap + turned)
    swing = 0.5 * np.sin(np.pi * way / _STEP_M) * np.clip(np.gradient(way, STEP_S) ** 2 / 0.1, 0, 1)
    swing += 0.15 * np.sin(np.pi * 2.5 * turned) * (turned > 0) * (turned < 1)
    direction = np.array([np.cos(angle), np.sin(angle)])
    poses = np.tile(np.eye(4), (len(t), 3, 1, 1))
    for k in range(len(t)):
        poses[k, :, :3, :3] = rotation_z(float(heading[k]))
        poses[k, :, :2, 3] = start + way[k] * direction
        for leg, sense in ((1, 1.0), (2, -1.0)):
            hip = np.eye(4)
            hip[:3, :3] = rotation_x(sense * float(swing[k]))
            hip[:3, 3] = np.array([0, 0, HIP_M]) - hip[:3, :3] @ [0, 0, HIP_M]
            poses[k, leg] = poses[k, leg] @ hip
    return poses
