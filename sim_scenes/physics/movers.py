"""Chairs that are pushed, doors that open and balls that roll: MuJoCo moves them among the scene's own furniture."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo fills its module at run time.)

from collections.abc import Callable

import mujoco
import numpy as np

from dsmap.classes import CLASS_NAMES
from dsmap.errors import InputError
from dsmap.sim_scenes.geometry.shapes import cushion
from dsmap.sim_scenes.physics.bodies import FIRST_S, SPAN_S, STEP_S, Motion, with_body
from dsmap.sim_scenes.physics.colliders import add_geoms, colliders_of
from dsmap.sim_scenes.pieces import seats
from dsmap.sim_scenes.scene import Material, Part, Piece, Scene
from dsmap.sim_scenes.space.floor_plan import FloorPlan
from dsmap.sim_scenes.textures.palette import Looks

NEAR_M = 3.5
"""Furniture farther from a mover than this is left out of its physics [m]."""
FLAT_M = 0.03
"""Pieces lower than this lie on the floor and stop nothing: rugs, sills [m]."""
PUSH_M_S, PUSH_N = 0.4, 26.0
"""A hand pushes a chair up to this speed [m/s] with at most this force [N]."""
SLIDES = 0.24
"""Friction of a chair's gliders on the floor: with more, a push at the height of its middle topples it."""
CHAIR_KG, BALL_KG = 6.0, 0.45
_DT = 0.004


def pushed_chair(scene: Scene, seconds: float, rng: np.random.Generator) -> Motion:
    """One of the scene's chairs (or a new one) is pushed over the floor, rests, and is pushed back, again and again."""
    scene, piece, direction, length = _chair_with_way(scene, rng)
    rest = piece.T_world_piece
    scene = with_body(scene, "chair", _parts_of(scene, piece), rest)
    spec = _room_around(scene, piece.instance, rest[:2, 3], length)
    body = _free_body(spec, rest)
    solid = colliders_of(piece.assembly)
    add_geoms(spec, body, solid, "mover", mass=CHAIR_KG / len(solid), friction=(SLIDES, 0.005, 1e-4))
    turns = rng.uniform(-0.4, 0.4, 20)
    travel = length / PUSH_M_S

    def hand(t: float, data: mujoco.MjData) -> None:
        turn, now = divmod(t - FIRST_S, travel + 4.0)
        force = np.zeros(6)
        if 0 <= now < travel and t >= FIRST_S:
            # Up to speed within 0.3 s, and let go before the end.
            wanted = PUSH_M_S * min(1.0, now / 0.3) * (direction if turn % 2 == 0 else -direction)
            force[:2] = np.clip(150.0 * (wanted - data.qvel[:2]), -PUSH_N, PUSH_N)
            force[5] = turns[int(turn) % 20]
        # The hands that push it also hold it upright: without them a chair that hits something falls over.
        up = data.xmat[1].reshape(3, 3)[:, 2]
        force[3:5] += 90.0 * np.cross(up, [0.0, 0.0, 1.0])[:2] - 6.0 * data.cvel[1, :2]
        data.xfrc_applied[1] = force

    return Motion(scene, _simulate(spec, seconds, hand)[:, None])


def rolling_ball(scene: Scene, seconds: float, rng: np.random.Generator) -> Motion:
    """A ball lies on the floor and is kicked every few seconds; it rolls, hits furniture and comes to rest."""
    radius = float(rng.uniform(0.09, 0.14))
    plan = FloorPlan(scene, (0.02, 0.5))
    spots = plan.spots(rng, radius + 0.05, 30)
    if len(spots) == 0:
        raise InputError(
            f"scene {scene.name} seed {scene.seed} has no free floor for a ball; expected another seed"
        )
    angles = np.arange(16) * np.pi / 8
    runs = np.array([plan.runs(spot, angles, radius, 4.0, 0.0) for spot in spots])
    start = spots[int(np.argmax(runs.max(1)))]
    rest = np.eye(4)
    rest[:3, 3] = *start, radius
    scene = _with_new_part(
        scene, "ball", rest, cushion((2 * radius,) * 3, (0, 0, -radius), 1.0, 20), _striped(rng)
    )
    spec = _room_around(scene, 0, start, 4.0)
    body = _free_body(spec, rest)
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(radius, 0, 0), mass=BALL_KG, condim=6,
        friction=(0.6, 0.005, 0.0012), solref=(-3000, -12),
    )  # fmt: skip

    def foot(t: float, data: mujoco.MjData) -> None:
        kick, now = divmod(t - FIRST_S, 7.0)
        data.xfrc_applied[1] = 0
        if 0 <= now < 0.12 and kick >= 0:
            found = plan.runs(data.qpos[:2], angles, radius, 4.0, 0.3)
            data.userdata[0] = angles[int(np.argmax(found))] if now < _DT else data.userdata[0]
            speed = 1.1
            way = np.array([np.cos(data.userdata[0]), np.sin(data.userdata[0])])
            data.xfrc_applied[1, :2] = BALL_KG * speed / 0.12 * way

    return Motion(scene, _simulate(spec, seconds, foot)[:, None])


