"""The pose graph: known answers, a brute-force twin, and what it makes of a way with one weak place."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from dsmap.fusion.lie import exp_se3, inverse, log_se3, pose_difference
from dsmap.fusion.loops.corrected_way import StepCovariances, world_corrections
from dsmap.fusion.loops.pose_graph import PoseEdge, corrections, edges_along, graph_cost, solve_pose_graph
from dsmap.fusion.loops.record import LoopRecord


def circle(count: int, radius: float = 4.0) -> np.ndarray:
    """A way around a circle, looking ahead; the last pose is the first."""
    poses = []
    for angle in np.linspace(0, 2 * np.pi, count):
        T = exp_se3(np.array([0, 0, 0, 0, angle, 0]))
        T[:3, 3] = T[:3, :3] @ np.array([radius, 0, 0])
        poses.append(T)
    return np.array(poses)


def drifted(true: np.ndarray, slips: dict[int, np.ndarray]) -> np.ndarray:
    """The way as tracked: the steps of `slips` are wrong by a twist."""
    poses = [true[0]]
    for k in range(1, len(true)):
        poses.append(poses[-1] @ inverse(true[k - 1]) @ true[k] @ exp_se3(slips.get(k, np.zeros(6))))
    return np.array(poses)


def loop(frame: int, destination: int, true: np.ndarray) -> LoopRecord:
    T = inverse(true[destination]) @ true[frame]
    return LoopRecord("local", frame, destination, T, 0.1, 1e-5, 50000, 1.0, 0)


def random_edges(rng: np.random.Generator, true: np.ndarray) -> list[PoseEdge]:
    pairs = [*((k, k + 1) for k in range(len(true) - 1)), (0, len(true) - 1), (1, 4)]
    edges = []
    for i, j in pairs:
        root = rng.normal(size=(6, 6)) + 4 * np.eye(6)
        noise = exp_se3(rng.normal(size=6) * 0.02)
        edges.append(PoseEdge(i, j, inverse(true[i]) @ true[j] @ noise, root @ root.T))
    return edges


def test_edges_that_agree_are_met_exactly():
    true = circle(12)
    rng = np.random.default_rng(1)
    edges = [PoseEdge(e.source, e.target, inverse(true[e.source]) @ true[e.target], e.information)
             for e in random_edges(rng, true)]  # fmt: skip
    start = np.array([T @ exp_se3(0.05 * rng.normal(size=6) * (k > 0)) for k, T in enumerate(true)])
    found = solve_pose_graph(start, edges)
    np.testing.assert_allclose(found, true, atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_the_minimum_is_that_of_brute_force(seed):
    rng = np.random.default_rng(seed)
    true = circle(7)
    edges = random_edges(rng, true)
    roots = [np.linalg.cholesky(edge.information).T for edge in edges]

    def residuals(x):
        poses = np.array(
            [true[0], *(T @ exp_se3(xi) for T, xi in zip(true[1:], x.reshape(-1, 6), strict=True))]
        )
        return np.concatenate([
            root @ log_se3(inverse(e.T_source_target) @ inverse(poses[e.source]) @ poses[e.target])
            for e, root in zip(edges, roots, strict=True)
        ])  # fmt: skip

    best = least_squares(residuals, np.zeros(36), xtol=1e-12, ftol=1e-12)
    assert graph_cost(solve_pose_graph(true, edges), edges) == pytest.approx(2 * best.cost, rel=1e-3)


def test_a_way_without_a_loop_stays_as_it_is():
    poses = drifted(circle(50), {20: np.array([0.1, 0, 0, 0, 0.02, 0])})
    edges = edges_along(poses, np.tile(1e-6 * np.eye(6), (50, 1, 1)), np.arange(0, 50, 7))
    np.testing.assert_allclose(solve_pose_graph(poses[::7], edges), poses[::7], atol=1e-9)


def test_the_correction_goes_to_the_frames_that_were_unsure():
    true = circle(201)
    slip = np.array([0.12, 0.0, -0.05, 0.0, 0.02, 0.0])
    poses = drifted(true, {k: slip / 10 for k in range(100, 110)})
    sure = np.tile(1e-8 * np.eye(6), (201, 1, 1))
    unsure = sure.copy()
    unsure[100:110] *= 1e4
    worst = []
    for covariances in (sure, unsure):
        moved = world_corrections(poses, covariances, [loop(200, 0, true)])
        worst.append(max(pose_difference(T, t)[0] for T, t in zip(moved @ poses, true, strict=True)))
    drift = max(pose_difference(T, t)[0] for T, t in zip(poses, true, strict=True))
    assert drift > 0.12 and worst[0] > 0.02, "even sharing leaves the middle wrong"
    assert worst[1] < worst[0] / 5 and worst[1] < 0.025


def test_corrections_between_nodes_are_between_theirs():
    before = circle(21)[[0, 10, 20]]
    after = before.copy()
    after[1] = before[1] @ exp_se3(np.array([0.1, 0.02, 0.0, 0.0, 0.1, 0.0]))
    moved = corrections(before, after, np.array([0, 10, 20]), 21)
    np.testing.assert_allclose(moved[10] @ before[1], after[1], atol=1e-9)
    np.testing.assert_allclose(moved[[0, 20]], np.tile(np.eye(4), (2, 1, 1)), atol=1e-9)
    for T in moved:
        np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-9)


def test_steps_that_were_not_tracked_are_the_unsurest():
    steps = StepCovariances()
    steps.remember(0, None)
    for time in (1, 2, 5):
        steps.remember(time, 1e-10 * time * np.eye(6))
    again = StepCovariances(steps.array())
    scaled = again.scaled(7)
    assert np.isfinite(scaled).all() and len(scaled) == 7
    size = scaled[:, 0, 0]
    assert size[1] < size[2] < size[5] < size[[0, 3, 4, 6]].min()
    assert size[2] == pytest.approx(5e-4**2, rel=0.02)
