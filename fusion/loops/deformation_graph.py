"""The deformation graph that bends the map so that a loop closes (Sumner et al. 2007, Whelan et al. 2015).

A node l has a position g, an affine A and a shift t; a point follows the k = 4 nodes nearest to it in time,
then in space: phi(p) = sum_n w_n(p) (A_n (p - g_n) + g_n + t_n). Time order keeps surfaces apart that lie
close together but were seen at different times: the two walls that a loop has to make one.
"""

from dataclasses import dataclass

import numpy as np

from dsmap.fusion.config import GraphConfig
from dsmap.fusion.loops.graph_solver import Problem, minimise
from dsmap.kernels.deform import INFLUENCES, deform_surfels, graph_nodes
from dsmap.kernels.types import SurfelMap


@dataclass
class Constraints:
    """Where points of the map belong (Eq. 4 of the paper); M rows. Points in the world frame [m]."""

    source: np.ndarray
    """Q_s: points to be moved, (M, 3)."""
    destination: np.ndarray
    """Q_d: where they belong, (M, 3)."""
    t_source: np.ndarray
    """t_s: frame numbers at which the sources were mapped, (M,)."""
    t_destination: np.ndarray
    """t_d: frame numbers at which the surface at the destinations was mapped, (M,)."""
    pin: np.ndarray
    """bool (M,): the surface at the destination holds still (Eq. 4's second half)."""
    relative: np.ndarray | None = None
    """bool (M,) or None for none: source and destination are to meet wherever the graph takes them (a loop
    closed earlier, that a new one must not tear open)."""

    @staticmethod
    def joined(parts: "list[Constraints]") -> "Constraints":
        """All rows of several sets."""
        flags = [np.zeros(len(p.pin), bool) if p.relative is None else p.relative for p in parts]
        names = ("source", "destination", "t_source", "t_destination", "pin")
        return Constraints(
            *(np.concatenate([getattr(p, name) for p in parts]) for name in names), relative=np.concatenate(flags)
        )  # fmt: skip


@dataclass
class GraphFit:
    """What an optimisation came to. Distances [m]; rotation without unit; RMS over the rows of each term."""

    accepted: bool
    reason: str
    """Why not, in words; empty when accepted."""
    iterations: int
    cost_before: float
    """E of the graph at rest."""
    cost: float
    constraint_before: float
    """RMS distance of sources from their destinations at rest."""
    constraint: float
    """... and after."""
    pin: float
    """RMS distance that pinned points have moved; 0 without pins."""
    regularity: float
    """RMS of E_reg: how far neighbours disagree about each other's place."""
    strain: float
    """RMS of E_rot: 0 where every node is a rigid motion."""


