"""Sparse linear algebra of the smoother: whitened least-squares rows and block-tridiagonal normal equations.

`NormalEquations` collects rows over the nodes of a path, and has priors, random walks and Gauss-Markov processes as
terms. `BlockTridiagonal` factorizes the resulting information, whose blocks couple neighbouring nodes and a border of
global unknowns; the cost is linear in the number of nodes.
"""

from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from scipy import sparse

from survey.core import FloatArray, IntArray

PER_NODE = 13
"""Unknowns of a node: position (3), yaw, pitch, roll, GPS bias (3), barometer's drift, scale, slow part of yaw, gyro's bias."""
E, YAW, PITCH, ROLL, BIAS, DRIFT, SCALE, HEADING, GYRO = 0, 3, 4, 5, 6, 9, 10, 11, 12
DELAY, MEAN_SCALE, WHEEL_SCALE, SKID, DATUM, PITCH_BIAS, ROLL_BIAS, FORCE_PITCH, FORCE_ROLL = range(-9, 0)
"""Unknowns that all nodes share, counted from the end; the delay of the fixes is left out where it is known. Those of
the ice's motion come before them."""
N_GLOBALS = 8
"""Number of shared unknowns without the delay of the fixes."""

Term = tuple[IntArray, FloatArray]


@dataclass
class NormalEquations:
    """Rows ``Σ coefficient · unknown = value ± sigma``, and what they amount to."""

    n_nodes: int
    has_delay: bool = False
    n_motion: int = 0
    rows: list[IntArray] = field(default_factory=list)
    columns: list[IntArray] = field(default_factory=list)
    entries: list[FloatArray] = field(default_factory=list)
    right: list[FloatArray] = field(default_factory=list)
    log_sigma: float = 0.0
    n_rows: int = 0

    @property
    def n_unknowns(self) -> int:
        """Number of unknowns, globals included."""
        return self.n_nodes * PER_NODE + self.n_motion + N_GLOBALS + self.has_delay

    def motion_terms(self, by: FloatArray) -> list[Term]:
        """Return the terms of the unknowns of the ice's motion, from coefficients (N, R); they stand behind the nodes."""
        first = self.n_nodes * PER_NODE
        return [(np.array(first + k), column) for k, column in enumerate(by.T)]

    def add(self, terms: list[Term], value: FloatArray, sigma: FloatArray) -> None:
        """Add rows; a term's columns and coefficients have one entry a row, or one for all."""
        n = len(value)
        row = self.n_rows + np.arange(n)
        for column, coefficient in terms:
            self.rows.append(row)
            self.columns.append(np.broadcast_to(column, n) % self.n_unknowns)
            self.entries.append(coefficient / sigma)
        self.right.append(value / sigma)
        self.log_sigma += float(np.log(np.broadcast_to(sigma, n)).sum())
        self.n_rows += n

    def add_prior(self, which: IntArray | int, sigma: float) -> None:
        """Add the prior 0 ± sigma of one unknown."""
        one = np.ones(1)
        self.add([(np.atleast_1d(np.asarray(which)), one)], 0.0 * one, sigma * one)

    def add_gauss_markov(self, which: int, memory: FloatArray, sigma: float, mean: int | None = None) -> None:
        """Add a Gauss-Markov process: x' − μ' = memory · (x − μ) + noise that keeps the variance.

        The mean μ is another unknown, a global or of the node.
        """
        before = np.arange(len(memory))
        first, one, ones = np.zeros(1, dtype=np.int64), np.ones(1), np.ones(len(memory))
        steps: list[Term] = [(unknown(before + 1, which), ones), (unknown(before, which), -memory)]
        start: list[Term] = [(unknown(first, which), one)]
        if mean is not None:
            steps += [(unknown(before + 1, mean), -ones), (unknown(before, mean), memory)]
            start.append((unknown(first, mean), -one))
        noise = sigma * np.sqrt(np.maximum(1.0 - memory**2, 1e-12))
        self.add(steps, np.zeros(len(memory)), noise)
        self.add(start, 0.0 * one, sigma * one)

    def add_turning_gauss_markov(
        self,
        pair: tuple[int, int],
        memory: FloatArray,
        turn_rad: FloatArray,
        sigma: float,
        means: tuple[int, int],
    ) -> None:
        """Add a Gauss-Markov process of a vector that stays in the world while the axes of its components turn.

        With x, y the components about their means on axes that turn by Δψ from node to node,

            x' = memory · (cos Δψ · x + sin Δψ · y) + noise,    y' = memory · (cos Δψ · y − sin Δψ · x) + noise.
        """
        before, ones, one = np.arange(len(memory)), np.ones(len(memory)), np.ones(1)
        noise = sigma * np.sqrt(np.maximum(1.0 - memory**2, 1e-12))
        along, across = memory * np.cos(turn_rad), memory * np.sin(turn_rad)
        for own, other, sign in ((0, 1, 1.0), (1, 0, -1.0)):
            terms: list[Term] = [
                (unknown(before + 1, pair[own]), ones),
                (unknown(before, means[own]), along - ones),
            ]
            terms += [(unknown(before, pair[own]), -along), (unknown(before, pair[other]), -sign * across)]
            terms.append((unknown(before, means[other]), sign * across))
            self.add(terms, np.zeros(len(memory)), noise)
            first = np.zeros(1, dtype=np.int64)
            start: list[Term] = [(unknown(first, pair[own]), one), (unknown(first, means[own]), -one)]
            self.add(start, 0.0 * one, sigma * one)

    def add_walk(self, which: int, sigma: FloatArray) -> None:
        """Let an unknown change from node to node by independent steps of standard deviations (K - 1,)."""
        before, ones = np.arange(len(sigma)), np.ones(len(sigma))
        self.add([(unknown(before + 1, which), ones), (unknown(before, which), -ones)], 0.0 * ones, sigma)

    @property
    def design(self) -> Any:
        """The whitened rows, sparse."""
        place = (np.concatenate(self.rows), np.concatenate(self.columns))
        return sparse.csr_array((np.concatenate(self.entries), place), shape=(self.n_rows, self.n_unknowns))

    @property
    def values(self) -> FloatArray:
        """The whitened right-hand side."""
        return np.concatenate(self.right)


