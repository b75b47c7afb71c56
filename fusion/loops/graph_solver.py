"""Gauss-Newton on the energy of a deformation graph, with a sparse LDL^T factorisation.

The unknown is Y (N, 4, 3), one node a row: the columns of A - I, then t. All terms but E_rot are linear in Y
and the same for x, y and z, so their normal equations are built once, for one coordinate; an iteration only
adds the 9x9 blocks of E_rot to a matrix whose pattern stays.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import qdldl
import scipy.sparse as sp

from dsmap.fusion.config import GraphConfig

_DAMPING = 1e-8
"""Added to the diagonal: directions that nothing constrains stay where they are. Far below every real stiffness."""
_MAX_DAMPING = 1e2
_CONVERGED = 1e-9
"""An iteration that lowers the energy by less than this share ends the search..."""
_NEGLIGIBLE = 1e-12
"""... or one that leaves less than this energy: residuals of a ten-thousandth of a millimetre."""
Influences = tuple[np.ndarray, np.ndarray]
"""Node indices and weights of M points, both (M, k)."""


@dataclass
class Solution:
    """Where the search ended."""

    deformation: np.ndarray
    """Y, (N, 4, 3)."""
    cost_before: float
    cost: float
    iterations: int


class Problem:
    """The energy of one set of constraints; source and destination points (M, 3) [m], flags (M,)."""

    def __init__(
        self,
        config: GraphConfig,
        positions: np.ndarray,
        neighbours: np.ndarray,
        source: np.ndarray,
        destination: np.ndarray,
        pin: np.ndarray,
        relative: np.ndarray,
        of_source: Influences,
        of_destination: Influences,
    ):
        self.count, self.w_rot = len(positions), config.w_rot
        rows_s, rows_d = (
            _point_rows(positions, p, *of) for p, of in ((source, of_source), (destination, of_destination))
        )
        follow = sp.diags(relative.astype(np.float64))
        gap = source - destination
        self._terms = {  # name: (weight, rows M of one coordinate, offset b): residual = M Y + b
            "regularity": (config.w_reg, _neighbour_rows(positions, neighbours), None),
            "constraint": (config.w_con, sp.csr_matrix(rows_s - follow @ rows_d), gap),
            "pin": (config.w_con, rows_d[np.flatnonzero(pin)], None),
        }
        self._hessian = sum(w * (rows.T @ rows) for w, rows, _ in self._terms.values())

    def residuals(self, Y: np.ndarray) -> dict[str, np.ndarray]:
        """Residuals a term, without weights: rotation (N, 6), regularity, constraint and pin (rows, 3)."""
        flat = Y.reshape(-1, 3)
        out = {"rotation": rotation_residuals(Y)[0]}
        for name, (_, rows, offset) in self._terms.items():
            out[name] = rows @ flat + (0 if offset is None else offset)
        return out

    def cost(self, Y: np.ndarray) -> float:
        """E of Y: w_rot E_rot + w_reg E_reg + w_con (E_con + E_pin)."""
        weights = {"rotation": self.w_rot} | {name: term[0] for name, term in self._terms.items()}
        return float(sum(weights[name] * (r**2).sum() for name, r in self.residuals(Y).items()))

    def gradient(self, Y: np.ndarray) -> np.ndarray:
        """Half the gradient of the cost, J^T W r, (12 N,)."""
        rotation, J = rotation_residuals(Y)
        residuals = self.residuals(Y)
        linear = sum(w * (rows.T @ residuals[name]) for name, (w, rows, _) in self._terms.items())
        out = np.asarray(linear).reshape(-1, 12)
        out[:, :9] += self.w_rot * np.einsum("nij,ni->nj", J, rotation)
        return out.ravel()

    def normal_matrix(self) -> "NormalMatrix":
        """J^T W J without E_rot, ready to take its blocks."""
        return NormalMatrix(sp.csc_matrix(self._hessian), self.count)

    def rotation_blocks(self, Y: np.ndarray) -> np.ndarray:
        """J^T W J of E_rot, (N, 9, 9)."""
        _, J = rotation_residuals(Y)
        return self.w_rot * np.einsum("nia,nib->nab", J, J)


class NormalMatrix:
    """The upper triangle of J^T W J in CSC form: a fixed part and the places of the blocks of E_rot."""

    def __init__(self, hessian: sp.csc_matrix, count: int):
        size = 12 * count
        fixed: Any = sp.kron(hessian, sp.identity(3), format="coo")  # one coordinate -> x, y, z
        a, b = np.triu_indices(9)
        own = 12 * np.arange(count)[:, None]
        rows, columns = (own + a).ravel(), (own + b).ravel()
        diagonal = np.arange(size)
        upper = fixed.row <= fixed.col
        key_fixed = fixed.col[upper].astype(np.int64) * size + fixed.row[upper]
        key_blocks, key_diagonal = columns * size + rows, diagonal * (size + 1)
        keys = np.unique(np.concatenate([key_fixed, key_blocks, key_diagonal]))
        self._data = np.zeros(len(keys))
        self._data[np.searchsorted(keys, key_fixed)] = fixed.data[upper]
        self._blocks, self._diagonal = np.searchsorted(keys, key_blocks), np.searchsorted(keys, key_diagonal)
        self._in_block = (slice(None), a, b)
        starts = np.searchsorted(keys // size, np.arange(size + 1))
        self._matrix = sp.csc_matrix((self._data.copy(), keys % size, starts), shape=(size, size))
        self._solver: Any = None

    def solve(self, blocks: np.ndarray, damping: float, right: np.ndarray) -> np.ndarray:
        """(J^T W J + damping I)^-1 right; the ordering is found once, as the pattern never changes."""
        data = self._data.copy()
        data[self._blocks] += blocks[self._in_block].ravel()
        data[self._diagonal] += damping
        self._matrix.data[:] = data
        if self._solver is None:
            self._solver = qdldl.Solver(self._matrix, upper=True)
        else:
            self._solver.update(self._matrix, upper=True)
        return np.asarray(self._solver.solve(right))


def minimise(problem: Problem, iterations: int) -> Solution:
    """Gauss-Newton from rest. A step that raises the energy is taken back and tried with more damping."""
    Y = np.zeros((problem.count, 4, 3))
    before = cost = problem.cost(Y)
    damping, done, matrix = _DAMPING, 0, None
    while done < iterations and cost > _NEGLIGIBLE and damping <= _MAX_DAMPING:
        matrix = matrix or problem.normal_matrix()
        done += 1
        step = matrix.solve(problem.rotation_blocks(Y), damping, problem.gradient(Y))
        tried = Y - step.reshape(Y.shape)
        new = problem.cost(tried) if np.isfinite(step).all() else np.inf
        if new > cost:
            damping *= 100
            continue
        converged = cost - new <= _CONVERGED * cost
        Y, cost = tried, new
        if converged:
            break
    return Solution(Y, before, cost, done)


def rotation_residuals(Y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """E_rot of all nodes: how far the columns of A are from orthonormal (N, 6), and its Jacobian (N, 6, 9)."""
    A = Y[:, :3] + np.eye(3)  # A[:, j]: the column a_j
    r, J = np.empty((len(Y), 6)), np.zeros((len(Y), 6, 3, 3))
    for row, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
        r[:, row] = (A[:, i] * A[:, j]).sum(axis=1)
        J[:, row, i], J[:, row, j] = A[:, j], A[:, i]
    for j in range(3):
        r[:, 3 + j] = (A[:, j] ** 2).sum(axis=1) - 1
        J[:, 3 + j, j] = 2 * A[:, j]
    return r, J.reshape(-1, 6, 9)


def _point_rows(
    positions: np.ndarray, points: np.ndarray, index: np.ndarray, weight: np.ndarray
) -> sp.csr_matrix:
    """Rows of phi(p) - p = sum_n w_n ((A_n - I)(p - g_n) + t_n), (M, 4 N)."""
    offset = points[:, None] - positions[index]  # (M, k, 3)
    values = np.concatenate([offset, np.ones((*index.shape, 1))], axis=-1) * weight[..., None]
    columns = 4 * index[..., None] + np.arange(4)
    starts = np.arange(len(points) + 1) * index.shape[1] * 4
    return sp.csr_matrix((values.ravel(), columns.ravel(), starts), shape=(len(points), 4 * len(positions)))


def _neighbour_rows(positions: np.ndarray, pairs: np.ndarray) -> sp.csr_matrix:
    """Rows of E_reg: A_l (g_n - g_l) + g_l + t_l - (g_n + t_n), (pairs, 4 N)."""
    own, other = pairs[:, 0], pairs[:, 1]
    gap = positions[other] - positions[own]
    values = np.concatenate([gap, np.ones((len(pairs), 1)), -np.ones((len(pairs), 1))], axis=1)
    columns = np.concatenate([4 * own[:, None] + np.arange(4), 4 * other[:, None] + 3], axis=1)
    starts = np.arange(len(pairs) + 1) * 5
    return sp.csr_matrix((values.ravel(), columns.ravel(), starts), shape=(len(pairs), 4 * len(positions)))
