"""Normal equations of a chain: each node meets its neighbours and a few globals, and no other."""

from typing import Any

import numpy as np

from survey.arrays import FloatArray


def solve_chain(
    information: Any, right: FloatArray, n_per_node: int, n_nodes: int
) -> tuple[FloatArray, FloatArray]:
    r"""Solve for K nodes of n unknowns and the globals behind them, with marginal covariances.

    With A the block-tridiagonal part, B its coupling to the globals and G their own block,

        S_0 = D_0,   S_{k+1} = D_{k+1} − U_kᵀ S_k⁻¹ U_k          (forward)
        Σ_K = S_K⁻¹, Σ_k = S_k⁻¹ + S_k⁻¹ U_k Σ_{k+1} U_kᵀ S_k⁻¹   (backward)

    and the globals, eliminated last, add A⁻¹B (G − BᵀA⁻¹B)⁻¹ BᵀA⁻¹. The cost is linear in K.

    Parameters
    ----------
    information : scipy.sparse.coo_array
        (K n + g, K n + g), symmetric positive definite.
    right : (K n + g,) ndarray
        Right-hand side.
    n_per_node, n_nodes : int
        n and K.

    Returns
    -------
    estimate : (K, n) ndarray
        Of the nodes' unknowns.
    covariance : (K, n, n) ndarray
        Marginal of each node.

    Examples
    --------
    >>> from scipy import sparse
    >>> matrix = sparse.coo_array(np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, 1.0], [0.0, 1.0, 3.0]]))
    >>> estimate, covariance = solve_chain(matrix, np.array([1.0, 0.0, 0.0]), 1, 2)
    >>> inverse = np.linalg.inv(matrix.toarray())
    >>> bool(np.allclose(covariance.ravel(), np.diag(inverse)[:2]) and np.allclose(estimate.ravel(), inverse[:2, 0]))
    True
    """
    diagonal, upper, coupling, own = _blocks(information, n_per_node, n_nodes)
    inverses = _forward(diagonal, upper)
    sides = np.concatenate([coupling, right[: n_nodes * n_per_node].reshape(n_nodes, n_per_node, 1)], axis=2)
    solved = _substituted(inverses, upper, sides)
    by_global, alone = solved[:, :, :-1], solved[:, :, -1]
    rest = own - np.einsum("kni,knj->ij", coupling, by_global)
    shared = np.linalg.solve(rest, right[n_nodes * n_per_node :] - np.einsum("kni,kn->i", coupling, alone))
    covariance = _backward(inverses, upper) + by_global @ np.linalg.inv(rest) @ by_global.transpose(0, 2, 1)
    return alone - by_global @ shared, 0.5 * (covariance + covariance.transpose(0, 2, 1))


def _blocks(information: Any, n: int, n_nodes: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Diagonal blocks, blocks above them, coupling of nodes to globals, the globals' own block."""
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


def _forward(diagonal: FloatArray, upper: FloatArray) -> FloatArray:
    inverses = np.empty_like(diagonal)
    inverses[0] = np.linalg.inv(diagonal[0])
    for k in range(len(upper)):
        inverses[k + 1] = np.linalg.inv(diagonal[k + 1] - upper[k].T @ inverses[k] @ upper[k])
    return inverses


def _substituted(inverses: FloatArray, upper: FloatArray, sides: FloatArray) -> FloatArray:
    solved = sides.copy()
    for k in range(len(upper)):
        solved[k + 1] -= upper[k].T @ (inverses[k] @ solved[k])
    solved[-1] = inverses[-1] @ solved[-1]
    for k in range(len(upper) - 1, -1, -1):
        solved[k] = inverses[k] @ (solved[k] - upper[k] @ solved[k + 1])
    return solved


def _backward(inverses: FloatArray, upper: FloatArray) -> FloatArray:
    covariance = inverses.copy()
    for k in range(len(upper) - 1, -1, -1):
        gain = inverses[k] @ upper[k]
        covariance[k] += gain @ covariance[k + 1] @ gain.T
    return covariance