class DeformationGraph:
    """Nodes in time order with their deformation; at rest when built.

    Args:
        positions: g, (N, 3) [m], world frame, N > INFLUENCES.
        times: frame numbers of the nodes, (N,), ascending.
        config: weights, window, gates.
    """

    def __init__(self, positions: np.ndarray, times: np.ndarray, config: GraphConfig | None = None):
        if len(positions) <= INFLUENCES:
            raise ValueError(f"a graph of {len(positions)} nodes; expected more than {INFLUENCES}")
        self.config = config or GraphConfig()
        self.positions = np.asarray(positions, dtype=np.float64)
        self.times = np.asarray(times, dtype=np.int64)
        self.deformation = np.zeros((len(positions), 4, 3))
        """Rows 0-2: the columns of A - I; row 3: t [m]. Shape (N, 4, 3)."""
        self._window = _windows(self.times, self.config.window)

    @classmethod
    def build(
        cls, surfels: SurfelMap, config: GraphConfig | None = None, stable_weight: float = 10.0
    ) -> "DeformationGraph":
        """Sample nodes from the living surfels, evenly in order of creation; stable ones where they suffice.

        Raises:
            ValueError: the map has fewer than INFLUENCES + 1 surfels.
        """
        config = config or GraphConfig()
        arrays = surfels.numpy()
        alive = np.flatnonzero(arrays["weight"] > 0)
        stable = alive[arrays["weight"][alive] >= stable_weight]
        count = int(np.clip(len(alive) // config.spacing, config.min_nodes, config.max_nodes))
        pool = stable if len(stable) >= 10 * count else alive
        created = arrays["t_created"][pool]
        if (np.diff(created) < 0).any():
            pool = pool[np.argsort(created, kind="stable")]
        count = min(count, len(pool))
        chosen = pool[((np.arange(count) + 0.5) * len(pool) / max(count, 1)).astype(np.int64)]
        return cls(arrays["position"][chosen], arrays["t_created"][chosen], config)

    def __len__(self) -> int:
        return len(self.positions)

    def neighbours(self) -> np.ndarray:
        """Pairs (l, n): every node with the INFLUENCES nodes nearest in time order, (N * INFLUENCES, 2)."""
        count, half = len(self), INFLUENCES // 2
        first = np.clip(np.arange(count) - half, 0, count - INFLUENCES - 1)
        near = first[:, None] + np.arange(INFLUENCES + 1)
        own = np.arange(count)[:, None]
        others = near[near != own].reshape(count, INFLUENCES)
        return np.stack([np.repeat(own, INFLUENCES, axis=1), others], axis=-1).reshape(-1, 2)

    def influences(self, points: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Nodes that move points, (M, INFLUENCES), and their weights, which sum to 1 (M, INFLUENCES)."""
        candidates, outside = self._candidates(times)
        distance = np.linalg.norm(self.positions[candidates] - points[:, None], axis=-1)
        distance[outside] = np.inf
        order = np.argsort(distance, axis=1, kind="stable")[:, : INFLUENCES + 1]
        near = np.take_along_axis(distance, order, axis=1)
        d_max = np.maximum(near[:, INFLUENCES:], 1e-12)
        weights = (1 - near[:, :INFLUENCES] / d_max) ** 2
        total = weights.sum(axis=1, keepdims=True)
        weights = np.where(total > 1e-12, weights / np.where(total > 1e-12, total, 1), 1 / INFLUENCES)
        return np.take_along_axis(candidates, order[:, :INFLUENCES], axis=1), weights

    def optimise(self, constraints: Constraints) -> GraphFit:
        """Bend the graph until the constraints hold: E = w_rot E_rot + w_reg E_reg + w_con (E_con + E_pin).

        The deformation is kept only where the fit is accepted, else the graph stays as it was.
        """
        problem = self._problem(constraints)
        solution = minimise(problem, self.config.iterations)
        after, before = (
            problem.residuals(solution.deformation),
            problem.residuals(np.zeros_like(self.deformation)),
        )
        fit = GraphFit(
            False, "", solution.iterations, solution.cost_before, solution.cost,
            constraint_before=_rms(before["constraint"]), constraint=_rms(after["constraint"]),
            pin=_rms(after["pin"]), regularity=_rms(after["regularity"]), strain=_rms(after["rotation"]),
        )  # fmt: skip
        fit.reason = self._objection(fit)
        fit.accepted = not fit.reason
        if fit.accepted:
            self.deformation = solution.deformation
        return fit

    def apply_to_surfels(self, surfels: SurfelMap) -> None:
        """Move the surfels in place, positions and normals; labels ride along."""
        nodes = graph_nodes(
            self.positions,
            self.deformation[:, :3].transpose(0, 2, 1),
            self.deformation[:, 3],
            self._window,
            int(self.times[0]),
            surfels.device,
        )
        deform_surfels(surfels, nodes)

    def apply_to_points(self, points: np.ndarray, times: np.ndarray) -> np.ndarray:
        """phi of points (M, 3) [m] that were mapped at frames `times` (M,)."""
        index, weight = self.influences(points, np.asarray(times))
        linear, shift = self.deformation[index, :3], self.deformation[index, 3]  # (M, k, 3, 3), (M, k, 3)
        offset = points[:, None] - self.positions[index]
        return (
            points
            + np.einsum("mk,mkac,mka->mc", weight, linear, offset)
            + np.einsum("mk,mkc->mc", weight, shift)
        )

    def apply_to_poses(self, poses: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Poses T_world_camera (K, 4, 4) of frames `times` (K,) moved with what was mapped at their time.

        A camera stands metres away from the surface it maps, where the affine maps of the nodes tell nothing.
        So a pose takes the rigid motion that fits the displacements of all nodes of its time best (Kabsch).
        """
        out = np.array(poses, dtype=np.float64)
        if len(out) == 0 or not self.deformation.any():
            return out
        candidates, outside = self._candidates(np.asarray(times))
        share = np.where(outside, 0.0, 1.0)
        share = (share / share.sum(axis=1, keepdims=True))[..., None]
        before = self.positions[candidates]  # (K, w, 3)
        after = before + self.deformation[candidates, 3]
        middle, moved = (share * before).sum(axis=1), (share * after).sum(axis=1)
        H = np.einsum("kwi,kwj->kij", share * (after - moved[:, None]), before - middle[:, None])
        U, _, Vt = np.linalg.svd(H)
        flip = np.ones((len(out), 3))
        flip[:, 2] = np.linalg.det(U @ Vt)
        R = (U * flip[:, None]) @ Vt  # after - moved = R (before - middle)
        out[:, :3, 3] = moved + np.einsum("kij,kj->ki", R, out[:, :3, 3] - middle)
        out[:, :3, :3] = R @ out[:, :3, :3]
        return out

    def _candidates(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Nodes that may move what was mapped at frames `times` (M,), and which entries are none, (M, width)."""
        span = self._window[np.clip(times - self.times[0], 0, len(self._window) - 1)]
        width = int((span[:, 1] - span[:, 0]).max(initial=INFLUENCES + 1))
        candidates = span[:, :1] + np.arange(width)
        return np.minimum(candidates, len(self) - 1), candidates >= span[:, 1:]

    def _problem(self, c: Constraints) -> Problem:
        source, destination = (np.asarray(p, dtype=np.float64) for p in (c.source, c.destination))
        pin = np.asarray(c.pin, dtype=bool)
        relative = np.zeros(len(pin), bool) if c.relative is None else np.asarray(c.relative, dtype=bool)
        return Problem(
            self.config, self.positions, self.neighbours(), source, destination, pin, relative,
            self.influences(source, np.asarray(c.t_source)),
            self.influences(destination, np.asarray(c.t_destination)),
        )  # fmt: skip

    def _objection(self, fit: GraphFit) -> str:
        config = self.config
        reasons = [
            (not np.isfinite(fit.cost), "the normal equations have no solution"),
            (fit.cost > fit.cost_before, "no deformation is better than none"),
            (fit.constraint > config.max_constraint, f"constraints are off by {fit.constraint * 1e3:.1f} mm"),
            (fit.pin > config.max_constraint, f"pinned points moved by {fit.pin * 1e3:.1f} mm"),
            (fit.strain > config.max_strain, f"the map would be strained by {fit.strain:.1%}"),
        ]
        return next((text for bad, text in reasons if bad), "")


def _windows(times: np.ndarray, width: int) -> np.ndarray:
    """Candidates (first, end) for each frame from times[0] to times[-1], shape (frames, 2).

    All nodes of the time that is nearest, and `width` / 2 nodes before and after them.
    """
    frames = np.arange(times[0], times[-1] + 1)
    right = np.minimum(np.searchsorted(times, frames), len(times) - 1)
    left = np.maximum(right - 1, 0)
    nearest = np.where(frames - times[left] <= times[right] - frames, times[left], times[right])
    first = np.searchsorted(times, nearest, side="left") - width // 2
    end = np.searchsorted(times, nearest, side="right") + width // 2
    # At an end of the list the window slides, so that it never holds fewer than INFLUENCES + 1 nodes.
    least = min(width + 1, len(times))
    first = np.clip(first, 0, len(times) - least)
    return np.stack([first, np.maximum(np.minimum(end, len(times)), first + least)], axis=1)


def _rms(residuals: np.ndarray) -> float:
    """Root mean square over rows; residuals (M, n)."""
    return float(np.sqrt((residuals**2).sum(axis=1).mean())) if len(residuals) else 0.0
