"""The deformation graph against its NumPy twin, closed-form rigid motions, and finite differences."""

import numpy as np
import pytest
from synthetic_map import map_of, room_arrays, room_map

from dsmap.fusion.config import GraphConfig
from dsmap.fusion.lie import exp_se3
from dsmap.fusion.loops.deformation_graph import Constraints, DeformationGraph
from dsmap.fusion.loops.graph_solver import minimise, rotation_residuals
from dsmap.kernels import launch
from dsmap.tools.twins import deform as reference

MOTION = exp_se3(np.array([0.4, -0.2, 0.3, 0.3, 0.5, -0.4]))
SMALL = GraphConfig(spacing=400, min_nodes=8, max_constraint=10.0, max_strain=10.0)


def moved(T, points):
    return points @ T[:3, :3].T + T[:3, 3]


def graph_of(seed=0, nodes=40, config=SMALL) -> DeformationGraph:
    rng = np.random.default_rng(seed)
    times = np.sort(rng.integers(0, 90, nodes))
    times[:8] = 0  # many nodes of one frame: a first image gives dozens
    return DeformationGraph(rng.uniform(0, 4, (nodes, 3)), times, config)


def constraints_of(rng, count, source=None, T=MOTION, **flags) -> Constraints:
    source = rng.uniform(0, 4, (count, 3)) if source is None else source
    times = rng.integers(0, 90, (2, count))
    rows = {"pin": np.zeros(count, bool)} | flags
    return Constraints(source, moved(T, source), *times, **rows)


def bent(graph, seed=1, scale=0.1):
    graph.deformation = np.random.default_rng(seed).normal(0, scale, graph.deformation.shape)
    return graph


@pytest.mark.parametrize("threads", [False, True])
def test_kernel_against_twin(threads, monkeypatch):
    if threads:
        monkeypatch.setattr(launch, "_SMALL", 10)
        monkeypatch.setattr(launch, "CPU_BLOCK", 64)
    arrays = {name: values[::17].copy() for name, values in room_arrays(0.08).items()}
    arrays["weight"][5] = 0  # dead
    surfels, graph = map_of(arrays), bent(graph_of())
    expected = reference.deform(graph, {name: v.astype(np.float64) for name, v in arrays.items()})
    graph.apply_to_surfels(surfels)
    np.testing.assert_allclose(surfels.numpy()["position"], expected["position"], atol=2e-6)
    np.testing.assert_allclose(surfels.numpy()["normal"], expected["normal"], atol=1e-5)
    assert (surfels.numpy()["position"][5] == arrays["position"][5]).all()
    for name in ("colour", "weight", "radius", "t_created", "t_updated", "label"):
        np.testing.assert_array_equal(surfels.numpy()[name], arrays[name])


def test_points_against_twin():
    graph, rng = bent(graph_of()), np.random.default_rng(2)
    points, times = rng.uniform(0, 4, (60, 3)), rng.integers(-5, 120, 60)  # before and after the nodes too
    expected = [
        reference.move(graph.positions, graph.times, graph.config.window, graph.deformation, p, t)[0]
        for p, t in zip(points, times, strict=True)
    ]
    np.testing.assert_allclose(graph.apply_to_points(points, times), expected, atol=1e-12)


def test_rest_changes_nothing_bit_for_bit():
    surfels, graph = room_map(0.1), graph_of()
    surfels.numpy()["normal"][:] += 0.013  # not quite unit: rest must not even normalise
    before = {name: values.copy() for name, values in surfels.numpy().items()}
    graph.apply_to_surfels(surfels)
    for name, values in before.items():
        assert (surfels.numpy()[name] == values).all(), name
    poses = np.stack([exp_se3(np.full(6, 0.1 * i)) for i in range(5)])
    assert (graph.apply_to_poses(poses, np.arange(5)) == poses).all()