def unknown(nodes: IntArray | int, which: int) -> IntArray:
    """Return the column of one unknown of some nodes; a global is the same for all."""
    own: IntArray = np.asarray(nodes, dtype=np.int64) * PER_NODE
    return own + which if which >= 0 else np.full_like(own, which)


@dataclass(frozen=True)
class BlockTridiagonal:
    r"""Factorization of the information of K nodes of n unknowns, with the globals behind them.

    With D the diagonal blocks, U those above them, B the coupling to the globals and G
    their own block,

        S_0 = D_0,   S_{k+1} = D_{k+1} − U_kᵀ S_k⁻¹ U_k          (forward)
        Σ_K = S_K⁻¹, Σ_k = S_k⁻¹ + S_k⁻¹ U_k Σ_{k+1} U_kᵀ S_k⁻¹   (backward)

    and the globals, eliminated last, add A⁻¹B (G − BᵀA⁻¹B)⁻¹ BᵀA⁻¹. The cost is linear in K.

    >>> from scipy import sparse
    >>> matrix = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, 1.0], [0.0, 1.0, 3.0]])
    >>> chain = BlockTridiagonal.of(sparse.coo_array(matrix), 1, 2)
    >>> inverse = np.linalg.inv(matrix)
    >>> bool(np.allclose(chain.solve(np.eye(3)), inverse))
    True
    >>> own, with_next = chain.covariances()
    >>> bool(np.allclose(own.ravel(), np.diag(inverse)[:2]) and np.isclose(with_next[0, 0, 0], inverse[0, 1]))
    True
    """

    inverses: FloatArray
    upper: FloatArray
    coupling: FloatArray
    by_global: FloatArray
    rest: FloatArray
    log_determinant: float

    @classmethod
    def of(cls, information: Any, n_per_node: int, n_nodes: int) -> Self:
        """Factorize a symmetric positive definite ``scipy.sparse.coo_array`` (K n + g, K n + g)."""
        diagonal, upper, coupling, own = _blocks_of(information, n_per_node, n_nodes)
        inverses, log_determinant = _eliminated(diagonal, upper)
        by_global = _substituted(inverses, upper, coupling)
        rest = own - np.einsum("kni,knj->ij", coupling, by_global)
        log_determinant += float(np.linalg.slogdet(rest)[1])
        return cls(inverses, upper, coupling, by_global, rest, log_determinant)

    @property
    def n_unknowns(self) -> int:
        """Number of unknowns, globals included."""
        n_nodes, n = self.inverses.shape[:2]
        return int(n_nodes * n + len(self.rest))

    def solve(self, sides: FloatArray) -> FloatArray:
        """Return the solutions (K n + g, R) of right-hand sides (K n + g, R)."""
        n_nodes, n = self.inverses.shape[:2]
        last = n_nodes * n
        alone = _substituted(self.inverses, self.upper, sides[:last].reshape(n_nodes, n, -1))
        behind = sides[last:] - np.einsum("kni,knr->ir", self.coupling, alone)
        shared = np.linalg.solve(self.rest, behind)
        among = (alone - self.by_global @ shared).reshape(last, -1)
        return np.vstack([among, shared])

    def covariances(self) -> tuple[FloatArray, FloatArray]:
        """Return the marginal covariance of each node (K, n, n), and that of each with the next (K − 1, n, n)."""
        own = self.inverses.copy()
        with_next = np.empty_like(self.upper)
        for k in range(len(self.upper) - 1, -1, -1):
            gain = self.inverses[k] @ self.upper[k]
            with_next[k] = -gain @ own[k + 1]
            own[k] -= with_next[k] @ gain.T
        of_globals = self.by_global @ np.linalg.inv(self.rest)
        own += of_globals @ self.by_global.transpose(0, 2, 1)
        with_next += of_globals[:-1] @ self.by_global[1:].transpose(0, 2, 1)
        return 0.5 * (own + own.transpose(0, 2, 1)), with_next


