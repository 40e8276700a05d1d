"""Block-tridiagonal normal equations with a border of global unknowns."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from survey.core.arrays import FloatArray


@dataclass(frozen=True)
class BlockTridiagonal:
    r"""Factorization of the information of K nodes of n unknowns, with the globals behind them.

    With D the diagonal blocks, U those above them, B the coupling to the globals and G
    their own block,

        S_0 = D_0,   S_{k+1} = D_{k+1} − U_kᵀ S_k⁻¹ U_k          (forward)
        Σ_K = S_K⁻¹, Σ_k = S_k⁻¹ + S_k⁻¹ U_k Σ_{k+1} U_kᵀ S_k⁻¹   (backward)

    and the globals, eliminated last, add A⁻¹B (G − BᵀA⁻¹B)⁻¹ BᵀA⁻¹. The cost is linear in K.

    Examples
    --------
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
        diagonal, upper, coupling, own = _blocks(information, n_per_node, n_nodes)
        inverses, log_determinant = _forward(diagonal, upper)
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


def _blocks(information: Any, n: int, n_nodes: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
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


def _forward(diagonal: FloatArray, upper: FloatArray) -> tuple[FloatArray, float]:
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