def opening_door(scene: Scene, seconds: float, rng: np.random.Generator) -> Motion:
    """A door leaf of a flat swings almost shut and open again on its hinge, driven like a hand would."""
    leaves = [p for p in scene.pieces if p.name == "door_leaf" and _doorway(scene, p) is not None]
    if not leaves:
        raise InputError(
            f"scene {scene.name} seed {scene.seed} has no open door leaf; expected a scene of several rooms (flat)"
        )
    piece = leaves[int(rng.integers(len(leaves)))]
    rest, shut = piece.T_world_piece, _doorway(scene, piece)
    assert shut is not None
    scene = with_body(scene, "door", _parts_of(scene, piece), rest)
    spec = _spec()
    body = spec.worldbody.add_body(pos=rest[:3, 3], quat=_quaternion(rest))
    joint = body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 0, 1), damping=1.5, frictionloss=0.3)
    add_geoms(spec, body, colliders_of(piece.assembly), "mover", density=500, contype=0, conaffinity=0)
    joint.armature = 0.05
    wide = shut * 0.85

    def hand(t: float, data: mujoco.MjData) -> None:
        # Drawn to almost shut, left so for a while, and opened: a spring-like hand on a slowly moving goal.
        _, now = divmod(max(0.0, t - FIRST_S), 10.0)
        goal = np.interp(now, [0.0, 2.4, 4.4, 7.0, 10.0], [0.0, 1.0, 1.0, 0.0, 0.0]) * wide
        data.qfrc_applied[0] = 60.0 * (goal - data.qpos[0]) - 12.0 * data.qvel[0]

    return Motion(scene, _simulate(spec, seconds, hand)[:, None])


def _doorway(scene: Scene, piece: Piece) -> float | None:
    """By which angle a leaf has to turn on its hinge until it is shut [rad]; None if its doorway leads nowhere."""
    hinge = piece.T_world_piece[:2, 3]
    points = np.concatenate([shape.vertices for shape, *_ in piece.assembly.parts])
    out = piece.T_world_piece[:2, :3] @ points.mean(0)
    width = 2 * np.linalg.norm(out)
    for door in scene.doors:
        across = door.centre - hinge
        if np.linalg.norm(across) < width / 2 + 0.25:
            along = np.array([-door.normal[1], door.normal[0]])
            across = along * np.sign(across @ along)
            turn = np.arctan2(out[0] * across[1] - out[1] * across[0], out @ across)
            return float(turn) if abs(turn) > np.radians(40) else None
    return None


def _chair_with_way(scene: Scene, rng: np.random.Generator) -> tuple[Scene, Piece, np.ndarray, float]:
    """The chair that can be pushed farthest (up to 1.6 m), the direction and the length; a new one where none can."""
    best: tuple[float, Piece, float] | None = None
    angles = np.arange(16) * np.pi / 8
    chairs = [p for p in scene.pieces if p.assembly.label == "chair" and p.T_world_piece[2, 3] < 0.05]
    for piece in [chairs[k] for k in rng.permutation(len(chairs))[:6]]:
        plan = FloorPlan(scene, (0.04, 0.9), range(piece.instance, piece.instance + piece.assembly.items))
        radius = float(np.linalg.norm(piece.assembly.size()[:2])) / 2
        runs = plan.runs(piece.T_world_piece[:2, 3], angles, radius, 1.6, 0.4)
        k = int(np.argmax(runs))
        if best is None or runs[k] > best[0]:
            best = (float(runs[k]), piece, float(angles[k]))
    if best is None or best[0] < 0.7:
        scene, piece = _with_new_chair(scene, rng)
        plan = FloorPlan(scene, (0.04, 0.9), range(piece.instance, piece.instance + 1))
        runs = plan.runs(piece.T_world_piece[:2, 3], angles, 0.33, 1.6, 0.0)
        best = (float(runs.max()), piece, float(angles[int(np.argmax(runs))]))
    length, piece, angle = best
    return scene, piece, np.array([np.cos(angle), np.sin(angle)]), max(length, 0.3)