def test_build_samples_evenly_in_time_order():
    surfels = room_map(0.03)
    arrays = surfels.numpy()
    arrays["weight"][:] = 20
    arrays["weight"][::7] = 0
    alive = np.count_nonzero(arrays["weight"])
    graph = DeformationGraph.build(surfels, GraphConfig(spacing=500, min_nodes=8))
    assert len(graph) == alive // 500
    assert (np.diff(graph.times) >= 0).all() and np.ptp(np.bincount(graph.times // 10)[1:-1]) <= 3
    living = {tuple(p) for p in arrays["position"][arrays["weight"] > 0].tolist()}
    assert all(tuple(p) in living for p in graph.positions.tolist())
    again = DeformationGraph.build(surfels, GraphConfig(spacing=500, min_nodes=8))
    assert (again.positions == graph.positions).all()
    assert len(DeformationGraph.build(surfels, GraphConfig(spacing=10**6, min_nodes=20))) == 20
    assert len(DeformationGraph.build(surfels, GraphConfig(spacing=1, max_nodes=300))) == 300
    arrays["t_created"][:] = arrays["t_created"][::-1].copy()
    assert (np.diff(DeformationGraph.build(surfels, GraphConfig(spacing=500)).times) >= 0).all()
    with pytest.raises(ValueError, match="more than 4"):
        DeformationGraph.build(map_of({name: v[:3] for name, v in room_arrays(0.5).items()}))


def test_rigid_motion_of_all_constraints_moves_everything_rigidly():
    surfels = room_map(0.06)
    arrays = {name: values.copy() for name, values in surfels.numpy().items()}
    graph = DeformationGraph.build(surfels, SMALL)
    rng = np.random.default_rng(0)
    chosen = rng.choice(surfels.count, 300, replace=False)
    source, times = arrays["position"][chosen].astype(np.float64), arrays["t_created"][chosen]
    fit = graph.optimise(Constraints(source, moved(MOTION, source), times, times, np.zeros(300, bool)))
    assert fit.accepted and fit.iterations <= 10, fit
    assert fit.constraint < 1e-6 < 0.5 < fit.constraint_before and fit.strain < 1e-6 and fit.regularity < 1e-6
    graph.apply_to_surfels(surfels)
    np.testing.assert_allclose(surfels.numpy()["position"], moved(MOTION, arrays["position"]), atol=1e-4)
    np.testing.assert_allclose(surfels.numpy()["normal"], arrays["normal"] @ MOTION[:3, :3].T, atol=1e-4)
    poses = np.stack([exp_se3(np.array([2.0, 1.5, 1.2, 0, 0.1 * i, 0])) for i in range(9)])
    np.testing.assert_allclose(graph.apply_to_poses(poses, 10 * np.arange(9)), MOTION @ poses, atol=1e-6)


def corridor(length=20.0, nodes=400):
    """A straight corridor that was mapped from x = 0 to x = length at 20 frames a metre."""
    rng = np.random.default_rng(3)
    x = np.linspace(0, length, nodes)
    return np.stack([x, rng.uniform(-1, 1, nodes), rng.uniform(-1.2, 1.2, nodes)], axis=1), (20 * x).astype(
        int
    )


def test_a_bend_is_spread_smoothly_and_pins_hold():
    positions, times = corridor()
    graph = DeformationGraph(positions, times, GraphConfig())
    rng = np.random.default_rng(4)
    end, start = positions[-40:] + rng.normal(0, 0.1, (40, 3)), positions[:40] + rng.normal(0, 0.1, (40, 3))
    drift = np.array([0.0, 0.10, 0.04])
    fit = graph.optimise(
        Constraints(
            np.concatenate([end, start]), np.concatenate([end + drift, start]),
            np.concatenate([times[-40:], times[:40]]), np.concatenate([times[-40:], times[:40]]),
            np.repeat([False, True], 40),
        )
    )  # fmt: skip
    assert fit.accepted and fit.constraint < 1e-4 and fit.pin < 1e-4, fit
    shift = graph.apply_to_points(positions, times) - positions
    assert np.abs(shift[:30]).max() < 1e-3, "the pinned start holds still"
    assert np.abs(shift[-30:] - drift).max() < 1e-3, "the end is where it belongs"
    camera = np.eye(4)[None].repeat(2, axis=0)
    camera[:, :3, 3] = positions[[10, -10]] + [0, 0, 2.0]  # metres away from what they see
    carried = graph.apply_to_poses(camera, times[[10, -10]])[:, :3, 3] - camera[:, :3, 3]
    assert np.abs(carried[0]).max() < 5e-3 and np.abs(carried[1] - drift).max() < 5e-3
    along = shift[:, 1].reshape(20, -1).mean(axis=1)
    assert (np.diff(along) > -2e-3).all(), "the correction grows along the way"
    assert 0.03 < along[10] < 0.07 and np.abs(np.diff(along)).max() < 0.02
    assert fit.strain < 2e-3, "bent, not stretched"


def test_relative_constraints_meet_wherever_the_rest_goes():
    positions, times = corridor(nodes=120)
    config = GraphConfig(window=8)
    graph = DeformationGraph(positions, times, config)
    source, destination = positions[50:56] + [0, 0, 0.02], positions[50:56]
    meet = Constraints(
        source, destination, times[50:56], times[50:56] - 100, np.zeros(6, bool), relative=np.ones(6, bool)
    )
    hold = Constraints(positions[:20], positions[:20], times[:20], times[:20], np.zeros(20, bool))
    pull = Constraints(
        positions[-20:], positions[-20:] + [0, 0.1, 0], times[-20:], times[-20:], np.zeros(20, bool)
    )
    assert graph.optimise(Constraints.joined([hold, pull, meet])).accepted
    met = graph.apply_to_points(source, times[50:56]) - graph.apply_to_points(destination, times[50:56] - 100)
    assert np.abs(met).max() < 5e-3
    assert abs(graph.apply_to_points(source, times[50:56]) - source)[:, 1].max() > 0.02, "moved with the rest"


def test_energy_and_gradient_against_dense_twin():
    graph, rng = graph_of(nodes=14, config=GraphConfig(window=6)), np.random.default_rng(5)
    c = constraints_of(
        rng, 8, T=exp_se3(np.full(6, 0.05)), pin=rng.random(8) < 0.5, relative=rng.random(8) < 0.4
    )
    problem = graph._problem(c)
    Y = rng.normal(0, 0.1, graph.deformation.shape)
    r = reference.energy_residuals(graph, c, Y)
    assert problem.cost(Y) == pytest.approx(r @ r, rel=1e-12)
    # The dense Jacobian by central differences.
    J = np.empty((len(r), Y.size))
    for i in range(Y.size):
        h = np.zeros(Y.size)
        h[i] = 1e-5
        plus, minus = (reference.energy_residuals(graph, c, Y + s * h.reshape(Y.shape)) for s in (1, -1))
        J[:, i] = (plus - minus) / 2e-5
    np.testing.assert_allclose(problem.gradient(Y), J.T @ r, rtol=1e-6, atol=1e-6)
    step = problem.normal_matrix().solve(problem.rotation_blocks(Y), 1e-8, problem.gradient(Y))
    expected = np.linalg.solve(J.T @ J + 1e-8 * np.eye(Y.size), J.T @ r)
    np.testing.assert_allclose(step, expected, rtol=1e-4, atol=1e-5)


def test_rotation_jacobian_by_finite_differences():
    Y = np.random.default_rng(6).normal(0, 0.3, (3, 4, 3))
    _, J = rotation_residuals(Y)
    for i in range(9):
        h = np.zeros((3, 12))
        h[:, i] = 1e-6
        h = h.reshape(Y.shape)
        difference = (rotation_residuals(Y + h)[0] - rotation_residuals(Y - h)[0]) / 2e-6
        np.testing.assert_allclose(J[:, :, i], difference, atol=1e-8)
    rigid = np.zeros((1, 4, 3))
    rigid[0, :3] = MOTION[:3, :3].T - np.eye(3)
    assert np.abs(rotation_residuals(rigid)[0]).max() < 1e-12


def test_the_minimum_is_one():
    """At the end of the search no small change of the graph lowers the energy."""
    graph, rng = graph_of(nodes=20, config=GraphConfig(window=8)), np.random.default_rng(7)
    problem = graph._problem(constraints_of(rng, 12, T=exp_se3(np.full(6, 0.1))))
    solution = minimise(problem, 60)
    assert np.abs(problem.gradient(solution.deformation)).max() < 1e-3 * np.sqrt(solution.cost_before)
    for _ in range(20):
        nudge = rng.normal(0, 1e-4, solution.deformation.shape)
        assert problem.cost(solution.deformation + nudge) >= solution.cost - 1e-9


def test_contradicting_constraints_are_refused_and_leave_the_graph_alone():
    positions, times = corridor(nodes=60)
    graph = DeformationGraph(positions, times)
    source = np.repeat(positions[30:35], 2, axis=0)
    destination = source + np.tile([[0, 0.5, 0], [0, -0.5, 0]], (5, 1))
    t = np.repeat(times[30:35], 2)
    fit = graph.optimise(Constraints(source, destination, t, t, np.zeros(10, bool)))
    assert not fit.accepted and "constraints are off by" in fit.reason
    assert (graph.deformation == 0).all()


def test_no_constraints_bend_nothing():
    graph = graph_of()
    empty = np.empty((0, 3))
    fit = graph.optimise(Constraints(empty, empty, np.empty(0, int), np.empty(0, int), np.empty(0, bool)))
    assert fit.accepted and fit.iterations == 0 and (graph.deformation == 0).all()


def test_poses_stay_rigid():
    graph = bent(graph_of())
    poses = np.stack([exp_se3(np.full(6, 0.2 * i)) for i in range(12)])
    out = graph.apply_to_poses(poses, 8 * np.arange(12))
    for T in out:
        np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-9)
        assert np.linalg.det(T[:3, :3]) > 0 and (T[3] == [0, 0, 0, 1]).all()
    assert graph.apply_to_poses(np.empty((0, 4, 4)), np.empty(0, int)).shape == (0, 4, 4)
