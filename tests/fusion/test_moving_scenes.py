"""A chair that physics pushes, a person who walks, while the camera watches: rendered with a Kinect's noise."""

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.spatial import cKDTree

from dsmap.frame import Frame
from dsmap.fusion.config import MapConfig, MovingConfig
from dsmap.fusion.mapper import Mapper
from dsmap.kernels.mesh_distance import closest_on_mesh
from dsmap.metrics import ate_rmse

pytest.importorskip("mujoco_warp")

SECONDS = 7


_RECORDINGS = [*(("chair", seed) for seed in range(2, 7)), *(("person", seed) for seed in range(1, 4))]


@pytest.fixture(scope="module", params=_RECORDINGS, ids=lambda p: f"{p[0]}-{p[1]}")
def recording(request) -> Iterator[tuple]:
    """Kind of mover, the take, its frames, and points all over the space that the mover sweeps."""
    from dsmap.sim_scenes.physics.kinds import set_in_motion
    from dsmap.sim_scenes.recording.options import RenderOptions, plan_take
    from dsmap.sim_scenes.recording.record import iter_frames
    from dsmap.sim_scenes.rooms.build import build_scene

    kind, seed = request.param
    options = RenderOptions(
        scene="office", seed=seed, frames=30 * SECONDS, moving=kind, width=160, height=120, noise="kinect"
    )  # fmt: skip
    scene = build_scene("office", seed)
    take = plan_take(scene, options)
    frames = [
        Frame(i, f.time, f.rgb, f.depth, f.T_world_camera)
        for i, f in enumerate(iter_frames(scene, options, take))
    ]
    yield kind, take, frames, set_in_motion(scene, kind, SECONDS, seed).swept()


def final_surface(take) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of the scene as it stands in the last frame."""
    moved = take.scene.moved_by(take.T_world_body[-1])
    vertices, faces, count = [], [], 0
    for number, part in enumerate(take.scene.parts):
        T = moved.get(number, np.eye(4))
        vertices.append(np.asarray(part.shape.vertices) @ T[:3, :3].T + T[:3, 3])
        faces.append(np.asarray(part.shape.faces) + count)
        count += len(vertices[-1])
    return np.concatenate(vertices), np.concatenate(faces)


def mapped(mode: str, take, frames: list, swept: np.ndarray) -> dict[str, float]:
    """ATE [m], lost frames, stable surfels along the way of the mover, and how many of them are ghosts."""
    config = MapConfig(depth_max=6.0, moving=MovingConfig(mode=mode))
    config.loops.mode = "off"
    mapper = Mapper(config, take.camera)
    results = [mapper.step(frame) for frame in frames]
    given = np.array([frame.T_world_camera for frame in frames])
    surfels = mapper.surfels.numpy()
    p = surfels["position"][surfels["weight"] >= 10].astype(float) @ given[0][:3, :3].T + given[0][:3, 3]
    p = p[cKDTree(swept).query(p, distance_upper_bound=0.12)[0] < 0.12]
    off = closest_on_mesh(p, *final_surface(take), max_distance=0.5)[0] if len(p) else np.zeros(0)
    return {
        "ate": ate_rmse(np.array([r.T_world_camera for r in results]), given),
        "lost": sum(not r.tracked for r in results),
        "near": len(p),
        "ghosts": int((off > 0.03).sum()),
        "moving": max(r.moving for r in results),
    }


@pytest.mark.slow
def test_the_mover_is_not_burnt_into_the_map(recording):
    kind, take, frames, swept = recording
    scores = {mode: mapped(mode, take, frames, swept) for mode in ("off", "mask")}
    print(kind, scores)
    mask, off = scores["mask"], scores["off"]
    assert mask["moving"] > 0.03, "the camera sees something move"
    assert mask["lost"] == 0 and mask["ate"] < 0.01
    assert mask["ate"] < 1.2 * off["ate"], "the mask does no harm to the trajectory"
    assert mask["ghosts"] <= 0.8 * off["ghosts"] + 10, "some stay hidden behind the mover"