def _blocks_of(
    information: Any, n: int, n_nodes: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the diagonal blocks, blocks above them, coupling of nodes to globals, the globals' own block."""
    row, column, value = information.row, information.col, information.data
    last = n_nodes * n
    n_globals = information.shape[0] - last
    diagonal, upper = np.zeros((n_nodes, n, n)), np.zeros((n_nodes - 1, n, n))
    coupling, own = np.zeros((n_nodes, n, n_globals)), np.zeros((n_globals, n_globals))
    node_row, node_column = row // n, column // n
    among = (row < last) & (column < last)
    same = among & (node_row == node_column)
    next_one = among & (node_column == node_row + 1)
    to_global = (row < last) & (column >= last)
    both_global = (row >= last) & (column >= last)
    np.add.at(diagonal, (node_row[same], row[same] % n, column[same] % n), value[same])
    np.add.at(upper, (node_row[next_one], row[next_one] % n, column[next_one] % n), value[next_one])
    np.add.at(coupling, (node_row[to_global], row[to_global] % n, column[to_global] - last), value[to_global])
    np.add.at(own, (row[both_global] - last, column[both_global] - last), value[both_global])
    return diagonal, upper, coupling, own


def _eliminated(diagonal: FloatArray, upper: FloatArray) -> tuple[FloatArray, float]:
    inverses, log_determinant = np.empty_like(diagonal), 0.0
    remaining = diagonal[0]
    for k in range(len(diagonal)):
        if k:
            remaining = diagonal[k] - upper[k - 1].T @ inverses[k - 1] @ upper[k - 1]
        inverses[k] = np.linalg.inv(remaining)
        log_determinant += float(np.linalg.slogdet(remaining)[1])
    return inverses, log_determinant


def _substituted(inverses: FloatArray, upper: FloatArray, sides: FloatArray) -> FloatArray:
    solved = sides.copy()
    for k in range(len(upper)):
        solved[k + 1] -= upper[k].T @ (inverses[k] @ solved[k])
    solved[-1] = inverses[-1] @ solved[-1]
    for k in range(len(upper) - 1, -1, -1):
        solved[k] = inverses[k] @ (solved[k] - upper[k] @ solved[k + 1])
    return solved