def _with_new_chair(scene: Scene, rng: np.random.Generator) -> tuple[Scene, Piece]:
    """A copy of the scene with a chair more, where there is most floor."""
    looks = Looks(rng)
    chair = seats.dining_chair(rng, looks)
    chair.parts = [(s, f"moving_{m}", label, item) for s, m, label, item in chair.parts]
    plan = FloorPlan(scene, (0.04, 0.9))
    spots = plan.spots(rng, min(0.34, float(plan.distance.max()) - 0.01), 40)
    angles = np.arange(16) * np.pi / 8
    spot = max(spots, key=lambda xy: plan.runs(xy, angles, 0.33, 1.6, 0.0).max())
    materials = scene.materials | {f"moving_{k}": v for k, v in looks.materials.items()}
    more = Scene(
        **{**vars(scene), "parts": [*scene.parts], "pieces": [*scene.pieces], "materials": materials}
    )
    more.place(chair, (*spot, 0.0), float(rng.uniform(-np.pi, np.pi)))
    return more, more.pieces[-1]


def _with_new_part(scene: Scene, name: str, rest: np.ndarray, shape, look: Material) -> Scene:
    """A copy of the scene with a body of one part more, given in the body's frame."""
    placed = shape.turned(rest[:3, :3]).moved(rest[:3, 3])
    part = Part(placed, f"moving_{name}", CLASS_NAMES.index("objects"), scene.instances + 1)
    more = with_body(scene, name, [], rest, [part])
    more.materials = scene.materials | {f"moving_{name}": look}
    return more


def _striped(rng: np.random.Generator) -> Material:
    """Two colours in stripes: one sees the ball turn."""
    one, other = rng.integers(30, 230, (2, 3))
    stripes = np.where((np.arange(64) // 16 % 2 == 0)[:, None], one, other).astype(np.uint8)
    return Material(np.repeat(stripes[:, None], 64, 1), 0.2, 0.2, 0.4)


def _parts_of(scene: Scene, piece: Piece) -> list[int]:
    """Indices of the parts of a piece and of what stands on it."""
    own = range(piece.instance, piece.instance + piece.assembly.items)
    return [i for i, part in enumerate(scene.parts) if part.instance in own]


def _spec() -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.option.timestep = _DT
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.nuserdata = 1
    return spec


def _room_around(scene: Scene, mover: int, xy: np.ndarray, reach: float) -> mujoco.MjSpec:
    """The floor and all furniture and walls near a place, as things that cannot be moved."""
    spec = _spec()
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=(20, 20, 0.1), friction=(SLIDES, 0.005, 1e-4), condim=6
    )
    for piece in scene.pieces:
        if piece.instance == mover or piece.assembly.label in ("floor", "ceiling"):
            continue
        solid = [c.moved(piece.T_world_piece) for c in colliders_of(piece.assembly)]
        corners = np.concatenate([c.corners() for c in solid])
        low, high = corners.min(0), corners.max(0)
        outside = np.linalg.norm(np.maximum(0, np.maximum(low[:2] - xy, xy - high[:2])))
        if high[2] > FLAT_M and low[2] < 1.2 and outside < min(NEAR_M, reach + 0.8):
            add_geoms(spec, spec.worldbody, solid, f"piece{piece.instance}", friction=(0.2, 0.005, 1e-4))
    return spec


def _free_body(spec: mujoco.MjSpec, T: np.ndarray) -> mujoco.MjsBody:
    body = spec.worldbody.add_body(pos=T[:3, 3] + [0, 0, 0.002], quat=_quaternion(T))
    body.add_freejoint()
    return body


def _quaternion(T: np.ndarray) -> np.ndarray:
    """w, x, y, z."""
    out = np.empty(4)
    mujoco.mju_mat2Quat(out, np.ascontiguousarray(T[:3, :3]).ravel())
    return out


def _simulate(
    spec: mujoco.MjSpec, seconds: float, control: Callable[[float, mujoco.MjData], None]
) -> np.ndarray:
    """Poses of the only body that moves every `STEP_S`, shape (steps, 4, 4), after half a second to settle."""
    model = spec.compile()
    data = mujoco.MjData(model)
    for _ in range(round(0.5 / _DT)):
        mujoco.mj_step(model, data)
    stride, steps = round(STEP_S / _DT), round(max(seconds, SPAN_S) / STEP_S) + 1
    poses = np.tile(np.eye(4), (steps, 1, 1))
    for k in range(steps):
        poses[k, :3, :3], poses[k, :3, 3] = data.xmat[1].reshape(3, 3), data.xpos[1]
        for j in range(stride):
            control((k * stride + j) * _DT, data)
            mujoco.mj_step(model, data)
    return poses
